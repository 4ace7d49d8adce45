"""Finds agents whose on-board estimates deny the motion that they fly: stuck flow sensors."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from star_core import Array, Mask, Telemetry
from star_core.toolkit import compiled, frozen, records, some
from star_monitors.drag_check import DRAG

GRAVITY: Final = 9.81  # m/s²

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

STATE: Final = np.dtype(
    [
        ("time", "f8"),  # s, of the newest report, like the next two
        ("velocity", "f8", 2),  # m/s
        ("pull", "f8", 2),  # m/s², by the tilt
        ("bias", "f8", 2),  # m/s², ahead and left
        ("learnt", "f8"),  # s
        # Errors in the odometry frame since the evidence was zero: of the velocity, m/s, of the
        # acceleration by tilt, m/s², and of the position, m.
        ("errors", "f8", (3, 2)),
        ("evidence", "f8"),  # that the flow sensor is stuck
        ("contradicted", "?"),
        ("airborne", "?"),  # in the last check
        ("passed", "f8"),  # s between the reports that are compared; 0 where none are
    ],
    align=True,
)


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

    From where the sum began to rise, the corrections also show by how much velocity and position
    are wrong: ``dw/dt = -c - a - DRAG w`` and ``da/dt = TILT_RATE (c + DRAG w)``, for the
    correction ``c``, the error ``w`` of the velocity, and the acceleration ``a`` by the error of
    the tilt, which the estimator corrects too.
    """

    def __init__(self, n: int) -> None:
        self._state = records(n, STATE)
        for name in ("time", "velocity", "pull"):
            self._state[name] = np.nan
        age, motion, attitude = (frozen(np.zeros((0, *row))) for row in ((), (3,), (4,)))
        no_agent = np.zeros(0, np.bool_)
        compare(0.0, age, motion, motion, attitude, no_agent, self._state)  # compiled before flight

    def check(self, telemetry: Telemetry, airborne: Mask) -> Mask:
        """Return the agents that fly otherwise than they report: (N,).

        Args:
            telemetry: Of the tick, in odometry frames.
            airborne: (N,) which agents are in the air.
        """
        compare(
            float(telemetry.time),
            telemetry.age,
            telemetry.position,
            telemetry.velocity,
            telemetry.attitude,
            airborne,
            self._state,
        )
        return self._state["contradicted"].copy()

    def correct(self, missing: Array) -> None:
        """Correct the errors of agents that were found by measured ones of the velocities.

        What the velocity does not explain corrects the acceleration by tilt (Luenberger observer).

        Args:
            missing: (N, 2) true less reported velocity, m/s, in odometry frames; NaN where unknown.
        """
        if not some(self._state["contradicted"]):
            return
        usable = self._state["contradicted"] & np.isfinite(missing).all(axis=1)
        gain = np.where(usable, -np.expm1(-self._state["passed"] / CORRECTED_IN), 0.0)[:, None]
        errors = self._state["errors"]
        difference = gain * (np.where(usable[:, None], missing, 0.0) - errors[:, 0])
        errors[:, 0] += 2 * difference  # critically damped
        errors[:, 1] -= difference / CORRECTED_IN

    def errors(self) -> tuple[Array, Array]:
        """Return by how much the motion of agents that were found differs from what they report.

        Returns:
            (N, 3) differences of the positions, m, and (N, 3) of the velocities, m/s, in the
            odometry frames; zero for other agents.
        """
        contradicted = self._state["contradicted"][:, None, None]
        errors = np.where(contradicted, self._state["errors"], 0.0)
        level = np.zeros((len(errors), 1))
        return np.hstack([errors[:, 2], level]), np.hstack([errors[:, 0], level])


