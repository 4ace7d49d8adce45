"""Rejects estimates that contradict the velocities and the tilt that agents report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.rotations import Transform
from star_core.messages.state import Estimate
from star_core.messages.telemetry import Telemetry
from star_core.safety.agents_in_the_way import MAX_REPORT_AGE
from star_core.safety.drag_check import DragCheck
from star_core.safety.motion_check import MotionCheck
from star_core.scene import Scene

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


class EstimateMonitor:
    """Rejects estimates that contradict what agents report, so that these agents brake.

    Args:
        scene: Agents and limits.
        localizer: Names the localizer in reports.
    """

    def __init__(self, scene: Scene, localizer: str) -> None:
        n = len(scene.agents)
        self._names = scene.names
        self._localizer = localizer
        self._gate = EstimateGate(n, scene.limits.speed)
        self._motion = MotionCheck(n)
        self._drag = DragCheck(n)
        self._contradicted = np.zeros(n, np.bool_)
        self._frames = Transform(  # last known
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents]),
        )

    def check(
        self, estimate: Estimate, telemetry: Telemetry, airborne: Mask
    ) -> tuple[Estimate, list[tuple[str, str]]]:
        """Return the estimate without implausible positions and motions, and reports of new ones.

        Agents whose frames are not finite have the last known ones.

        Args:
            estimate: A localizer's.
            telemetry: Of the tick.
            airborne: (N,) which agents are in the air.

        Returns:
            The estimate, and a name and a text for each agent that brakes from now on.
        """
        known = estimate.map_from_odom.known
        if not known.all():
            frames = estimate.map_from_odom.where(known, self._frames)
            estimate = replace(estimate, map_from_odom=frames)
        self._frames = estimate.map_from_odom
        heard = telemetry.age <= MAX_REPORT_AGE
        reported = np.where(heard[:, None], telemetry.velocity, np.nan)
        height = np.where(heard, telemetry.position[:, 2], np.nan)
        accepted, jumps = self._gate.check(estimate, airborne, reported, heard, height)
        reports = [(self._names[jump.row], self._of_jump(jump)) for jump in jumps]
        tilts, dragged = (one.check(telemetry, airborne) for one in (self._motion, self._drag))
        contradicted = tilts | dragged
        for row in np.flatnonzero(contradicted & ~self._contradicted).tolist():
            by = "tilt" if tilts[row] else "drag"
            text = f"{self._names[row]} brakes: it flies faster than it reports, by its {by}"
            reports.append((self._names[row], f"{text}; does its flow sensor see the floor?"))
        self._contradicted = contradicted
        if not contradicted.any():
            return accepted, reports
        away, faster = map(accepted.map_from_odom.turn, self._errors())
        return replace(
            accepted,
            position=accepted.position + away,
            velocity=accepted.velocity + faster,
            valid=accepted.valid & ~contradicted,
        ), reports

    def rest_velocity(self, map_from_odom: Transform) -> Array:
        """Return the velocities, (N, 3) m/s in the map, at which agents are at rest.

        They are zero but for agents whose reports deny a part of their motion.
        """
        _, faster = self._motion.errors()
        return 0.0 - map_from_odom.turn(faster)

    def _errors(self) -> tuple[Array, Array]:
        """Return the differences of (N, 3) positions, m, and velocities, m/s, from the reports."""
        by_tilt, by_drag = self._motion.errors(), self._drag.errors()
        return by_tilt[0] + by_drag[0], by_tilt[1] + by_drag[1]

    def _of_jump(self, jump: Jump) -> str:
        moved = (
            f"moved {jump.distance:.2f} m in {jump.seconds:.2f} s, expected at most "
            f"{jump.plausible:.2f} m"
        )
        if np.isnan(jump.plausible):
            moved = f"did not change while it reported {jump.distance:.2f} m of flight,"
        name = self._names[jump.row]
        return f"{name} brakes: its estimated position {moved} from {self._localizer}"


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
        self._seen = 0.0, self._position, self._position  # time, positions, velocities reported

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
        self._fly(estimate.time - self._seen[0], reported)
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
