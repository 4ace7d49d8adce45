"""Checks of what plugins return: numbers of rows, times, and finite values.

Shapes and types of a table are checked when it is made.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any, Final

import numpy as np

from star_core.errors import ContractError
from star_core.messages.arrays import Mask, Rows, Table, every, require_type
from star_core.messages.state import Estimate, Goals, Plan, Setpoint, Truth
from star_core.messages.telemetry import UNLABELLED, Telemetry

TIME_TOLERANCE: Final = 1e-3  # s; clocks of computers have a resolution
ESTIMATED: Final = ("position", "velocity", "yaw", "covariance")  # columns of estimates
CORRECTED: Final = ("position", "attitude", "position_deviation")  # of corrections


def checked_time(answer: Any, until: float) -> float:
    """Return a transport's time, s, after it waited until another; raise `ContractError`."""
    now = float(answer)
    if not until - TIME_TOLERANCE <= now < math.inf:
        raise ContractError(f"wait({until!r}) returned {now!r}, expected that time or later")
    return now


def checked_timeout(answer: object) -> float:
    """Return the timeout that a task's ``begin`` returned, s; raise `ContractError`."""
    if not isinstance(answer, Real) or not 0 < answer < math.inf:  # type: ignore[operator]
        raise ContractError(f"begin() returned {answer!r}, expected the timeout of the step, s")
    return float(answer)


def checked_telemetry(answer: object, n: int) -> Telemetry:
    """Return a transport's telemetry if it has `n` rows and a time; raise `ContractError`."""
    telemetry = require_type(answer, Telemetry, n)
    if not math.isfinite(telemetry.time):
        raise ContractError(f"Telemetry.time is {telemetry.time!r}, expected a number")
    for name in ("odometry", "frames", "detections", "fixes"):
        if len(rows := getattr(telemetry, name).agent):
            labelled = rows[rows != UNLABELLED] if name == "fixes" else rows
            _require_agents(f"Telemetry.{name}.agent", labelled, n)
    return telemetry


def checked_truth(answer: object, n: int) -> Truth | None:
    """Return a transport's ground truth of `n` rows, if it has it; raise `ContractError`."""
    if answer is None:
        return None
    return require_type(answer, Truth, n)


def checked_location(answer: object, telemetry: Telemetry) -> Estimate:
    """Return a localizer's estimate for the time of telemetry; raise `ContractError`."""
    estimate = checked_estimate(answer, len(telemetry.age))
    if not abs(estimate.time - telemetry.time) <= TIME_TOLERANCE:
        raise ContractError(
            f"Estimate.time is {estimate.time!r}, expected the telemetry's, {telemetry.time!r}"
        )
    return estimate


def checked_estimate(answer: object, n: int) -> Estimate:
    """Return a localizer's estimate of `n` rows, finite where it is valid; raise `ContractError`.

    Corrections must be finite, except that an infinite `attitude_deviation` stands for no attitude.
    """
    estimate = require_type(answer, Estimate, n)
    _require_finite(estimate, "Estimate.{}", ESTIMATED, estimate.valid)
    if not all(isinstance(text, str) for text in estimate.messages):
        raise ContractError(f"Estimate.messages is {estimate.messages!r}, expected texts")
    frames = estimate.map_from_odom
    _require_finite(frames, "Estimate.map_from_odom.{}", ("yaw", "translation"), estimate.valid)
    for name in ("sightings", "detections"):
        if len(rows := getattr(estimate, name).agent):
            _require_agents(f"Estimate.{name}.agent", rows, n)
    if len(corners := estimate.detections.corners):
        everywhere = np.ones(len(corners), np.bool_)
        _require_finite(estimate.detections, "Estimate.detections.{}", ("corners",), everywhere)
    corrections = estimate.corrections
    if len(corrections.agent):
        _require_agents("Estimate.corrections.agent", corrections.agent, n)
        everywhere, text = np.ones(len(corrections.agent), np.bool_), "Estimate.corrections.{}"
        _require_finite(corrections, text, CORRECTED, everywhere)
        measured = ~np.isposinf(corrections.attitude_deviation)
        _require_finite(corrections, text, ("attitude_deviation",), measured)
    return estimate


def checked_plan(answer: object, n: int) -> Plan:
    """Return a planner's plan for `n` agents, finite where it is active; raise `ContractError`."""
    plan = require_type(answer, Plan)
    checked_setpoint(plan.setpoint, n)
    if len(plan.paths.agent):
        _require_agents("Plan.paths.agent", plan.paths.agent, n)
    if not isinstance(plan.reasons, Mapping):
        raise ContractError(f"Plan.reasons is {plan.reasons!r}, expected a map from row to text")
    return plan


def checked_goals(answer: object, n: int) -> Goals:
    """Return goals of `n` rows, finite where they are active; raise `ContractError`."""
    goals = require_type(answer, Goals, n)
    _require_finite(goals, "Goals.{}", ("position", "velocity", "yaw", "speed"), goals.active)
    return goals


def checked_setpoint(answer: object, n: int) -> Setpoint:
    """Return a setpoint of `n` rows, finite where it is active; raise `ContractError`."""
    setpoint = require_type(answer, Setpoint, n)
    _require_finite(setpoint, "Setpoint.{}", ("velocity", "yaw"), setpoint.active)
    return setpoint


def _require_agents(field: str, rows: Rows, n: int) -> None:
    if not every(rows.view(np.uint64) < n):  # negative ones are large then
        raise ContractError(f"{field} is {rows.tolist()!r}, expected rows below {n}")


def _require_finite(table: Table, text: str, names: Sequence[str], where: Mask) -> None:
    """Raise `ContractError` unless some columns of a table are finite in some rows, (N,).

    Args:
        table: With the columns.
        text: Format of their names in messages.
        names: Of the columns.
        where: The rows.
    """
    for name in names:
        values = getattr(table, name)
        finite = np.isfinite(values)
        if every(finite):
            continue
        bad = where & ~finite.reshape(len(values), -1).all(axis=1)
        if bad.any():
            row = int(np.argmax(bad))
            what = f"{text.format(name)} of row {row} is {values[row].tolist()!r}"
            raise ContractError(f"{what}, expected numbers")
