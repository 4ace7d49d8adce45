"""Rejects estimates that contradict the velocities and the tilt that agents report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from star_core.messages.arrays import Array, Mask
from star_core.messages.rotations import Transform
from star_core.messages.state import Estimate
from star_core.messages.telemetry import Telemetry
from star_core.safety.agents_in_the_way import MAX_REPORT_AGE
from star_core.safety.drag_check import DragCheck
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

GRAVITY: Final = 9.81  # m/s²

DRAG: Final = 0.42
"""Deceleration by the air per speed, 1/s: 0.0135 N s/m of a Crazyflie of 32 g."""

BIAS_TIME: Final = 5.0  # s, in which a constant error of the tilt is learnt
LEARNING_TIME: Final = 1.0  # s in the air before the first verdict

CORRECTION_RATE: Final = 2.0  # 1/s, of a velocity towards that of a Flow deck, in the firmware
MAX_CORRECTION_RATE: Final = 3.0  # 1/s

TILT_RATE: Final = 1.0
"""Correction of the acceleration by the estimated tilt, per correction of the velocity, 1/s: by the
firmware's 0.1 rad/s of gyro noise and 0.5 m/s² of process noise, at 0.8 m."""

FLOW_NOISE: Final = 0.0151
"""Density of the noise of these corrections at 1 m of height, (m/s²)² s: two counts in each sample
of 10 ms, the firmware's `flowStdFixed`, are 0.41 m/s, and `MAX_CORRECTION_RATE` times that."""

MIN_FLOW_HEIGHT: Final = 0.3  # m, below which the noise is taken for that at this height

MIN_EVIDENCE: Final = 12.0
"""Logarithm of the likelihood ratio from which on a flow sensor is taken for stuck. In 400 flights
of an agent without a fault, 6.0 was the most, and in 21 recorded flights of Crazyflies as well."""

MIN_STUCK_TIME: Final = 0.2
"""Time in which the evidence can reach `MIN_EVIDENCE`, s: tilt and velocity of a report that are
not of the same time look like a correction while an agent turns around."""

MIN_STUCK_REPORTS: Final = 4  # likewise

CORRECTED_IN: Final = 0.5  # s, time constant of corrections by the drag

MAX_GAP: Final = 0.2  # s between two reports that are compared
MIN_UPRIGHT: Final = 0.5  # cosine of the greatest tilt of an agent that still flies
TINY: Final = 1e-9

Vectors: TypeAlias = NDArray[np.complex128]


class EstimateMonitor:
    """Rejects estimates that contradict what agents report, so that these agents brake.

    Args:
        scene: Agents and limits.
        localizer: Names the localizer in reports.

    Attributes:
        sees_no_motion: (N,) agents whose tilt contradicts their velocity: their flow sensors are
            stuck.
    """

    def __init__(self, scene: Scene, localizer: str) -> None:
        n = len(scene.agents)
        self.sees_no_motion = np.zeros(n, np.bool_)
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
        tilts = self._motion.check(telemetry, airborne)
        dragged = self._drag.check(telemetry, airborne, tilts)
        self._motion.correct(self._drag.missing)
        self.sees_no_motion = tilts
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


