"""Rejects estimated positions to which agents cannot have flown, and implausible reports."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from star_core.messages.arrays import Array, Mask, every, frozen
from star_core.messages.rotations import Transform
from star_core.messages.state import Estimate
from star_core.messages.telemetry import Telemetry
from star_core.toolkit.jit import compiled

SPOILED_TIME: Final = 1.0  # s without an implausible report, after which reports are used again

JUMP_MARGIN: Final = 1.5
"""How far positions may move beyond what is explained, m: localizers are sometimes overconfident.
In 30 flights with `method: batch`, the worst localizer here, it was 1.0 m at most."""

UNCORRECTED_MARGIN: Final = 0.5
"""Likewise for an agent whose position has not been corrected in this flight, m: estimates by dead
reckoning do not jump."""

MAX_HEIGHT_JUMP: Final = 0.3
"""Greatest difference in height from the motion that an agent reports, and from the height that it
reports too, m: rangers do not drift, and localizers do not correct heights by that much."""

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
        self._above = np.full(n, np.nan)  # m, height in the map less the reported one
        self._last_time = 0.0  # s, of the last tick, like the next two
        self._last_position = np.full((n, 3), np.nan)
        self._last_velocity = np.full((n, 3), np.nan)  # m/s, reported
        self._accept_all(0.0, *_nothing(), self._frames.yaw)  # compiled before the flight

    def accepts(
        self, estimate: Estimate, telemetry: Telemetry, airborne: Mask, heard: Mask
    ) -> bool:
        """Accept an estimate of which no position is implausible; otherwise `check` decides.

        Args:
            estimate: A localizer's, with map_from_odom finite everywhere.
            telemetry: Of the tick.
            airborne: (N,) which agents are in the air.
            heard: (N,) agents that are heard.
        """
        accepted = self._accept_all(
            float(estimate.time),
            estimate.position,
            estimate.covariance,
            estimate.valid,
            airborne,
            heard,
            telemetry.velocity,
            telemetry.position,
            self._frames.yaw,
        )
        if accepted:
            self._last_time = estimate.time
            frames = estimate.map_from_odom
            if not every(estimate.valid):
                frames = frames.where(estimate.valid, self._frames)
            self._frames = frames
        return accepted

    def _accept_all(self, *tick: Any) -> bool:
        return accept_all(  # type: ignore[call-arg]  # those that it has
            *tick,
            self._speed,
            float(self._last_time),
            self._last_position,
            self._last_velocity,
            self._time,
            self._position,
            self._covariance,
            self._unexplained,
            self._rejected,
            self._corrected,
            self._flown,
            self._range,
            self._still_path,
            self._reports,
            self._spoiled_until,
            self._above,
        )

    def check(
        self,
        estimate: Estimate,
        airborne: Mask,
        reported: Array | None = None,
        heard: Mask | None = None,
        height: Array | None = None,
    ) -> tuple[Estimate, Sequence[Jump]]:
        """Return the estimate without the positions that are rejected, and the new jumps.

        Args:
            estimate: A localizer's, with map_from_odom finite everywhere.
            airborne: (N,) which agents are in the air.
            reported: (N, 3) velocities that the agents report, m/s; None if unknown.
            heard: (N,) agents that are heard: their reports must be plausible. None: no agent.
            height: (N,) that the agents report, m; NaN or None if unknown.
        """
        spoiled = np.zeros(len(airborne), np.bool_)
        if reported is not None and heard is not None:
            spoiled = self._spoiled(estimate.time, reported, heard)
            reported = np.where(spoiled[:, None], np.nan, reported)
        self._fly(estimate.time - self._last_time, reported)
        stuck = self._stuck(estimate, airborne, reported)
        seconds = estimate.time - self._time
        before, now = (
            np.trace(c, axis1=1, axis2=2) for c in (self._covariance, estimate.covariance)
        )
        way = estimate.position - self._position - self._flown
        moved = np.linalg.norm(way, axis=1)
        if height is None:
            height = np.full(len(airborne), np.nan)
        risen = estimate.position[:, 2] - height - self._above
        jumped = (np.abs(way[:, 2]) > MAX_HEIGHT_JUMP) & (np.abs(risen) > MAX_HEIGHT_JUMP)
        explained = self._range + CORRECTION_SIGMAS * np.sqrt(np.fmax(before - now, 0.0))
        carried = self._unexplained * np.exp(-seconds / FORGETTING_TIME)
        unexplained = carried + np.maximum(moved - explained, 0.0)
        corrected = self._corrected | (now < CORRECTED_SHARE * before)
        margin = np.where(corrected, JUMP_MARGIN, UNCORRECTED_MARGIN)
        judged = (airborne | self._rejected) & estimate.valid
        rejected = judged & ((unexplained > margin) | jumped | stuck)  # NaN is not
        accepted = estimate.valid & ~rejected & ~spoiled
        plausible = np.where(stuck, np.nan, explained + margin - carried)
        plausible = np.where(jumped, np.minimum(plausible, MAX_HEIGHT_JUMP), plausible)
        self._above = np.where(accepted, estimate.position[:, 2] - height, self._above)
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
        finite = np.isfinite(speed)
        self._flown = self._flown + seconds * np.where(finite[:, None], velocity, 0.0)
        error = np.where(finite & self._rejected, REPORT_ERROR * speed, self._speed)
        self._range = self._range + seconds * error

    def _stuck(self, estimate: Estimate, airborne: Mask, reported: Array | None) -> Mask:
        """Return whose estimates stay exactly where they are while the agents report flight."""
        seconds, self._last_time = estimate.time - self._last_time, estimate.time
        if reported is None:
            return np.zeros(len(airborne), np.bool_)
        new = (reported != self._last_velocity).any(axis=1)  # one that repeats is an old one
        path = new * seconds * np.linalg.norm(reported, axis=1)
        same = airborne & np.isfinite(path)
        same &= (estimate.position == self._last_position).all(axis=1)
        self._last_position[:], self._last_velocity[:] = estimate.position, reported
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
        finite = np.where(np.isfinite(unexplained), unexplained, 0.0)
        self._unexplained = np.where(accepted, finite, self._unexplained)


def _nothing() -> tuple[Any, ...]:
    """Return an estimate of no agent, of the types that it has in flight."""
    columns = ((3,), np.float64), ((3, 3), np.float64), ((), np.bool_)
    position, covariance, valid = (frozen(np.zeros((0, *row), kind)) for row, kind in columns)
    unheard = np.zeros(0, np.bool_)
    return position, covariance, valid, unheard, unheard, position, position


@compiled
def accept_all(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917 -- the gate's state, in one pass
    time: float,
    position: Array,
    covariance: Array,
    valid: Mask,
    airborne: Mask,
    heard: Mask,
    velocity: Array,
    height: Array,
    yaw: Array,
    top_speed: float,
    last_time: float,
    last_position: Array,
    last_velocity: Array,
    accepted_at: Array,
    accepted: Array,
    accepted_covariance: Array,
    unexplained: Array,
    rejected: Mask,
    corrected: Mask,
    flown: Array,
    reach: Array,
    still_path: Array,
    reports: Mask,
    spoiled_until: Array,
    above: Array,
) -> bool:
    """Accept the estimates of a tick as `EstimateGate.check` does, if none is implausible.

    Each reason for which that rejects a position is one here.

    Args:
        time: Of the estimate, s.
        position: (N, 3) m.
        covariance: (N, 3, 3) m².
        valid: (N,) agents that are located.
        airborne: (N,) agents in the air.
        heard: (N,) agents that are heard.
        velocity: (N, 3) that the agents report, m/s.
        height: (N, 3) positions that they report, m.
        yaw: (N,) of the odometry frames that were accepted last, rad.
        top_speed: Greatest plausible speed, m/s.
        last_time: State of the gate, as all that follow, s.
        last_position: (N, 3) m.
        last_velocity: (N, 3) m/s.
        accepted_at: (N,) s.
        accepted: (N, 3) m.
        accepted_covariance: (N, 3, 3) m².
        unexplained: (N,) m.
        rejected: (N,).
        corrected: (N,).
        flown: (N, 3) m.
        reach: (N,) m.
        still_path: (N,) m.
        reports: (N,).
        spoiled_until: (N,) s.
        above: (N,) m.

    Returns:
        Whether no position is rejected and no report is implausible. If not, nothing is changed.
    """
    n = len(valid)
    seconds = time - last_time
    ways, paths, carried = np.empty((n, 3)), np.empty(n), np.empty(n)
    corrections = np.empty(n, np.bool_)
    for row in range(n):
        vx, vy, vz = velocity[row, 0], velocity[row, 1], velocity[row, 2]
        if not heard[row]:
            vx = vy = vz = math.nan
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        if rejected[row] or time < spoiled_until[row]:
            return False
        if heard[row] and (reports[row] or math.isfinite(speed)) and not speed <= top_speed:
            return False
        ways[row, 0], ways[row, 1], ways[row, 2] = flown[row, 0], flown[row, 1], flown[row, 2]
        if math.isfinite(speed):
            cos, sin = math.cos(yaw[row]), math.sin(yaw[row])
            ways[row, 0] += seconds * (cos * vx - sin * vy)
            ways[row, 1] += seconds * (sin * vx + cos * vy)
            ways[row, 2] += seconds * vz
        same = airborne[row] and math.isfinite(seconds * speed)
        for axis in range(3):
            same = same and position[row, axis] == last_position[row, axis]
        new = (  # a report that repeats is an old one
            vx != last_velocity[row, 0]
            or vy != last_velocity[row, 1]
            or vz != last_velocity[row, 2]
        )
        paths[row] = still_path[row] + (seconds * speed if new else 0.0) if same else 0.0
        dx = position[row, 0] - accepted[row, 0] - ways[row, 0]
        dy = position[row, 1] - accepted[row, 1] - ways[row, 1]
        dz = position[row, 2] - accepted[row, 2] - ways[row, 2]
        before, now = 0.0, 0.0
        for axis in range(3):
            before += accepted_covariance[row, axis, axis]
            now += covariance[row, axis, axis]
        shrunk = before - now if before > now else 0.0
        explained = reach[row] + seconds * top_speed + CORRECTION_SIGMAS * math.sqrt(shrunk)
        excess = math.sqrt(dx * dx + dy * dy + dz * dz) - explained
        carried[row] = unexplained[row] * math.exp((accepted_at[row] - time) / FORGETTING_TIME)
        carried[row] += max(excess, 0.0)
        corrections[row] = corrected[row] or now < CORRECTED_SHARE * before
        risen = position[row, 2] - height[row, 2] - above[row]
        jumped = heard[row] and abs(dz) > MAX_HEIGHT_JUMP and abs(risen) > MAX_HEIGHT_JUMP
        margin = JUMP_MARGIN if corrections[row] else UNCORRECTED_MARGIN
        implausible = carried[row] > margin or jumped or paths[row] > MAX_STILL_PATH
        if airborne[row] and valid[row] and implausible:
            return False
    for row in range(n):
        is_heard = heard[row]
        for axis in range(3):
            last_position[row, axis] = position[row, axis]
            last_velocity[row, axis] = velocity[row, axis] if is_heard else math.nan
        squares = last_velocity[row, 0] + last_velocity[row, 1] + last_velocity[row, 2]
        reports[row] = reports[row] or math.isfinite(squares)
        still_path[row] = paths[row]
        if not valid[row]:
            reach[row] += seconds * top_speed
            for axis in range(3):
                flown[row, axis] = ways[row, axis]
            continue
        corrected[row] = corrections[row]
        accepted_at[row], reach[row] = time, 0.0
        keeps = airborne[row] and math.isfinite(carried[row])
        unexplained[row] = carried[row] if keeps else 0.0
        above[row] = position[row, 2] - height[row, 2] if is_heard else math.nan
        for axis in range(3):
            flown[row, axis] = 0.0
            accepted[row, axis] = position[row, axis]
            for other in range(3):
                accepted_covariance[row, axis, other] = covariance[row, axis, other]
    return True