@compiled
def compare(  # noqa: C901, PLR0915 -- the state of `MotionCheck`, one pass
    time: float,
    age: Array,
    position: Array,
    velocity: Array,
    attitude: Array,
    airborne: Mask,
    state: Any,
) -> None:
    """Add what the reports of a tick show to the state of `MotionCheck`.

    Args:
        time: Mission time, s.
        age: (N,) of the reports, s.
        position: (N, 3) m.
        velocity: (N, 3) m/s.
        attitude: (N, 4) unit quaternions x, y, z, w from the body to the odometry frame.
        airborne: (N,) agents in the air.
        state: (N,) records of `STATE`, changed in place.
    """
    for row in range(len(age)):
        agent = state[row]
        seconds = time - age[row] - agent.time
        x, y, z, w = attitude[row, 0], attitude[row, 1], attitude[row, 2], attitude[row, 3]
        up = 1 - 2 * (x * x + y * y)
        pull_x = pull_y = math.nan  # of drones that fall, and of level ones: no tilt is reported
        if MIN_UPRIGHT < up < 1:
            pull_x = 2 * GRAVITY / up * (x * z + w * y)  # of drones that keep their height
            pull_y = 2 * GRAVITY / up * (y * z - w * x)
        fast_x = (velocity[row, 0] + agent.velocity[0]) / 2
        fast_y = (velocity[row, 1] + agent.velocity[1]) / 2
        gain_x = (velocity[row, 0] - agent.velocity[0]) / seconds
        gain_y = (velocity[row, 1] - agent.velocity[1]) / seconds
        unexplained_x = gain_x - (pull_x + agent.pull[0]) / 2 + DRAG * fast_x
        unexplained_y = gain_y - (pull_y + agent.pull[1]) / 2 + DRAG * fast_y
        usable = airborne[row] and 0 < seconds <= MAX_GAP
        usable = usable and math.isfinite(unexplained_x) and math.isfinite(unexplained_y)
        dt = cx = cy = 0.0  # s; correction of the velocity, m/s²
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) if usable else 0.0
        cos, sin = math.cos(yaw), math.sin(yaw)
        if usable:
            dt = seconds
            cx = unexplained_x - (agent.bias[0] * cos - agent.bias[1] * sin)
            cy = unexplained_y - (agent.bias[0] * sin + agent.bias[1] * cos)
            square = fast_x * fast_x + fast_y * fast_y
            lost = min(-(cx * fast_x + cy * fast_y), MAX_CORRECTION_RATE * square)
            height = max(MIN_FLOW_HEIGHT, position[row, 2])  # also where it is NaN
            noise = FLOW_NOISE * height * height
            rate = CORRECTION_RATE * (lost - CORRECTION_RATE / 2 * square) / noise
            most = min(dt / MIN_STUCK_TIME, 1 / MIN_STUCK_REPORTS) * MIN_EVIDENCE
            agent.evidence = max(agent.evidence + min(dt * rate, most), 0.0)
        if agent.evidence == 0.0 and not agent.contradicted:
            for order in range(3):
                agent.errors[order, 0] = agent.errors[order, 1] = 0.0
        faster_x, faster_y = agent.errors[0, 0], agent.errors[0, 1]
        cx, cy = cx + DRAG * faster_x, cy + DRAG * faster_y
        agent.errors[0, 0] += dt * (-cx - agent.errors[1, 0])
        agent.errors[0, 1] += dt * (-cy - agent.errors[1, 1])
        agent.errors[1, 0] += dt * (TILT_RATE * cx)
        agent.errors[1, 1] += dt * (TILT_RATE * cy)
        agent.errors[2, 0] += dt * faster_x
        agent.errors[2, 1] += dt * faster_y
        agent.learnt += dt
        agent.passed = dt
        if usable and not agent.contradicted:
            share = -math.expm1(-dt / min(max(agent.learnt, dt + TINY), BIAS_TIME))
            cx, cy = cx - DRAG * agent.errors[0, 0], cy - DRAG * agent.errors[0, 1]
            agent.bias[0] += share * (cx * cos + cy * sin)
            agent.bias[1] += share * (cy * cos - cx * sin)
        if not seconds <= 0:
            agent.time = time - age[row]
            for axis in range(2):
                agent.velocity[axis] = velocity[row, axis]
            agent.pull[0], agent.pull[1] = pull_x, pull_y
        if not airborne[row]:
            agent.learnt = agent.evidence = 0.0
            for axis in range(2):
                agent.bias[axis] = agent.errors[0, axis] = agent.errors[1, axis] = 0.0
        agent.contradicted = agent.contradicted and (not airborne[row] or agent.airborne)
        if not agent.contradicted and not (airborne[row] and agent.airborne):
            agent.errors[2, 0] = agent.errors[2, 1] = 0.0
        agent.airborne = airborne[row]
        if agent.learnt > LEARNING_TIME and agent.evidence > MIN_EVIDENCE:
            agent.contradicted = True
