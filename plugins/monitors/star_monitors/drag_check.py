"""Finds agents that fly faster than they report, by the drag that their accelerometers measure."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from star_core import Array, Mask, Telemetry
from star_core.toolkit import compiled, frozen, records, subroutine

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

STATE: Final = np.dtype(
    [
        ("time", "f8"),  # s, of the newest report
        ("learnt", "f8"),  # s in the air
        # Errors ahead and left, m/s², and the missing share of the velocity: expected without a
        # fault, their covariance, and by how much they would differ after a jump.
        ("errors", "f8", 3),
        ("covariance", "f8", (3, 3)),
        ("jump", "f8", 3),
        ("sway", "f8", 2),  # drag across the flight, averaged, m/s², and its variance
        ("evidence", "f8"),  # logarithm of the likelihood ratio of a wrong flow sensor
        ("bias", "f8", 2),  # m/s², ahead and left, slowly learnt
        ("measured", "f8", 2),  # true less reported velocity by the drag, m/s
        ("missing", "f8", (2, 2)),  # m/s and m since the evidence was zero
        ("contradicted", "?"),
        ("airborne", "?"),  # in the last check
    ],
    align=True,
)


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
        self._state = records(n, STATE)
        self._state["time"] = self._state["measured"] = np.nan
        self.evidence, self.missing = self._state["evidence"], self._state["measured"]
        age, force, velocity, attitude = (
            frozen(np.zeros((0, *row))) for row in ((), (2,), (3,), (4,))
        )
        no_agent = np.zeros(0, np.bool_)
        follow_drag(
            0.0, age, force, velocity, attitude, no_agent, no_agent, self._state
        )  # compiled

    def check(self, telemetry: Telemetry, airborne: Mask, contradicted: Mask | None = None) -> Mask:
        """Return the agents that fly faster than they report: (N,).

        Args:
            telemetry: Of the tick, in odometry frames.
            airborne: (N,) which agents are in the air.
            contradicted: (N,) agents whose reported velocities are known to be wrong: what their
                accelerometers measure is not taken for an error of these.
        """
        if telemetry.specific_force is not None:
            follow_drag(
                float(telemetry.time),
                telemetry.age,
                telemetry.specific_force,
                telemetry.velocity,
                telemetry.attitude,
                airborne,
                np.zeros(len(airborne), np.bool_) if contradicted is None else contradicted,
                self._state,
            )
        return self._state["contradicted"].copy()

    def errors(self) -> tuple[Array, Array]:
        """Return by how much the motion of agents that were found differs from what they report.

        Returns:
            (N, 3) differences of the positions, m, and (N, 3) of the velocities, m/s, in the
            odometry frames; zero for other agents.
        """
        contradicted = self._state["contradicted"][:, None, None]
        missing = np.where(contradicted, self._state["missing"], 0.0)
        level = np.zeros((len(missing), 1))
        return np.hstack([missing[:, 1], level]), np.hstack([missing[:, 0], level])


@compiled
def follow_drag(  # noqa: C901, PLR0912 -- the state of `DragCheck`, in one pass
    time: float,
    age: Array,
    force: Array,
    velocity: Array,
    attitude: Array,
    airborne: Mask,
    wrong: Mask,
    state: Any,
) -> None:
    """Add what the reports of a tick show to the state of `DragCheck`.

    Args:
        time: Mission time, s.
        age: (N,) of the reports, s.
        force: (N, 2) specific force in the body, m/s².
        velocity: (N, 3) in the odometry frame, m/s.
        attitude: (N, 4) unit quaternions x, y, z, w from the body to the odometry frame.
        airborne: (N,) agents in the air.
        wrong: (N,) agents whose reported velocities are known to be wrong.
        state: (N,) records of `STATE`, changed in place.
    """
    for row in range(len(age)):
        agent = state[row]
        passed = time - age[row] - agent.time
        x, y, z, w = attitude[row, 0], attitude[row, 1], attitude[row, 2], attitude[row, 3]
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        cos, sin = math.cos(yaw), math.sin(yaw)
        ahead = velocity[row, 0] * cos + velocity[row, 1] * sin
        aside = velocity[row, 1] * cos - velocity[row, 0] * sin
        error_x, error_y = force[row, 0] + DRAG * ahead, force[row, 1] + DRAG * aside
        agent.measured[0] = agent.measured[1] = math.nan
        usable = airborne[row] and 0 < passed <= MAX_GAP
        if usable and math.isfinite(error_x) and math.isfinite(error_y):
            dt = passed
            if agent.learnt == 0.0:
                begin(agent)
            if agent.evidence == 0.0:
                agent.jump[0], agent.jump[1], agent.jump[2] = 0.0, 0.0, EXCESS
            left_x, left_y = error_x - agent.bias[0], error_y - agent.bias[1]
            if agent.learnt > LEARNING_TIME:
                agent.measured[0] = -(left_x * cos - left_y * sin) / DRAG
                agent.measured[1] = -(left_x * sin + left_y * cos) / DRAG
            if not agent.contradicted and not wrong[row]:
                since = min(max(agent.learnt, dt + TINY), SWAY_MEMORY)
                density = noise(agent, error_x, error_y, ahead, aside, dt, since)
                predict(agent, dt)
                added = 0.0
                for axis, error, speed in ((0, error_x, ahead), (1, error_y, aside)):
                    added += correct(agent, axis, error, speed, density / dt)
                if agent.learnt > LEARNING_TIME:
                    added = min(added, dt * MIN_EVIDENCE / MIN_TIME)
                    agent.evidence = max(agent.evidence + added, 0.0)
                gain = -math.expm1(-dt / min(max(agent.learnt, dt + TINY), MISSING_BIAS_TIME))
                agent.bias[0] += gain * left_x
                agent.bias[1] += gain * left_y
            agent.learnt += dt
            for axis in range(2):
                agent.missing[0, axis] = EXCESS * velocity[row, axis]
                agent.missing[1, axis] += dt * agent.missing[0, axis]
        agent.contradicted = agent.contradicted and (not airborne[row] or agent.airborne)
        agent.airborne = airborne[row]
        if not airborne[row]:
            agent.learnt = agent.evidence = 0.0
            for axis in range(2):
                agent.bias[axis] = agent.sway[axis] = 0.0
        if agent.evidence == 0.0 and not agent.contradicted:
            for order in range(2):
                agent.missing[order, 0] = agent.missing[order, 1] = 0.0
        if not passed <= 0:
            agent.time = time - age[row]
        agent.contradicted = agent.contradicted or agent.evidence > MIN_EVIDENCE


@subroutine
def begin(agent: Any) -> None:
    """Set what is known of an agent's errors at its take-off."""
    covariance = agent.covariance
    agent.errors[:] = 0.0
    covariance[:] = 0.0
    covariance[0, 0] = covariance[1, 1] = BIAS_STD * BIAS_STD
    covariance[2, 2] = SCALE_STD * SCALE_STD


