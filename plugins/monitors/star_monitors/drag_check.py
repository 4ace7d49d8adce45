"""Finds agents that fly faster than they report, by the drag that their accelerometers measure."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from star_core import Array, Mask, Telemetry
from star_core.toolkit import compiled, frozen, subroutine

DRAG: Final = 0.40
"""Deceleration by the air per speed, 1/s: 0.36 to 0.42 in 21 recorded flights of Crazyflies, whose
coefficient of 0.0135 N s/m is 0.42 at 32 g."""

EXCESS: Final = 0.43
"""Share of a reported velocity that is missing from it if the flow sensor measures 0.7 times the
flow: 1 / 0.7 - 1."""

SCALE_STD: Final = 0.08
"""Share that is missing without a fault, standard deviation: scales of sensors and floors differ by
0.07."""

SCALE_TIME: Final = 30.0  # s, correlation time of that share

BIAS_STD: Final = 0.2  # m/s², of the accelerometer's error along an axis at the take-off
BIAS_WANDER: Final = 1.8e-4
"""Growth of the variance of that error, (m/s²)²/s: 2 (0.03 m/s²)² / 10 s, the initial rate of a
first-order Gauss-Markov process with this standard deviation and correlation time."""

NOISE: Final = 0.0005
"""Density of the noise of measured drag, (m/s²)² s. In the recorded flights, means over 1 s err by
0.023 m/s² below 0.8 m/s, and by 0.032 m/s² at 1 m/s: accelerometer, air, and attitude."""

NOISE_OF_SPEED: Final = 2.0  # s²/m², increase of that density with the square of the speed

LEARNING_TIME: Final = 1.0  # s in the air before evidence counts
MISSING_BIAS_TIME: Final = 10.0  # s, in which `missing` learns the constant error

MIN_EVIDENCE: Final = 7.5
"""Logarithm of the likelihood ratio from which on a flow sensor is taken for wrong."""

MIN_TIME: Final = 0.5  # s in which the evidence can reach `MIN_EVIDENCE`: a bump is no flow sensor

SWAY_TIME: Final = 1.0  # s, over which drag across the flight is averaged to measure its noise
SWAY_MEMORY: Final = 20.0  # s, over which that noise is averaged: gusts have more than `NOISE`

MAX_GAP: Final = 0.2  # s between two reports
TINY: Final = 1e-9


class DragCheck:
    """Compares the drag of the air with the velocities that agents report.

    Propellers push along the body's z axis, so an accelerometer along x and y measures the drag of
    the air, which is proportional to the velocity (Leishman, Macdonald, Beard and McLain,
    "Quadrotors and Accelerometers", IEEE Control Systems 34, 2014). It knows nothing of the flow
    sensor: if that sees 0.7 times the motion, the agent flies 1.43 times as fast as it reports, and
    the drag shows it for as long as it flies, while the corrections that `MotionCheck` adds up end
    within a second.

    A Kalman filter explains what is left of drag and reported velocity without a fault, by an error
    of the accelerometer along each axis that wanders, and by the scale of flow sensor and floor.
    What a jump of the scale by `EXCESS` adds to its innovations is its *signature*. The filter
    takes a part of the jump for wandering errors, all the more in straight flight at constant
    speed, and its signature fades as much (Willsky and Jones, IEEE Trans. Automatic Control 21,
    1976). The logarithm of the likelihood ratio of innovations with and without the signature adds
    up while it is positive (Page, Biometrika 41, 1954); where it is zero, the jump begins anew. An
    agent that was found stays so until it takes off again.

    Moving air looks like a wrong velocity. What is constant in the body is learnt, and gusts raise
    the noise that is assumed: it is measured across the flight, where no scale shows.

    Attributes:
        evidence: (N,) logarithm of the likelihood ratio of a wrong flow sensor.
        missing: (N, 2) true less reported velocity by the drag, in odometry frames, m/s; NaN where
            it is not known.
    """

    def __init__(self, n: int) -> None:
        self._time = np.full(n, np.nan)  # s, of the newest report
        self._learnt = np.zeros(n)  # s in the air
        # Errors ahead and left, m/s², and the missing share of the velocity: expected without a
        # fault, their covariance, and by how much they would differ after a jump.
        self._errors = np.zeros((n, 3))
        self._covariance = np.zeros((n, 3, 3))
        self._jump = np.zeros((n, 3))
        self._sway = np.zeros((n, 2))  # drag across the flight, averaged, m/s², and its variance
        self.evidence = np.zeros(n)
        self._bias = np.zeros((n, 2))  # m/s², ahead and left, slowly learnt
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
            self._learnt,
            self._errors,
            self._covariance,
            self._jump,
            self._sway,
            self.evidence,
            self._bias,
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
def follow_drag(  # noqa: C901, PLR0912, PLR0913, PLR0917 -- the state of `DragCheck`, in one pass
    time: float,
    age: Array,
    force: Array,
    velocity: Array,
    attitude: Array,
    airborne: Mask,
    wrong: Mask,
    last_time: Array,
    learnt: Array,
    errors: Array,
    covariance: Array,
    jump: Array,
    sway: Array,
    evidence: Array,
    bias: Array,
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
        learnt: (N,) s.
        errors: (N, 3) m/s² and fraction.
        covariance: (N, 3, 3) of the errors.
        jump: (N, 3) m/s² and fraction.
        sway: (N, 2) m/s² and (m/s²)².
        evidence: (N,).
        bias: (N, 2) m/s².
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
            if learnt[row] == 0.0:
                begin(errors[row], covariance[row])
            if evidence[row] == 0.0:
                jump[row, 0], jump[row, 1], jump[row, 2] = 0.0, 0.0, EXCESS
            left_x, left_y = error_x - bias[row, 0], error_y - bias[row, 1]
            if learnt[row] > LEARNING_TIME:
                measured[row, 0] = -(left_x * cos - left_y * sin) / DRAG
                measured[row, 1] = -(left_x * sin + left_y * cos) / DRAG
            if not contradicted[row] and not wrong[row]:
                since = min(max(learnt[row], dt + TINY), SWAY_MEMORY)
                density = noise(
                    error_x - errors[row, 0],
                    error_y - errors[row, 1],
                    ahead,
                    aside,
                    dt,
                    since,
                    sway[row],
                )
                predict(errors[row], covariance[row], jump[row], dt)
                added = 0.0
                for axis, error, speed in ((0, error_x, ahead), (1, error_y, aside)):
                    added += correct(
                        axis, error, speed, density / dt, errors[row], covariance[row], jump[row]
                    )
                if learnt[row] > LEARNING_TIME:
                    added = min(added, dt * MIN_EVIDENCE / MIN_TIME)
                    evidence[row] = max(evidence[row] + added, 0.0)
                gain = -math.expm1(-dt / min(max(learnt[row], dt + TINY), MISSING_BIAS_TIME))
                bias[row, 0] += gain * left_x
                bias[row, 1] += gain * left_y
            learnt[row] += dt
            for axis in range(2):
                missing[0, row, axis] = EXCESS * velocity[row, axis]
                missing[1, row, axis] += dt * missing[0, row, axis]
        contradicted[row] = contradicted[row] and (not airborne[row] or was_airborne[row])
        was_airborne[row] = airborne[row]
        if not airborne[row]:
            learnt[row] = evidence[row] = 0.0
            for axis in range(2):
                bias[row, axis] = sway[row, axis] = 0.0
        if evidence[row] == 0.0 and not contradicted[row]:
            for order in range(2):
                missing[order, row, 0] = missing[order, row, 1] = 0.0
        if not passed <= 0:
            last_time[row] = time - age[row]
        contradicted[row] = contradicted[row] or evidence[row] > MIN_EVIDENCE


@subroutine
def begin(errors: Array, covariance: Array) -> None:
    """Set what is known of an agent's errors at its take-off."""
    errors[:] = 0.0
    covariance[:] = 0.0
    covariance[0, 0] = covariance[1, 1] = BIAS_STD * BIAS_STD
    covariance[2, 2] = SCALE_STD * SCALE_STD


