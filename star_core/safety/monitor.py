"""Monitors agents: safety rules, implausible estimates, agents that are not heard."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows
from star_core.messages.rotations import Transform
from star_core.messages.state import AgentPhase, Estimate, Health
from star_core.scene import Limits, Scene

BATTERY_SAG_TIME: Final = 1.0  # s that a battery must stay below its limit: it sags under load
SUNK_TIME: Final = 2.0  # s that a flying agent must stay at the floor: some rebound
FLOOR_SHARE: Final = 0.5  # of the lowest height to fly at: below it is the floor


class SafetyAction(IntEnum):
    """What a rule does with an agent, from the mildest to the most severe."""

    NOTHING = 0
    HOLD = 1
    LAND = 2
    STOP = 3


class Verdict(NamedTuple):
    """The action for an agent from now on, and the reason."""

    row: int
    action: SafetyAction
    reason: str


class Rules:
    """Applies the rules to every agent. An action is never undone; a more severe one replaces it.

    Args:
        scene: Agents and fence.
        rules: The mission's ``safety`` with defaults: by rule its numbers and its action.

    Attributes:
        action: (N,) `SafetyAction` for each agent so far.
    """

    def __init__(self, scene: Scene, rules: Mapping[str, Mapping[str, Any]]) -> None:
        n = len(scene.agents)
        self._low = np.array(scene.world.fence.low)
        self._high = np.array(scene.world.fence.high)
        self._floor = FLOOR_SHARE * scene.limits.height[0]
        self._rules = rules
        self._since = {name: np.full(n, np.nan) for name in self._rules}  # s, of each violation
        self.action = np.zeros(n, np.int64)

    def judge(self, time: float, estimate: Estimate, health: Health) -> list[Verdict]:
        """Return the new verdicts at a mission time, s."""
        new = []
        for name, rule in self._rules.items():
            violated, duration, reasons = self._violations(name, rule, estimate, health)
            since = np.where(violated, np.fmin(self._since[name], time), np.nan)
            self._since[name] = since
            fires = violated & (time - since >= duration)
            action = SafetyAction[rule["then"].upper()]
            for row in np.flatnonzero(fires & (self.action < action)).tolist():
                self.action[row] = action
                new.append(Verdict(row, action, f"{name}: {reasons[row]}"))
        return new

    def reset(self, row: int) -> None:
        """Cancel the action for an agent that is fit again."""
        self.action[row] = SafetyAction.NOTHING

    def excuse(self, health: Health, located: Mask) -> Mask:
        """(N,) agents that are lost, but that a rule will act on: their steps do not fail yet."""
        heard = health.age <= MAX_REPORT_AGE
        excused = np.zeros(len(heard), np.bool_)
        lost = health.phase == AgentPhase.LOST
        if "link_lost" in self._rules:
            excused |= lost & ~heard
        if "position_lost" in self._rules:
            excused |= lost & heard & ~located
        return excused

    def _violations(
        self, name: str, rule: Mapping[str, Any], estimate: Estimate, health: Health
    ) -> tuple[Mask, float | Array, list[str]]:
        """Return which agents violate a rule, how long they must to trigger it, s, and why."""
        phase = health.phase
        flies = (phase == AgentPhase.FLYING) | (phase == AgentPhase.LOST)
        match name:
            case "battery_low":
                reasons = [f"battery at {voltage:.2f} V" for voltage in health.battery]
                return health.battery < rule["below"], BATTERY_SAG_TIME, reasons
            case "link_lost":
                reasons = [f"not heard for {age:.1f} s" for age in health.age]
                return health.age >= rule["after"], 0.0, reasons
            case "position_lost":
                reasons = [f"not located for {rule['after']:g} s"] * len(phase)
                heard = health.age <= MAX_REPORT_AGE
                return flies & heard & ~estimate.valid, rule["after"], reasons
            case "fence_near":
                position = estimate.position
                room = np.minimum(self._high - position, position - self._low).min(axis=1)
                reasons = [f"{max(0.0, distance):.2f} m from the fence" for distance in room]
                return flies & estimate.valid & (room <= rule["within"]), 0.0, reasons
        fallen = phase == AgentPhase.EMERGENCY
        low = (phase == AgentPhase.FLYING) & (estimate.position[:, 2] < self._floor)
        sunk = ~fallen & low & estimate.valid & (health.age <= MAX_REPORT_AGE)
        tumbled, lies = "tumbled, crashed, locked or rebooted", "sank to the floor"
        reasons = [lies if one else tumbled for one in sunk]
        return fallen | sunk, np.where(sunk, SUNK_TIME, 0.0), reasons


SPOILED_TIME: Final = 1.0  # s without an implausible report, after which reports are used again

JUMP_MARGIN: Final = 1.5
"""How far positions may move beyond what is explained, m: localizers are sometimes overconfident.
In 30 flights with `method: batch`, the worst localizer here, it was 1.0 m at most."""

UNCORRECTED_MARGIN: Final = 0.5
"""Likewise for an agent whose position has not been corrected in this flight, m: estimates by dead
reckoning do not jump."""

CORRECTED_SHARE: Final = 0.95
"""Ratio of the variances after and before a tick below which the position was corrected. While an
agent flies back to its start, that of dead reckoning shrinks by some per mille."""

MAX_STILL_PATH: Final = 0.3
"""Greatest path that an agent may report while its estimated position does not change at all, m."""

FORGETTING_TIME: Final = 5.0  # s, time constant with which unexplained movement is forgotten
CORRECTION_SIGMAS: Final = 4.0  # standard deviations by which a position may be corrected
SPEED_RATIO: Final = 2.0  # greatest plausible speed over the limit: overshoot, gusts, descents
REPORT_ERROR: Final = 0.3  # greatest error of a reported velocity, relative to it
MIN_PLAUSIBLE_SPEED: Final = 3.0  # m/s, whatever the limit: on-board trajectories, falls

MAX_REPORT_AGE: Final = 0.5
"""An agent whose newest report is older than this is not heard, s: the firmware's own limit for
setpoints, after which it levels out."""

WATCHDOG_TIME: Final = 2.0
"""How long an agent that hears nothing keeps its velocity, s, before its firmware stops the
motors (the commander's watchdog)."""

FALL_TIME: Final = 1.0  # s; from 3 m it is 0.8 s
BRAKING_TIME: Final = 0.6  # s, by which the velocity of an agent that brakes leads it on


@dataclass(frozen=True, slots=True)
class Jump:
    """A position that was rejected after one that was accepted.

    Attributes:
        row: Of the agent.
        distance: From the last position that was accepted, m.
        seconds: Time since then, s.
        plausible: Greatest distance that would have been accepted, m; NaN if the estimate has not
            moved at all while the agent reported that it flew `distance`.
    """

    row: int
    distance: float
    seconds: float
    plausible: float


class EstimateGate:
    """Compares each estimated position with the last one that was accepted.

    In the time between the two an agent can have flown some distance, and a localizer can have
    corrected it by as much as the covariance shrank: the covariance of a correction is that of the
    estimate before less that of the estimate after it (Kalman). Movement beyond that adds up over
    ticks, and is forgotten in `FORGETTING_TIME`; many small jumps are a large one. A position with
    which it exceeds `JUMP_MARGIN`, or `UNCORRECTED_MARGIN` for an agent whose covariance no
    correction has shrunk so far, is rejected: the row keeps its last position, at rest and not
    valid, so that the agent brakes. It is compared again in the next tick, with the last position
    that was accepted moved on by the velocities that the agent has reported since then: a jump that
    lasts does not become plausible with time. A position that is the same, to the last bit, while
    the agent reports that it flies `MAX_STILL_PATH` is rejected too: its localizer is stuck. On the
    ground every position is accepted, except that of an agent that was rejected in flight: it came
    down near its last position, not at the wrong one.

    An agent that reports a velocity that is not finite, or that it cannot fly, is not located, on
    the ground either, until its reports have been plausible for `SPOILED_TIME`: random ones are
    plausible once in a while.

    Args:
        n: Number of agents.
        speed: The mission's speed limit, m/s.
    """

    def __init__(self, n: int, speed: float) -> None:
        self._speed = max(SPEED_RATIO * speed, MIN_PLAUSIBLE_SPEED)
        self._time = np.zeros(n)  # s, of the last position that was accepted
        self._position = np.full((n, 3), np.nan)
        self._covariance = np.zeros((n, 3, 3))
        self._frames = Transform(np.zeros(n), np.zeros((n, 3)))
        self._unexplained = np.zeros(n)  # m, recently
        self._rejected = np.zeros(n, np.bool_)
        self._corrected = np.zeros(n, np.bool_)  # agents whose positions have been corrected
        self._flown = np.zeros((n, 3))  # m, since then, by the reported velocities
        self._range = np.zeros(n)  # m, that the agents can have flown since then besides
        self._still_path = np.zeros(n)  # m, that agents report since their estimates last moved
        self._reports = np.zeros(n, np.bool_)  # agents that have reported velocities
        self._spoiled_until = np.full(n, -np.inf)  # s
        self._seen = 0.0, self._position, self._position  # time, positions, velocities reported

    def check(
        self,
        estimate: Estimate,
        airborne: Mask,
        reported: Array | None = None,
        heard: Mask | None = None,
    ) -> tuple[Estimate, Sequence[Jump]]:
        """Return the estimate without the positions that are rejected, and the new jumps.

        Args:
            estimate: A localizer's, with map_from_odom finite everywhere.
            airborne: (N,) which agents are in the air.
            reported: (N, 3) velocities that the agents report, m/s; None if unknown.
            heard: (N,) agents that are heard: their reports must be plausible. None: no agent.
        """
        spoiled = np.zeros(len(airborne), np.bool_)
        if reported is not None and heard is not None:
            spoiled = self._spoiled(estimate.time, reported, heard)
            reported = np.where(spoiled[:, None], np.nan, reported)
        self._fly(estimate.time - self._seen[0], reported)
        stuck = self._stuck(estimate, airborne, reported)
        seconds = estimate.time - self._time
        before, now = (
            np.trace(c, axis1=1, axis2=2) for c in (self._covariance, estimate.covariance)
        )
        moved = np.linalg.norm(estimate.position - self._position - self._flown, axis=1)
        explained = self._range + CORRECTION_SIGMAS * np.sqrt(np.fmax(before - now, 0.0))
        carried = self._unexplained * np.exp(-seconds / FORGETTING_TIME)
        unexplained = carried + np.maximum(moved - explained, 0.0)
        corrected = self._corrected | (now < CORRECTED_SHARE * before)
        margin = np.where(corrected, JUMP_MARGIN, UNCORRECTED_MARGIN)
        judged = (airborne | self._rejected) & estimate.valid
        rejected = judged & ((unexplained > margin) | stuck)  # NaN is not
        accepted = estimate.valid & ~rejected & ~spoiled
        plausible = np.where(stuck, np.nan, explained + margin - carried)
        moved = np.where(stuck, self._still_path, moved)
        jumps = [
            Jump(row, float(moved[row]), float(seconds[row]), float(plausible[row]))
            for row in np.flatnonzero(rejected & ~self._rejected).tolist()
        ]
        self._corrected |= corrected & accepted
        self._rejected = rejected | (self._rejected & ~accepted)
        self._store(estimate, accepted, np.where(judged, unexplained, 0.0))
        rejected |= spoiled & np.isfinite(self._position).all(axis=1)
        if not rejected.any():
            return estimate, jumps
        column = rejected[:, None]
        return replace(
            estimate,
            position=np.where(column, self._position, estimate.position),
            velocity=np.where(column, 0.0, estimate.velocity),
            covariance=np.where(column[..., None], self._covariance, estimate.covariance),
            valid=accepted,
            map_from_odom=self._frames.where(rejected, estimate.map_from_odom),
        ), jumps

    def _spoiled(self, time: float, reported: Array, heard: Mask) -> Mask:
        """Return which agents report what is implausible, or did within `SPOILED_TIME`: (N,)."""
        speed = np.linalg.norm(reported, axis=1)
        self._reports |= np.isfinite(speed)  # NaN before the first one: not reported at all
        bad = heard & self._reports & ~(speed <= self._speed)
        self._spoiled_until = np.where(bad, time + SPOILED_TIME, self._spoiled_until)
        spoiled: Mask = time < self._spoiled_until
        return spoiled

    def _fly(self, seconds: float, reported: Array | None) -> None:
        """Move the last positions by the reported velocities, and extend what is reachable.

        A rejected row can be elsewhere only by the error of its reports; any other row, as before,
        by the greatest plausible speed.
        """
        velocity = np.full((len(self._range), 3), np.nan) if reported is None else reported
        velocity = self._frames.turn(velocity)
        speed = np.linalg.norm(velocity, axis=1)
        known = np.isfinite(speed)
        self._flown = self._flown + seconds * np.where(known[:, None], velocity, 0.0)
        error = np.where(known & self._rejected, REPORT_ERROR * speed, self._speed)
        self._range = self._range + seconds * error

    def _stuck(self, estimate: Estimate, airborne: Mask, reported: Array | None) -> Mask:
        """Return whose estimates stay exactly where they are while the agents report flight."""
        if reported is None:
            self._seen = estimate.time, *self._seen[1:]
            return np.zeros(len(airborne), np.bool_)
        (time, position, velocity), self._seen = (
            self._seen,
            (estimate.time, estimate.position, reported),
        )
        new = (reported != velocity).any(axis=1)  # a report that repeats is an old one
        path = new * (estimate.time - time) * np.linalg.norm(reported, axis=1)
        same = airborne & np.isfinite(path) & (estimate.position == position).all(axis=1)
        self._still_path = np.where(same, self._still_path + path, 0.0)
        return self._still_path > MAX_STILL_PATH

    def _store(self, estimate: Estimate, accepted: Mask, unexplained: Array) -> None:
        """Keep the accepted rows for the next comparison."""
        column = accepted[:, None]
        self._time = np.where(accepted, estimate.time, self._time)
        self._flown = np.where(column, 0.0, self._flown)
        self._range = np.where(accepted, 0.0, self._range)
        self._position = np.where(column, estimate.position, self._position)
        self._covariance = np.where(column[..., None], estimate.covariance, self._covariance)
        self._frames = estimate.map_from_odom.where(accepted, self._frames)
        known = np.where(np.isfinite(unexplained), unexplained, 0.0)
        self._unexplained = np.where(accepted, known, self._unexplained)


class GroundedAgents:
    """Marks the agents that stay on the ground until the end of the flight.

    They fell, or landed and do not return to the mission. Their motors are off, and downwash does
    not disturb them: they are marked so far below the ground that agents above
    keep `Limits.separation` rather than `Limits.vertical_separation`. Agents that may take off
    keep their heights.

    Args:
        n: Number of agents.
        limits: The separations.
    """

    def __init__(self, n: int, limits: Limits) -> None:
        self._depth = _depth(limits)
        self._fallen_at = np.full(n, np.inf)  # s

    def mark(self, estimate: Estimate, phase: Rows, gone: Mask) -> Estimate:
        """Return the estimate with these agents below the ground.

        Args:
            estimate: Of the tick.
            phase: (N,) `AgentPhase` of each agent.
            gone: (N,) agents that have left the mission for good.
        """
        fallen = phase == AgentPhase.EMERGENCY
        since = np.fmin(self._fallen_at, estimate.time)
        self._fallen_at = np.where(fallen, since, np.inf)
        down = (phase == AgentPhase.LANDED) & gone
        down |= estimate.time - self._fallen_at >= FALL_TIME
        if not down.any():
            return estimate
        position, travel = estimate.position.copy(), estimate.possible_travel.copy()
        position[down, 2], travel[down, 2] = -self._depth, 0.0
        return replace(estimate, position=position, possible_travel=travel)


def _depth(limits: Limits) -> float:
    """Return how far below the ground agents are marked above which others may fly lower, m."""
    spare = limits.vertical_separation - limits.separation
    return max(0.0, spare) if limits.separation > 0 else 0.0


class UnheardAgents:
    """Marks the agents that are not heard, which may fly on, and those that are not located.

    A drone whose reports are lost may have braked, landed or crashed where it was last heard; one
    that hears no setpoints either keeps its last velocity until its watchdog stops the motors. The
    estimate has such an agent at rest where it was last heard, with a
    `star_core.Estimate.possible_travel` of `WATCHDOG_TIME` at its last velocity. Once it has fallen
    or landed in any case, all of this is on the ground. Its motors are off then, and downwash does
    not disturb it: it is marked so far below the ground that agents above keep `Limits.separation`
    rather than `Limits.vertical_separation`.

    An agent that is heard but no longer located in flight brakes, by `BRAKING_TIME` at its last
    velocity. It stays at all of these positions, also on the ground, until it is located.

    Args:
        n: Number of agents.
        limits: The separations.
    """

    def __init__(self, n: int, limits: Limits) -> None:
        self._depth = _depth(limits)
        self._astray = np.zeros(n, np.bool_)  # heard, but not located since they were in the air
        self._velocity: Array = np.zeros((n, 3))  # m/s, when last heard and located
        self._down_by = np.full(n, np.inf)  # s, mission time

    def steered(self, time: float, rows: Mask | Rows) -> None:
        """Note that setpoints were sent to agents: without another one their motors stop."""
        self._down_by[rows] = time + WATCHDOG_TIME + FALL_TIME

    def flies_on_board(self, rows: Rows) -> None:
        """Note that agents fly a command, after which they hover until they hear another one."""
        self._down_by[rows] = np.inf

    def lands(self, rows: Rows, until: Array, heard: Mask) -> None:
        """Note that agents were commanded to land or to stop.

        Args:
            rows: (K,) the agents.
            until: (K,) mission times at which they are down, s, if they receive the command.
            heard: (K,) which of them certainly do. The others stop for want of setpoints, if
                these flew them.
        """
        self._down_by[rows] = np.where(heard, until, np.maximum(until, self._down_by[rows]))

    def mark(self, estimate: Estimate, age: Array, airborne: Mask) -> Estimate:
        """Return the estimate with the agents marked that are not heard or not located.

        Args:
            estimate: Of the tick.
            age: (N,) age of each agent's newest report, s.
            airborne: (N,) agents that are in the air.
        """
        heard = age <= MAX_REPORT_AGE
        known = heard & estimate.valid & np.isfinite(estimate.velocity).all(axis=1)
        self._velocity = np.where(known[:, None], estimate.velocity, self._velocity)
        self._astray = heard & ~estimate.valid & (airborne | self._astray)
        if heard.all() and not self._astray.any():
            return estimate
        down = ~heard & (estimate.time >= self._down_by)
        position = estimate.position.copy()
        flies_on = np.where(self._astray, BRAKING_TIME, np.where(heard, 0.0, WATCHDOG_TIME))
        travel = flies_on[:, None] * self._velocity
        position[down, 2], travel[down, 2] = -self._depth, 0.0
        return replace(
            estimate,
            position=position,
            velocity=np.where(heard[:, None], estimate.velocity, 0.0),
            possible_travel=travel,
        )