@subroutine
def noise(
    agent: Any, error_x: float, error_y: float, ahead: float, aside: float, dt: float, since: float
) -> float:
    """Return the density of the noise of measured drag, (m/s²)² s; add the errors to the sway."""
    sway = agent.sway
    error_x, error_y = error_x - agent.errors[0], error_y - agent.errors[1]
    square = ahead * ahead + aside * aside
    across = (error_y * ahead - error_x * aside) / math.sqrt(square + TINY)
    sway[0] += -math.expm1(-dt / SWAY_TIME) * (across - sway[0])
    sway[1] += -math.expm1(-dt / since) * (sway[0] * sway[0] - sway[1])
    density: float = max(NOISE * (1 + NOISE_OF_SPEED * square), 2 * SWAY_TIME * sway[1])
    return density


@subroutine
def predict(agent: Any, dt: float) -> None:
    """Let the errors of the accelerometer wander, and the scale return to its mean."""
    kept, covariance = 1 - dt / SCALE_TIME, agent.covariance
    agent.errors[2] *= kept
    agent.jump[2] = EXCESS + kept * (agent.jump[2] - EXCESS)
    for axis in range(2):
        covariance[axis, axis] += BIAS_WANDER * dt
        covariance[axis, 2] *= kept
        covariance[2, axis] *= kept
    covariance[2, 2] = SCALE_STD * SCALE_STD + kept * kept * (
        covariance[2, 2] - SCALE_STD * SCALE_STD
    )


@subroutine
def correct(agent: Any, axis: int, error: float, speed: float, variance: float) -> float:
    """Correct the errors by the drag along an axis; return what it adds to the evidence.

    Args:
        agent: Record of `STATE`.
        axis: 0 ahead, 1 left.
        error: Measured less expected drag, m/s².
        speed: Along the axis, m/s.
        variance: Of the noise of the measurement, (m/s²)².
    """
    errors, covariance, jump = agent.errors, agent.covariance, agent.jump
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
