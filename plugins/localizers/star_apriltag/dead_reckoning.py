"""State of an agent by its odometry since its newest image, with the errors of the odometry.

The state has, besides position and heading, the errors that odometry makes for long: they are
correlated with the position, so that each image corrects both. `JointFilter` estimates them;
`predict` continues from there to any later time.
"""

from __future__ import annotations

import cmath
import math
from typing import Final, NamedTuple

import numpy as np

from star_apriltag.odometry_track import Motion, OdometrySample, OdometryTrack
from star_core import Agent, Array, Odometry, Rows

# Indices of the state: position and heading in the map, m and rad; z is the correction of the
# on-board height, which has the bias of the ranger.
X, Y, Z, YAW = range(4)
# Errors of the on-board roll and pitch that change within seconds, to be added, rad.
ROLL, PITCH = 4, 5
# Errors of the on-board velocity that change within a second, to be subtracted, m/s, in the level
# body frame: noise of the flow sensor that the on-board estimator has smoothed.
SLIP_X, SLIP_Y = 6, 7
# Factor of velocities: its deviation from 1, its rotation, rad, and its deviation on this floor.
SCALE, TURN, FLOOR = 8, 9, 10
YAW_BIAS = 11  # subtracted from yaw rates, rad/s
# Errors of the velocity over the lagged turn, m: an accelerometer bias is constant in the body. The
# on-board estimator balances it by its tilt, and has to do so anew whenever the body turns.
ARM_X, ARM_Y = 12, 13
# Errors of the on-board velocity that last for minutes, to be subtracted, m/s, in the level body
# frame: by the bias of the gyro, with which the on-board estimator has to keep up, and of the flow.
DRIFT_X, DRIFT_Y = 14, 15
STATES: Final = 16

# Standard deviations at the start, of an agent that is placed by hand.
START_STD: Final = 0.05  # m
START_YAW_STD: Final = math.radians(3.0)  # rad

# Standard deviations and correlations of the odometry's errors.
HEIGHT_STD: Final = 0.02  # m: VL53L1X
HEIGHT_PER_TIME: Final = 0.001  # m/√s: a ranger's bias hardly changes in flight, 1 cm in 100 s
TILT_STD, TILT_TIME = math.radians(0.5), 1.5  # rad and s
SCALE_STD: Final = 0.08
TURN_STD: Final = 0.05  # rad
SCALE_PER_TIME: Final = 0.005  # 1/√s, and rad/√s of its rotation
FLOOR_STD, FLOOR_LENGTH = 0.05, 0.7  # m
ARM_STD: Final = 0.05  # m
YAW_BIAS_STD: Final = math.radians(0.25)  # rad/s
YAW_BIAS_PER_TIME: Final = math.radians(0.025)  # rad/s/√s
YAW_PER_TIME: Final = math.radians(0.05)  # rad/√s
POSITION_PER_TIME: Final = 0.005  # m/√s
FLOOR_MOTION_NOISE: Final = 0.010  # m/√s, in addition while the camera measures motion by the floor
SLIP_RATE, SLIP_TIME = 0.056, 0.35  # 1/s, standard deviation per height, and s
"""A Kalman filter that smooths flow samples over `SLIP_TIME` has such an error with the firmware's
2 counts of noise (``flowStdFixed``): 0.41 m/s per metre of height in each sample of 10 ms."""
LEAST_HEIGHT: Final = 0.1  # m, for that
DRIFT_STD, DRIFT_TIME = 0.007, 60.0
"""m/s and s; `star_flow.drift` has the two processes of which this is the sum."""


class Anchor(NamedTuple):
    """State at the newest image, from which dead reckoning continues."""

    time: float  # s
    mean: Array  # (STATES,)
    covariance: Array  # (STATES, STATES)

    @property
    def factor(self) -> complex:
        """Factor of the odometry's velocities."""
        scale, turn, floor = self.mean[[SCALE, TURN, FLOOR]].tolist()
        factor: complex = (1 + scale + floor) * cmath.rect(1.0, turn)
        return factor

    @property
    def yaw_bias(self) -> float:
        """Subtracted from its yaw rates, rad/s."""
        return float(self.mean[YAW_BIAS])


class AgentState(NamedTuple):
    """Estimated state of an agent at one time."""

    position: Array  # (3,) in the map, m
    yaw: float  # rad
    roll: float  # rad, on board
    pitch: float  # rad, on board
    velocity: Array  # (3,) in the map, m/s
    yaw_rate: float  # rad/s
    covariance: Array  # (4, 4) of x, y, z and yaw: m and rad

    @property
    def rotation(self) -> Array:
        """(3, 3) from the body to the map."""
        return rotation_about_z(self.yaw) @ level_rotation(self.roll, self.pitch)