class MotionCheck:
    """Finds agents whose on-board estimate denies the motion that they fly.

    A drone with a Flow deck accelerates by gravity times the tangent of its tilt, less drag. If the
    flow sensor sees no motion (a dark, glossy or uniform floor, a covered lens, a fault), the
    estimator corrects the velocity towards zero all the time: the controller tilts the drone
    further, and it flies away while its estimate hardly moves. The sum of these corrections is the
    innovation that an autopilot such as PX4 checks on board. A Crazyflie does not report it, but it
    is the change of the reported velocity less the acceleration by tilt and drag, and less a
    constant error of the tilt, which is learnt in `BIAS_TIME`. At a velocity ``v`` a stuck sensor
    causes ``-CORRECTION_RATE v`` with the noise of the flow sensor. The logarithm of the likelihood
    ratio of that and of the noise alone adds up while it is positive (the cumulative sum of Page,
    Biometrika 41, 1954). No report counts for more than `MAX_CORRECTION_RATE` explains: a bump is
    no flow sensor. An agent that reports no tilt is not judged. One that was found stays so until
    it takes off again: it lies where it came down, not where it reports to be.

    From where the sum began to rise, the corrections also say by how much velocity and position
    are wrong: ``dw/dt = -c - a - DRAG w`` and ``da/dt = TILT_RATE (c + DRAG w)``, for the
    correction ``c``, the error ``w`` of the velocity, and the acceleration ``a`` by the error of
    the tilt, which the estimator corrects too.

    Args:
        n: Number of agents.
    """

    def __init__(self, n: int) -> None:
        self._time = np.full(n, np.nan)  # s, of the newest report, like the next two
        self._velocity = np.full(n, np.nan, np.complex128)  # m/s; vectors are complex: x + iy
        self._pull = np.full(n, np.nan, np.complex128)  # m/s², by the tilt
        self._bias = np.zeros(n, np.complex128)  # m/s², ahead + i left
        self._learnt = np.zeros(n)  # s
        # Errors in the odometry frame since the evidence was zero: of the velocity, m/s, of the
        # acceleration by tilt, m/s², and of the position, m.
        self._errors = np.zeros((3, n), np.complex128)
        self._evidence = np.zeros(n)  # that the flow sensor is stuck
        self._contradicted = np.zeros(n, np.bool_)
        self._airborne = np.zeros(n, np.bool_)  # in the last check
        self._passed = np.zeros(n)  # s between the reports that were compared last

    def check(self, telemetry: Telemetry, airborne: Mask) -> Mask:
        """Return the agents that fly otherwise than they report: (N,).

        Args:
            telemetry: Of the tick, in odometry frames.
            airborne: (N,) which agents are in the air.
        """
        time = telemetry.time - telemetry.age
        velocity = telemetry.velocity[:, 0] + 1j * telemetry.velocity[:, 1]
        pull = _pull(telemetry.attitude)
        seconds = time - self._time
        with np.errstate(invalid="ignore", divide="ignore"):
            speed, mean = (velocity + self._velocity) / 2, (pull + self._pull) / 2
            unexplained = (velocity - self._velocity) / seconds - mean + DRAG * speed
        known = airborne & (seconds > 0) & (seconds <= MAX_GAP) & np.isfinite(unexplained)
        self._add(known, seconds, unexplained, speed, telemetry)
        newer = ~(seconds <= 0)
        self._time = np.where(newer, time, self._time)
        self._velocity = np.where(newer, velocity, self._velocity)
        self._pull = np.where(newer, pull, self._pull)
        for one in (self._bias, self._learnt, self._evidence, *self._errors[:2]):
            one[~airborne] = 0
        self._contradicted &= ~airborne | self._airborne
        self._errors[2, ~self._contradicted & ~(airborne & self._airborne)] = 0
        self._airborne = airborne
        self._contradicted |= (self._learnt > LEARNING_TIME) & (self._evidence > MIN_EVIDENCE)
        return self._contradicted.copy()

    def correct(self, missing: Vectors) -> None:
        """Correct the errors of the velocities of agents that were found by measured ones.

        Args:
            missing: (N,) true less reported velocity, m/s, in odometry frames; NaN where unknown.
        """
        usable = self._contradicted & np.isfinite(missing)
        gain = np.where(usable, -np.expm1(-self._passed / CORRECTED_IN), 0.0)
        self._errors[0] += gain * (np.where(usable, missing, 0.0) - self._errors[0])

    def errors(self) -> tuple[Array, Array]:
        """Return by how much the motion of agents that were found differs from what they report.

        Returns:
            (N, 3) differences of the positions, m, and (N, 3) of the velocities, m/s, in the
            odometry frames; zero for other agents.
        """
        found = np.where(self._contradicted, self._errors, 0.0)
        level = np.zeros(len(self._learnt))
        return (
            np.stack([found[2].real, found[2].imag, level], axis=1),
            np.stack([found[0].real, found[0].imag, level], axis=1),
        )

    def _add(
        self,
        known: Mask,
        seconds: Array,
        unexplained: Vectors,
        speed: Vectors,
        telemetry: Telemetry,
    ) -> None:
        """Add what happened to the known rows in some seconds."""
        self._passed = dt = np.where(known, seconds, 0.0)
        heading = np.exp(1j * np.where(known, telemetry.heading, 0.0))
        correction = np.where(known, unexplained - self._bias * heading, 0.0)
        square = np.abs(np.where(known, speed, 0.0)) ** 2
        lost = np.fmin(-(correction * speed.conj()).real, MAX_CORRECTION_RATE * square)
        noise = FLOW_NOISE * np.fmax(telemetry.position[:, 2], MIN_FLOW_HEIGHT) ** 2
        rate = CORRECTION_RATE * (lost - CORRECTION_RATE / 2 * square) / noise
        most = np.fmin(dt / MIN_STUCK_TIME, 1 / MIN_STUCK_REPORTS) * MIN_EVIDENCE
        gained = np.where(known, np.fmin(dt * rate, most), 0.0)
        self._evidence = np.maximum(self._evidence + gained, 0.0)
        self._errors[:, (self._evidence == 0) & ~self._contradicted] = 0.0
        faster, tilt, _ = self._errors
        correction += DRAG * faster
        self._errors += dt * np.array([-correction - tilt, TILT_RATE * correction, faster])
        self._learnt += dt
        gain = -np.expm1(-dt / np.clip(self._learnt, dt + TINY, BIAS_TIME))
        learns = known & ~self._contradicted
        self._bias += np.where(learns, gain * (correction - DRAG * faster) / heading, 0.0)


def _pull(attitude: Array) -> Vectors:
    """Return the horizontal acceleration by the thrust of drones that keep their height, m/s².

    It is NaN for drones that fall, and for exactly level ones, which do not report a tilt.

    Args:
        attitude: (N, 4) unit quaternions x, y, z, w from the body to the odometry frame.
    """
    x, y, z, w = attitude.T
    up = 1 - 2 * (x * x + y * y)
    with np.errstate(invalid="ignore"):
        up = np.where((up > MIN_UPRIGHT) & (up < 1), up, np.nan)
        pull: Vectors = 2 * GRAVITY / up * (x * z + w * y + 1j * (y * z - w * x))
    return pull
