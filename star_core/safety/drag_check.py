"""Finds agents that fly faster than they report, by the drag that their accelerometers measure."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from star_core.messages.arrays import Array, Mask, frozen
from star_core.messages.telemetry import Telemetry
from star_core.toolkit.jit import compiled

DRAG: Final = 0.40
"""Deceleration by the air per speed, 1/s: 0.36 to 0.42 in 21 recorded flights of Crazyflies, whose
coefficient of 0.0135 N s/m is 0.42 at 32 g."""

EXCESS: Final = 0.43
"""Share of a reported velocity that is missing from it if the flow sensor measures 0.7 times the
flow: 1 / 0.7 - 1."""

TOLERATED: Final = 0.08
"""Share that is missing without a fault: scales of sensors and floors differ by 0.07 (standard
deviation)."""

NOISE: Final = 0.0005
"""Density of the noise of measured drag, (m/s²)² s. In the recorded flights, means over 1 s err by
0.023 m/s² below 0.8 m/s, and by 0.032 m/s² at 1 m/s: accelerometer, air, and attitude."""

NOISE_OF_SPEED: Final = 2.0  # s²/m², increase of that density with the square of the speed

BIAS_TIME: Final = 10.0  # s, in which a constant error of the accelerometer is learnt
LEARNING_TIME: Final = 1.0  # s in the air before evidence counts, and again until it counts in full

MIN_EVIDENCE: Final = 10.0
"""Logarithm of the likelihood ratio from which on a flow sensor is taken for wrong."""

MIN_TIME: Final = 0.5  # s in which the evidence can reach `MIN_EVIDENCE`: a bump is no flow sensor

SWAY_TIME: Final = 1.0  # s, over which unexplained drag is averaged in order to measure its noise
SWAY_SHARE: Final = 0.5  # of the noise measured so, that is at least assumed: gusts have more

MAX_GAP: Final = 0.2  # s between two reports
TINY: Final = 1e-9  # s

DIFFERENCE: Final = DRAG * (EXCESS - TOLERATED)  # 1/s, of the means that are compared, per speed
MIDDLE: Final = DRAG * (EXCESS + TOLERATED) / 2  # 1/s


class DragCheck:
    """Compares the drag of the air with the velocities that agents report.

    Propellers push along the body's z axis, so an accelerometer along x and y measures the drag of
    the air, which is proportional to the velocity (Leishman, Macdonald, Beard and McLain,
    "Quadrotors and Accelerometers", IEEE Control Systems 34, 2014). It knows nothing of the flow
    sensor: if that sees 0.7 times the motion, the agent flies 1.43 times as fast as it reports, and
    the drag shows it for as long as it flies, while the corrections that `MotionCheck` adds up end
    within a second.

    A constant error of the accelerometer is learnt in `BIAS_TIME`. What is left of drag and
    reported velocity has the mean ``-DRAG EXCESS v`` with a wrong flow sensor, and zero without.
    The logarithm of the likelihood ratio adds up while it is positive (Page, Biometrika 41, 1954).
    An agent that was found stays so until it takes off again. Moving air looks like a wrong
    velocity: what is constant in the body is learnt, and gusts raise the noise that is assumed.

    Args:
        n: Number of agents.

    Attributes:
        evidence: (N,) logarithm of the likelihood ratio of a wrong flow sensor.
        missing: (N, 2) true less reported velocity by the drag, in odometry frames, m/s; NaN where
            it is not known.
    """

    def __init__(self, n: int) -> None:
        self._time = np.full(n, np.nan)  # s, of the newest report
        self._bias = np.zeros((n, 2))  # m/s², ahead and left
        self._learnt = np.zeros(n)  # s
        self._sway = np.zeros((n, 2))  # m/s², unexplained drag, averaged
        self._variance = np.zeros(n)  # (m/s²)², of that along one axis
        self.evidence = np.zeros(n)
        self.missing = np.full((n, 2), np.nan)
        self._missing = np.zeros((2, n, 2))  # m/s and m since the evidence was zero
        self._contradicted = np.zeros(n, np.bool_)
        self._airborne = np.zeros(n, np.bool_)  # in the last check
        nothing = (frozen(np.zeros((0, *row))) for row in ((), (2,), (3,), (4,)))
        unknown = np.zeros(0, np.bool_)
        self._follow(0.0, *nothing, unknown, unknown)  # compiled before the flight

    def check(self, telemetry: Telemetry, airborne: Mask, contradicted: Mask | None = None) -> Mask:
        """Return the agents that fly faster than they report: (N,).

        Args:
            telemetry: Of the tick, in odometry frames.
            airborne: (N,) which agents are in the air.
            contradicted: (N,) agents whose reported velocities are known to be wrong: what their
                accelerometers measure is not taken for an error of these.
        """
        if telemetry.specific_force is not None:
            self._follow(
                float(telemetry.time),
                telemetry.age,
                telemetry.specific_force,
                telemetry.velocity,
                telemetry.attitude,
                airborne,
                np.zeros(len(airborne), np.bool_) if contradicted is None else contradicted,
            )
        return self._contradicted.copy()

    def _follow(self, *reports: Any) -> None:
        follow_drag(  # type: ignore[call-arg]  # those that it has
            *reports,
            self._time,
            self._bias,
            self._learnt,
            self._sway,
            self._variance,
            self.evidence,
            self.missing,
            self._missing,
            self._contradicted,
            self._airborne,
        )

    def errors(self) -> tuple[Array, Array]:
        """Return by how much the motion of agents that were found differs from what they report.

        Returns:
            (N, 3) differences of the positions, m, and (N, 3) of the velocities, m/s, in the
            odometry frames; zero for other agents.
        """
        velocity, position = np.where(self._contradicted[:, None], self._missing, 0.0)
        level = np.zeros((len(self._learnt), 1))
        return np.hstack([position, level]), np.hstack([velocity, level])


@compiled
def follow_drag(  # noqa: PLR0913, PLR0917 -- the state of `DragCheck`, in one pass
    time: float,
    age: Array,
    force: Array,
    velocity: Array,
    attitude: Array,
    airborne: Mask,
    wrong: Mask,
    last_time: Array,
    bias: Array,
    learnt: Array,
    sway: Array,
    variance: Array,
    evidence: Array,
    measured: Array,
    missing: Array,
    contradicted: Mask,
    was_airborne: Mask,
) -> None:
    """Add what the reports of a tick show to the state of `DragCheck`, which is changed.

    Args:
        time: Mission time, s.
        age: (N,) of the reports, s.
        force: (N, 2) specific force in the body, m/s².
        velocity: (N, 3) in the odometry frame, m/s.
        attitude: (N, 4) unit quaternions x, y, z, w from the body to the odometry frame.
        airborne: (N,) agents in the air.
        wrong: (N,) agents whose reported velocities are known to be wrong.
        last_time: (N,) s.
        bias: (N, 2) m/s².
        learnt: (N,) s.
        sway: (N, 2) m/s².
        variance: (N,) (m/s²)².
        evidence: (N,).
        measured: (N, 2) true less reported velocity by the drag, m/s.
        missing: (2, N, 2) m/s and m.
        contradicted: (N,).
        was_airborne: (N,) agents that were in the air in the last tick.
    """
    for row in range(len(age)):
        passed = time - age[row] - last_time[row]
        x, y, z, w = attitude[row, 0], attitude[row, 1], attitude[row, 2], attitude[row, 3]
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        cos, sin = math.cos(yaw), math.sin(yaw)
        ahead = velocity[row, 0] * cos + velocity[row, 1] * sin
        aside = velocity[row, 1] * cos - velocity[row, 0] * sin
        error_x, error_y = force[row, 0] + DRAG * ahead, force[row, 1] + DRAG * aside
        measured[row, 0] = measured[row, 1] = math.nan
        usable = airborne[row] and 0 < passed <= MAX_GAP
        if usable and math.isfinite(error_x) and math.isfinite(error_y):
            dt = passed
            error_x, error_y = error_x - bias[row, 0], error_y - bias[row, 1]
            if learnt[row] > LEARNING_TIME:
                measured[row, 0] = -(error_x * cos - error_y * sin) / DRAG
                measured[row, 1] = -(error_x * sin + error_y * cos) / DRAG
            square = ahead * ahead + aside * aside
            share = -math.expm1(-dt / SWAY_TIME)
            sway[row, 0] += share * (error_x - sway[row, 0])
            sway[row, 1] += share * (error_y - sway[row, 1])
            swaying = (sway[row, 0] ** 2 + sway[row, 1] ** 2) / 2
            variance[row] += -math.expm1(-dt / BIAS_TIME) * (swaying - variance[row])
            noise = NOISE * (1 + NOISE_OF_SPEED * square)
            noise = max(noise, SWAY_SHARE * 2 * SWAY_TIME * variance[row])
            rate = (error_x * ahead + error_y * aside + MIDDLE * square) / noise
            rate = min(-DIFFERENCE * rate, MIN_EVIDENCE / MIN_TIME)
            trust = min(max(learnt[row] / LEARNING_TIME - 1, 0.0), 1.0)
            evidence[row] = max(evidence[row] + dt * trust * rate, 0.0)
            if not contradicted[row] and not wrong[row]:
                gain = -math.expm1(-dt / min(max(learnt[row], dt + TINY), BIAS_TIME))
                bias[row, 0] += gain * error_x
                bias[row, 1] += gain * error_y
            learnt[row] += dt
            for axis in range(2):
                missing[0, row, axis] = EXCESS * velocity[row, axis]
                missing[1, row, axis] += dt * missing[0, row, axis]
        contradicted[row] = contradicted[row] and (not airborne[row] or was_airborne[row])
        was_airborne[row] = airborne[row]
        if not airborne[row]:
            learnt[row] = variance[row] = evidence[row] = 0.0
            bias[row, 0] = bias[row, 1] = sway[row, 0] = sway[row, 1] = 0.0
        if evidence[row] == 0.0 and not contradicted[row]:
            for order in range(2):
                missing[order, row, 0] = missing[order, row, 1] = 0.0
        if not passed <= 0:
            last_time[row] = time - age[row]
        contradicted[row] = contradicted[row] or evidence[row] > MIN_EVIDENCE