class DeadReckoner:
    """Predicts one agent's current state from `anchor`, which is replaced, and its odometry."""

    def __init__(self, agent: Agent) -> None:
        self._track = OdometryTrack()
        self._ground = float(agent.start[2])
        self.anchor = start(agent)

    def add_odometry(self, odometry: Odometry, rows: Rows, *, motors: bool) -> None:
        """Add the agent's samples."""
        self._track.add(odometry, rows, motors=motors)

    def at(self, time: float) -> AgentState:
        """Return the state at `time`, s, or at that of the newest image if that is later."""
        return predict(self.anchor, time, self._track, self._ground)


def start(agent: Agent) -> Anchor:
    """Return an agent's state before take-off."""
    mean = np.zeros(STATES)
    mean[[X, Y, YAW]] = *agent.start[:2], agent.yaw
    return Anchor(0.0, mean, np.diag(_START_STD**2))


def predict(anchor: Anchor, time: float, track: OdometryTrack, ground: float) -> AgentState:
    """Return an agent's state at `time`, s, by dead reckoning.

    `ground` is the z of its odometry frame in the map, m.
    """
    anchor, _ = carried(anchor, max(time, anchor.time), track)
    sample = track.at(anchor.time)
    x, y, z, yaw = anchor.mean[: YAW + 1].tolist()
    velocity = body_velocity(anchor, sample) * cmath.rect(1.0, yaw)
    return AgentState(
        position=np.array([x, y, ground + sample.height + z]),
        yaw=yaw,
        roll=sample.roll,
        pitch=sample.pitch,
        velocity=np.array([velocity.real, velocity.imag, sample.velocity[2]]),
        yaw_rate=sample.yaw_rate - anchor.yaw_bias,
        covariance=anchor.covariance[: YAW + 1, : YAW + 1],
    )


def body_velocity(anchor: Anchor, sample: OdometrySample) -> complex:
    """Return the corrected velocity in the level body frame, x + iy, m/s."""
    vx, vy, _ = sample.velocity.tolist()
    slip_x, slip_y, arm_x, arm_y = anchor.mean[[SLIP_X, SLIP_Y, ARM_X, ARM_Y]].tolist()
    slip_x, slip_y = slip_x + float(anchor.mean[DRIFT_X]), slip_y + float(anchor.mean[DRIFT_Y])
    turning = complex(arm_x, arm_y) * sample.swing
    return complex(vx, vy) * anchor.factor - complex(slip_x, slip_y) - turning


def carried(anchor: Anchor, time: float, track: OdometryTrack) -> tuple[Anchor, Array]:
    """Return the state at a later time, and its (STATES, STATES) derivative by the earlier one."""
    motion = track.between(anchor.time, time, scale=anchor.factor, yaw_bias=anchor.yaw_bias)
    heading = cmath.rect(1.0, float(anchor.mean[YAW]))
    took = motion.duration
    blind = motion.blind_duration / took if took > 0 else 0.0
    kept = np.ones(STATES)
    kept[ROLL] = kept[PITCH] = math.exp(-took / TILT_TIME)
    kept[SLIP_X] = kept[SLIP_Y] = slip_kept = math.exp(-took / SLIP_TIME)
    kept[FLOOR] = floor_kept = math.exp(-motion.length / FLOOR_LENGTH)
    kept[DRIFT_X] = kept[DRIFT_Y] = math.exp(-took / DRIFT_TIME)

    # Derivatives of the displacement in the map, x + iy.
    along = heading * motion.blind_shift
    by_slip = -heading * blind * SLIP_TIME * (1 - slip_kept)
    by_slip *= cmath.rect(1.0, motion.turn / 2 * min(1.0, SLIP_TIME / max(took, SLIP_TIME)))
    on_floor = FLOOR_LENGTH * (1 - floor_kept) / motion.length if motion.length > 0 else 0.0
    by = np.zeros(STATES, np.complex128)
    by[SLIP_X], by[SLIP_Y] = by_slip, 1j * by_slip
    by[SCALE], by[TURN], by[FLOOR] = along, 1j * along, on_floor * along
    errors = anchor.mean.tolist()
    slip, arm = complex(*errors[SLIP_X : SLIP_Y + 1]), complex(*errors[ARM_X : ARM_Y + 1])
    drift = complex(*errors[DRIFT_X : DRIFT_Y + 1])
    by_arm = -heading * motion.swing
    by[ARM_X], by[ARM_Y] = by_arm, 1j * by_arm
    by_drift = -heading * motion.blind_duration * cmath.rect(1.0, motion.turn / 2)
    by[DRIFT_X], by[DRIFT_Y] = by_drift, 1j * by_drift
    by[YAW_BIAS] = -1j * heading * motion.moment - 1j * took / 2 * by_drift * drift
    shift = heading * motion.shift + by_slip * slip + by_arm * arm + by_drift * drift
    by[YAW] = 1j * shift

    mean = kept * anchor.mean
    mean[X] += shift.real
    mean[Y] += shift.imag
    mean[YAW] += motion.turn
    moved = np.diag(kept)
    moved[X] += by.real
    moved[Y] += by.imag
    moved[YAW, YAW_BIAS] = -took
    covariance = moved @ anchor.covariance @ moved.T + _noise(motion, heading, kept)
    return Anchor(time, mean, covariance), moved


