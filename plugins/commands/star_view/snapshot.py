"""What the page shows of a swarm at one moment, from a tick or from a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from star_core import AgentPhase, Array, Rows, Run, Tick
from star_core.toolkit import shortlist
from star_view.markdown import escaped

PURSUING: Final = (AgentPhase.TAKING_OFF, AgentPhase.FLYING)
"""Phases in which agents fly to their goals."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State of N agents at one moment, in the map. NaN is "unknown" or "none".

    Attributes:
        time: Mission time, s.
        position: (N, 3) m: ground truth where there is one, else the estimate.
        attitude: (N, 4) quaternion x, y, z, w, body to map; without ground truth that of a level
            agent with the estimated yaw.
        estimate: (N, 3) estimated position, m.
        yaw: (N,) estimated yaw, rad.
        covariance: (N, 3, 3) of the estimated position, m².
        phase: (N,) `AgentPhase`.
        battery: (N,) V.
        goal: (N, 3) of agents in the phases `PURSUING`, m.
        velocity: (N, 3) commanded velocity, m/s.
        path: Of these agents the points, (K, 3), of the rest of their planned paths, m.
        trail: (M, N, 3) latest positions, m.
        doing: The running steps.
        simulated: Whether `position` is ground truth.
    """

    time: float
    position: Array
    attitude: Array
    estimate: Array
    yaw: Array
    covariance: Array
    phase: Rows
    battery: Array
    goal: Array
    velocity: Array
    path: Sequence[Array]
    trail: Array
    doing: str
    simulated: bool

    @classmethod
    def of_tick(cls, tick: Tick) -> Self:
        """Return the state after a tick, with a trail of one point."""
        estimate, truth = tick.estimate, tick.truth
        position = estimate.position if truth is None else truth.position
        attitude = _level(estimate.yaw)
        if truth is not None:
            attitude = np.where(np.isfinite(truth.attitude), truth.attitude, attitude)
        goals, sent, paths = tick.goals, tick.sent, tick.plan.paths
        pursuing = np.isin(tick.health.phase, PURSUING)
        return cls(
            time=tick.time,
            position=position,
            attitude=attitude,
            estimate=estimate.position,
            yaw=estimate.yaw,
            covariance=estimate.covariance,
            phase=tick.health.phase,
            battery=tick.health.battery,
            goal=np.where((goals.active & pursuing)[:, None], goals.position, np.nan),
            velocity=np.where(sent.active[:, None], sent.velocity, np.nan),
            path=[paths.of(row)[: None if on else 0] for row, on in enumerate(pursuing)],
            trail=position[None],
            doing=tick.doing,
            simulated=truth is not None,
        )

    def states(self, names: Sequence[str]) -> str:
        """Return phase, height and battery of each agent as a table in Markdown."""
        rows = ["| agent | phase | z (m) | battery (V) |", "|:---|:---|:---|:---|"]
        for name, phase, position, battery in zip(
            names, self.phase.tolist(), self.position, self.battery, strict=True
        ):
            words = AgentPhase(int(phase)).name.lower().replace("_", " ")
            numbers = (
                f"{value:.2f}" if np.isfinite(value) else "" for value in (position[2], battery)
            )
            rows.append(f"| {escaped(name)} | {words} | {' | '.join(numbers)} |")
        return "\n".join(rows)


def of_record(run: Run, tick: int, trail_duration: float) -> Snapshot:
    """Return the state at a tick of a record, with the trail of the last few seconds."""
    arrays = run.arrays
    time, estimate, yaw = arrays["time"], arrays["estimate_position"], arrays["estimate_yaw"]
    position = arrays.get("truth_position", estimate)
    level = _level(yaw[tick])
    std = arrays.get("estimate_position_std", np.full(estimate.shape, np.nan))[tick]
    pursuing = np.isin(arrays["phase"][tick], PURSUING)
    active, sent = arrays["goal_active"][tick] & pursuing, arrays["setpoint_active"][tick, :, None]
    begin = int(np.searchsorted(time, time[tick] - trail_duration))
    return Snapshot(
        time=float(time[tick]),
        position=position[tick],
        attitude=arrays["truth_attitude"][tick] if "truth_attitude" in arrays else level,
        estimate=estimate[tick],
        yaw=yaw[tick],
        covariance=std[:, :, None] ** 2 * np.eye(3),
        phase=arrays["phase"][tick].astype(np.int64),
        battery=arrays["battery"][tick],
        goal=np.where(active[:, None], arrays["goal_position"][tick], np.nan),
        velocity=np.where(sent, arrays["setpoint_velocity"][tick], np.nan),
        path=[_planned(run, row, tick, pursues=on) for row, on in enumerate(pursuing.tolist())],
        trail=position[begin : tick + 1],
        doing=_doing(run, float(time[tick])),
        simulated="truth_position" in arrays,
    )


def _planned(run: Run, row: int, tick: int, *, pursues: bool) -> Array:
    """Return the rest of an agent's planned path at a tick, (K, 3) m."""
    [number] = run.paths.current(row, run.arrays["time"][[tick]])
    if number < 0 or not pursues:
        return np.zeros((0, 3))
    position = run.arrays["estimate_position"][tick, row]
    return np.vstack([position, run.paths.points(number)])


def _doing(run: Run, moment: float) -> str:
    """Return the steps that are executed at a mission time."""
    current = (
        f"{step['verb']} {shortlist(step['agents'])}"
        for step in run.summary["steps"]
        if step["begun_s"] <= moment and (step["ended_s"] is None or moment < step["ended_s"])
    )
    return shortlist(current)


def _level(yaw: Array) -> Array:
    """Return level attitudes (..., 4) with the headings (...,), rad."""
    level = np.zeros((*yaw.shape, 4))
    level[..., 2], level[..., 3] = np.sin(yaw / 2), np.cos(yaw / 2)
    return level