@subroutine
def noise(
    error_x: float, error_y: float, ahead: float, aside: float, dt: float, since: float, sway: Array
) -> float:
    """Return the density of the noise of measured drag, (m/s²)² s; add the errors to the sway."""
    square = ahead * ahead + aside * aside
    across = (error_y * ahead - error_x * aside) / math.sqrt(square + TINY)
    sway[0] += -math.expm1(-dt / SWAY_TIME) * (across - sway[0])
    sway[1] += -math.expm1(-dt / since) * (sway[0] * sway[0] - sway[1])
    density: float = max(NOISE * (1 + NOISE_OF_SPEED * square), 2 * SWAY_TIME * sway[1])
    return density


@subroutine
def predict(errors: Array, covariance: Array, jump: Array, dt: float) -> None:
    """Let the errors of the accelerometer wander, and the scale return to its mean."""
    kept = 1 - dt / SCALE_TIME
    errors[2] *= kept
    jump[2] = EXCESS + kept * (jump[2] - EXCESS)
    for axis in range(2):
        covariance[axis, axis] += BIAS_WANDER * dt
        covariance[axis, 2] *= kept
        covariance[2, axis] *= kept
    covariance[2, 2] = SCALE_STD * SCALE_STD + kept * kept * (
        covariance[2, 2] - SCALE_STD * SCALE_STD
    )


@subroutine
def correct(
    axis: int,
    error: float,
    speed: float,
    variance: float,
    errors: Array,
    covariance: Array,
    jump: Array,
) -> float:
    """Correct the errors by the drag along an axis; return what it adds to the evidence.

    Args:
        axis: 0 ahead, 1 left.
        error: Measured less expected drag, m/s².
        speed: Along the axis, m/s.
        variance: Of the noise of the measurement, (m/s²)².
        errors: (3,) m/s² and fraction.
        covariance: (3, 3) of the errors.
        jump: (3,) m/s² and fraction.
    """
    share = -DRAG * speed
    innovation = error - errors[axis] - share * errors[2]
    signature = jump[axis] + share * jump[2]
    first = covariance[0, axis] + share * covariance[0, 2]
    second = covariance[1, axis] + share * covariance[1, 2]
    third = covariance[2, axis] + share * covariance[2, 2]
    total = covariance[axis, axis] + 2 * share * covariance[axis, 2]
    total += share * share * covariance[2, 2] + variance
    for i, common in ((0, first), (1, second), (2, third)):
        errors[i] += common / total * innovation
        jump[i] -= common / total * signature
        covariance[i, 0] -= common * first / total
        covariance[i, 1] -= common * second / total
        covariance[i, 2] -= common * third / total
    added: float = signature * (innovation - signature / 2) / total
    return added
