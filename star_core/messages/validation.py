"""What the core holds every plugin's answer to, in every tick."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from star_core.errors import ContractError
from star_core.messages.arrays import Rows
from star_core.messages.state import Estimate, Plan, Setpoint
from star_core.messages.telemetry import Telemetry
from star_core.messages.vision import Corrections

Table = TypeVar("Table")


def require_type(answer: object, table: type[Table]) -> Table:
    """Return `answer` if it is a `table`.

    Raises:
        ContractError: It is something else.
    """
    if not isinstance(answer, table):
        raise ContractError(f"returned {type(answer).__name__}, expected {table.__name__}")
    return answer


def expect_rows(table: object, rows: int, agents: int) -> None:
    """Check that a table has one row per agent.

    Raises:
        ContractError: It has another number of rows.
    """
    if rows != agents:
        raise ContractError(
            f"every field of {type(table).__name__} has {rows} row{'s' * (rows != 1)}, "
            f"expected {agents}, one per agent"
        )


def require_methods(part: object, contract: type) -> None:
    """Check that a plugin has the methods of its contract, with the arguments they are called with.

    Raises:
        ContractError: It lacks a method, or one takes other arguments; the message names it.
    """
    if not isinstance(part, contract):
        has = set(dir(part))
        methods = (name for name in vars(contract) if not name.startswith("_"))
        lacking = ", ".join(f"{name}()" for name in methods if name not in has)
        raise ContractError(f"{type(part).__name__} has no {lacking}")
    for name, method in vars(contract).items():
        if not name.startswith("_"):
            _, *arguments = inspect.signature(method).parameters
            accepts(getattr(part, name), name, arguments)


def accepts(
    function: Callable[..., object],
    name: str,
    arguments: Sequence[str],
    options: Mapping[str, object] = MappingProxyType({}),
) -> None:
    """Check that a plugin's function can be called with what the core calls it with.

    Args:
        function: Of the plugin; one whose signature cannot be known passes.
        name: What the contract calls it.
        arguments: Names of its positional arguments.
        options: Its keyword arguments.

    Raises:
        ContractError: It cannot; the message has its signature and its source line.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return
    try:
        signature.bind(*arguments, **options)
    except TypeError as error:
        plain = [p.replace(annotation=p.empty) for p in signature.parameters.values()]
        takes = signature.replace(parameters=plain, return_annotation=signature.empty)
        called = ", ".join((*arguments, *(f"{key}=..." for key in options)))
        code = getattr(function, "__code__", None)
        place = f" ({code.co_filename}:{code.co_firstlineno})" if code else ""
        raise ContractError(
            f"{name}{takes} cannot be called as {name}({called}): {error}{place}"
        ) from error


def checked_estimate(answer: object, n: int) -> Estimate:
    """Return a localizer's answer if it has `n` rows and is finite wherever it says it is valid.

    Raises:
        ContractError: It does not keep the contract.
    """
    estimate = require_type(answer, Estimate)
    expect_rows(estimate, len(estimate.position), n)
    valid = estimate.valid
    _finite("Estimate.position", estimate.position, valid)
    _finite("Estimate.velocity", estimate.velocity, valid)
    _finite("Estimate.yaw", estimate.yaw, valid)
    _finite("Estimate.covariance", estimate.covariance, valid)
    _finite("Estimate.map_from_odom.yaw", estimate.map_from_odom.yaw, valid)
    _finite("Estimate.map_from_odom.translation", estimate.map_from_odom.translation, valid)
    _rows_within("Estimate.sightings.agent", estimate.sightings.agent, n)
    if len(estimate.corrections.agent):
        _corrections(estimate.corrections, n)
    return estimate


def checked_plan(answer: object, n: int) -> Plan:
    """Return a planner's answer if its setpoint has `n` rows and is finite where it is active.

    Raises:
        ContractError: It does not keep the contract.
    """
    plan = require_type(answer, Plan)
    checked_setpoint(plan.setpoint, n)
    _rows_within("Plan.paths.agent", plan.paths.agent, n)
    if not isinstance(plan.reasons, Mapping):
        raise ContractError(f"Plan.reasons is {plan.reasons!r}, expected a map from row to text")
    return plan


def checked_setpoint(answer: object, n: int) -> Setpoint:
    """Return a setpoint if it has `n` rows and is finite where it is active.

    Raises:
        ContractError: It does not keep the contract.
    """
    setpoint = require_type(answer, Setpoint)
    expect_rows(setpoint, len(setpoint.velocity), n)
    _finite("Setpoint.velocity", setpoint.velocity, setpoint.active)
    _finite("Setpoint.yaw", setpoint.yaw, setpoint.active)
    return setpoint


def checked_telemetry(answer: object, n: int) -> Telemetry:
    """Return what a transport reports if it has `n` rows, and a time.

    Raises:
        ContractError: It does not keep the contract.
    """
    telemetry = require_type(answer, Telemetry)
    expect_rows(telemetry, len(telemetry.age), n)
    if not math.isfinite(telemetry.time):
        raise ContractError(f"Telemetry.time is {telemetry.time!r}, expected a number")
    for name in ("odometry", "frames", "detections"):
        _rows_within(f"Telemetry.{name}.agent", getattr(telemetry, name).agent, n)
    return telemetry


def _rows_within(what: str, rows: Rows, n: int) -> None:
    """Hold rows to be those of `n` agents.

    Raises:
        ContractError: One is not.
    """
    if len(rows) and not 0 <= rows.min() <= rows.max() < n:
        raise ContractError(f"{what} is {rows.tolist()!r}, expected rows below {n}")


def _corrections(corrections: Corrections, n: int) -> None:
    _rows_within("Estimate.corrections.agent", corrections.agent, n)
    everywhere = np.ones(len(corrections.agent), np.bool_)
    for name in ("position", "attitude", "position_deviation"):
        _finite(f"Estimate.corrections.{name}", getattr(corrections, name), everywhere)
    about = ~np.isposinf(corrections.attitude_deviation)
    _finite("Estimate.corrections.attitude_deviation", corrections.attitude_deviation, about)


def _finite(what: str, values: np.ndarray, where: np.ndarray) -> None:
    if np.isfinite(values).all():
        return
    bad = where & ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        raise ContractError(f"{what} of row {row} is {values[row].tolist()!r}, expected numbers")