def _noise(motion: Motion, heading: complex, kept: Array) -> Array:
    """Return the (STATES, STATES) covariance of what a motion adds to the errors."""
    noise = np.diag(_PER_TIME**2 * motion.duration)
    # Slip and scale on the floor are first-order Gauss-Markov processes; positions integrate them.
    slip_std = SLIP_RATE * max(motion.height, LEAST_HEIGHT)
    variance, shared, left = _integrated(slip_std, SLIP_TIME, motion.blind_duration)
    noise[X, X] += variance
    noise[Y, Y] += variance
    noise[SLIP_X, SLIP_X] = noise[SLIP_Y, SLIP_Y] = left
    end = -shared * heading * cmath.rect(1.0, motion.turn)
    noise[X, SLIP_X] = noise[SLIP_X, X] = noise[Y, SLIP_Y] = noise[SLIP_Y, Y] = end.real
    noise[X, SLIP_Y] = noise[SLIP_Y, X] = -end.imag
    noise[Y, SLIP_X] = noise[SLIP_X, Y] = end.imag
    variance, shared, left = _integrated(FLOOR_STD, FLOOR_LENGTH, motion.blind_length)
    along = heading * motion.shift / motion.length if motion.length > 0 else 0j
    by_floor = FLOOR_MOTION_NOISE**2 * (motion.duration - motion.blind_duration)
    noise[X, X] += by_floor
    noise[Y, Y] += by_floor
    ahead = np.array([along.real, along.imag])
    noise[:FLOOR, :FLOOR][:2, :2] += variance * np.outer(ahead, ahead)
    noise[FLOOR, :2] = noise[:2, FLOOR] = shared * ahead
    noise[FLOOR, FLOOR] = left
    noise[ROLL, ROLL] = noise[PITCH, PITCH] = TILT_STD**2 * (1 - kept[ROLL] ** 2)
    noise[DRIFT_X, DRIFT_X] = noise[DRIFT_Y, DRIFT_Y] = DRIFT_STD**2 * (1 - kept[DRIFT_X] ** 2)
    return noise


def _integrated(std: float, scale: float, length: float) -> tuple[float, float, float]:
    """Return what a Gauss-Markov process adds over `length`, if its correlation length is `scale`.

    Returns:
        The variances of its integral and of itself, with their covariance in between.
    """
    kept = math.exp(-length / scale)
    ratio = length / scale
    whole = ratio**3 * 2 / 3 if ratio < SMALL else 2 * ratio - 3 + 4 * kept - kept * kept
    return std**2 * scale**2 * whole, std**2 * scale * (1 - kept) ** 2, std**2 * (1 - kept**2)


def rotation_about_z(angle: float) -> Array:
    """Return the (3, 3) rotation about z by an angle, rad."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def level_rotation(roll: float, pitch: float) -> Array:
    """Return the (3, 3) rotation from the body to the level frame with its heading."""
    cos, sin, right, up = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
    return np.array(
        [[cos, sin * up, sin * right], [0.0, right, -up], [-sin, cos * up, cos * right]]
    )


SMALL: Final = 1e-3  # where the difference of the terms would be rounding errors

_START_STD = np.array(
    [
        *[START_STD, START_STD, HEIGHT_STD, START_YAW_STD],
        *[TILT_STD, TILT_STD, SLIP_RATE * LEAST_HEIGHT, SLIP_RATE * LEAST_HEIGHT],
        *[SCALE_STD, TURN_STD, FLOOR_STD, YAW_BIAS_STD, ARM_STD, ARM_STD],
        *[DRIFT_STD, DRIFT_STD],
    ]
)
_PER_TIME = np.array(
    [
        *[POSITION_PER_TIME, POSITION_PER_TIME, HEIGHT_PER_TIME, YAW_PER_TIME],
        *[0.0, 0.0, 0.0, 0.0],
        *[SCALE_PER_TIME, SCALE_PER_TIME, 0.0, YAW_BIAS_PER_TIME, 0.0, 0.0],
        *[0.0, 0.0],
    ]
)
