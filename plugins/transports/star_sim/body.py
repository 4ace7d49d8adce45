"""Rigid body with four motors: semi-implicit Euler steps of 2 ms, eight drones at a time.

The data of eight drones is interleaved (`star_sim.batch`); the loops over them have no branch. This
makes a step several times cheaper.
"""

from __future__ import annotations

import math

from star_core.toolkit import subroutine
from star_sim.airframe import (
    ARM,
    DRAG_XY,
    DRAG_Z,
    GRAVITY,
    INERTIA_XY,
    INERTIA_Z,
    MASS,
    MOTOR_STEP,
    STEP,
    TORQUE_PER_THRUST,
)
from star_sim.attitude import mix, most
from star_sim.batch import (
    BATCH_SIZE,
    CEILING,
    F1,
    F2,
    F3,
    F4,
    GAIN,
    INTEGRAL,
    LANES,
    LAST_RATE,
    ON,
    PITCH,
    PITCH_TAN,
    PWM,
    PX,
    PY,
    PZ,
    QW,
    QX,
    QY,
    QZ,
    ROLL,
    ROLL_COS,
    ROLL_SIN,
    SHARE,
    TARGET_PITCH,
    TARGET_ROLL,
    TARGET_THRUST,
    VOLTAGE,
    VX,
    VY,
    VZ,
    YAW_ERROR,
    YAW_RATE,
    P,
    Q,
    R,
    X,
    Y,
    Z,
)
from star_sim.drone import OFF, Record
from star_sim.powertrain import DRAG, turn
from star_sim.stabilizer import GAINS, stabilize

GRIP = 0.8  # of sideways speed and of body rates is left after a step on the floor
SETTLE = 0.9  # of the tilt is left after a step of standing on the floor

_GYROSCOPIC = (INERTIA_XY - INERTIA_Z) / INERTIA_XY


@subroutine
def fly(drones: Record, cascades: Record, first: int, steps: int, batch: Record) -> None:
    """Step up to eight drones from row `first` on by `steps` steps.

    Newton-Euler dynamics with a first-order lag of each motor's thrust, drag linear in the velocity
    along each body axis, and a floor at z = 0 that stops falling drones, holds their feet by
    friction and levels upright ones. Momentum is stepped first, then the pose with the new
    momentum.

    Args:
        drones: (N,) records.
        cascades: (N,) records of the firmware's controllers; None for the ideal controller.
        first: Row of the first.
        steps: Of 2 ms.
        batch: (BATCH_SIZE,) buffer.
    """
    count = min(LANES, len(drones) - first)
    for i in range(BATCH_SIZE):
        batch[i] = 0.0
    for i in range(LANES):
        batch[QW + i] = batch[VOLTAGE + i] = 1.0  # of lanes without a drone
    for i in range(count):
        _interleave(drones[first + i], batch, i)
        if cascades is not None:
            _interleave_cascade(drones[first + i], cascades[first + i], batch, i)
    for _ in range(steps):
        for i in range(LANES):
            if cascades is not None:
                thrust = stabilize(batch, i)
                turn(batch, i)
                _move(batch, i, thrust, DRAG)
            else:
                _move(batch, i, _push(batch, i), DRAG_XY)
    for i in range(count):
        _restore(drones[first + i], batch, i)
        if cascades is not None:
            _restore_cascade(cascades[first + i], batch, i)


@subroutine
def _push(s: Record, i: int) -> tuple[float, float, float, float]:
    """Return the thrust of the motors of drone number `i` in a batch, by the ideal controller."""
    qx, qy, qz, qw = s[QX + i], s[QY + i], s[QZ + i], s[QW + i]
    px, py, pz = s[PX + i], s[PY + i], s[PZ + i]
    bx = 2 * (qx * qz + qw * qy)  # the body's z axis in the map
    by = 2 * (qy * qz - qw * qx)
    bz = 1 - 2 * (qx * qx + qy * qy)
    lift = most(0.0, bx * px + by * py + bz * pz)
    ahead = s[SHARE + i] * (
        (1 - 2 * (qy * qy + qz * qz)) * px
        + 2 * (qx * qy + qw * qz) * py
        + 2 * (qx * qz - qw * qy) * pz
    )
    aside = s[SHARE + i] * (
        2 * (qx * qy - qw * qz) * px
        + (1 - 2 * (qx * qx + qz * qz)) * py
        + 2 * (qy * qz + qw * qx) * pz
    )
    rates = s[P + i], s[Q + i], s[R + i]
    w1, w2, w3, w4 = mix(lift, aside, ahead, s[YAW_RATE + i], rates, s[CEILING + i])
    return (
        s[F1 + i] + MOTOR_STEP * (s[ON + i] * w1 - s[F1 + i]),
        s[F2 + i] + MOTOR_STEP * (s[ON + LANES + i] * w2 - s[F2 + i]),
        s[F3 + i] + MOTOR_STEP * (s[ON + 2 * LANES + i] * w3 - s[F3 + i]),
        s[F4 + i] + MOTOR_STEP * (s[ON + 3 * LANES + i] * w4 - s[F4 + i]),
    )


@subroutine
def _move(s: Record, i: int, thrust: tuple[float, float, float, float], drag: float) -> None:
    """Step the rigid body of drone number `i` in a batch under the thrust of its motors, N."""
    vx, vy, vz = s[VX + i], s[VY + i], s[VZ + i]
    qx, qy, qz, qw = s[QX + i], s[QY + i], s[QZ + i], s[QW + i]
    p, q, r = s[P + i], s[Q + i], s[R + i]
    f1, f2, f3, f4 = thrust
    bx = 2 * (qx * qz + qw * qy)  # the body's z axis in the map
    by = 2 * (qy * qz - qw * qx)
    bz = 1 - 2 * (qx * qx + qy * qy)

    p, q, r = (
        p + STEP * (ARM / INERTIA_XY * (-f1 - f2 + f3 + f4) + _GYROSCOPIC * q * r),
        q + STEP * (ARM / INERTIA_XY * (-f1 + f2 + f3 - f4) - _GYROSCOPIC * p * r),
        r + STEP * (TORQUE_PER_THRUST / INERTIA_Z * (-f1 + f2 - f3 + f4)),
    )
    along = f1 + f2 + f3 + f4 - (DRAG_Z - drag) * (bx * vx + by * vy + bz * vz)
    vx += STEP / MASS * (along * bx - drag * vx)
    vy += STEP / MASS * (along * by - drag * vy)
    vz += STEP / MASS * (along * bz - drag * vz) - STEP * GRAVITY

    qx, qy, qz, qw = (
        qx + 0.5 * STEP * (qw * p + qy * r - qz * q),
        qy + 0.5 * STEP * (qw * q + qz * p - qx * r),
        qz + 0.5 * STEP * (qw * r + qx * q - qy * p),
        qw - 0.5 * STEP * (qx * p + qy * q + qz * r),
    )
    z = s[Z + i] + STEP * vz
    below = z < 0.0
    grip = GRIP if below else 1.0
    settled = SETTLE if below and bz > 0.0 else 1.0  # without tilt x and y are 0
    qx, qy = settled * qx, settled * qy
    unit = 1.0 / math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)

    s[X + i] += STEP * vx
    s[Y + i] += STEP * vy
    s[Z + i] = most(0.0, z)
    s[VX + i], s[VY + i] = grip * vx, grip * vy
    s[VZ + i] = 0.0 if below and vz < 0.0 else vz
    s[QX + i], s[QY + i], s[QZ + i], s[QW + i] = unit * qx, unit * qy, unit * qz, unit * qw
    s[P + i], s[Q + i], s[R + i] = grip * p, grip * q, grip * r
    s[F1 + i], s[F2 + i], s[F3 + i], s[F4 + i] = f1, f2, f3, f4


@subroutine
def _interleave(drone: Record, s: Record, i: int) -> None:
    """Write one drone's data into a batch, as drone number `i`."""
    for axis in range(3):
        at = LANES * axis + i
        s[X + at], s[VX + at] = drone.position[axis], drone.velocity[axis]
        s[P + at], s[PX + at] = drone.rates[axis], drone.push[axis]
    for k in range(4):
        s[QX + LANES * k + i], s[F1 + LANES * k + i] = drone.attitude[k], drone.thrust[k]
        s[ON + LANES * k + i] = 0.0 if drone.mode == OFF else drone.motor_share[k]
    px, py, pz = s[PX + i], s[PY + i], s[PZ + i]
    s[SHARE + i] = 1.0 / most(1e-9, math.sqrt(px * px + py * py + pz * pz))
    s[YAW_RATE + i] = drone.yaw_rate
    s[CEILING + i] = drone.thrust_limit


@subroutine
def _restore(drone: Record, s: Record, i: int) -> None:
    """Copy the data that a step changes from drone number `i` of a batch."""
    for axis in range(3):
        at = LANES * axis + i
        drone.position[axis], drone.velocity[axis] = s[X + at], s[VX + at]
        drone.rates[axis] = s[P + at]
    for k in range(4):
        drone.attitude[k], drone.thrust[k] = s[QX + LANES * k + i], s[F1 + LANES * k + i]


@subroutine
def _interleave_cascade(drone: Record, cascade: Record, s: Record, i: int) -> None:
    """Write the state of one drone's controller into a batch, as drone number `i`."""
    s[TARGET_ROLL + i], s[TARGET_PITCH + i] = cascade.target_tilt[0], cascade.target_tilt[1]
    s[TARGET_THRUST + i] = cascade.thrust
    roll, pitch = cascade.angles[0], cascade.angles[1]
    s[ROLL + i], s[PITCH + i], s[YAW_ERROR + i] = roll, pitch, cascade.yaw_error
    s[ROLL_SIN + i], s[ROLL_COS + i] = math.sin(roll), math.cos(roll)
    s[PITCH_TAN + i] = math.sin(pitch) / most(0.1, math.cos(pitch))
    for k in range(6):
        s[INTEGRAL + LANES * k + i] = cascade.attitude_integral[k]
    for axis in range(3):
        s[LAST_RATE + LANES * axis + i] = cascade.last_rates[axis]
    for k in range(GAINS.shape[1]):
        s[GAIN + LANES * k + i] = GAINS[cascade.controller, k]
    s[VOLTAGE + i] = drone.voltage
    if drone.charge <= 0.0:
        for motor in range(4):
            s[ON + LANES * motor + i] = 0.0


@subroutine
def _restore_cascade(cascade: Record, s: Record, i: int) -> None:
    """Copy what a step changes in the controller of drone number `i` of a batch."""
    cascade.angles[0], cascade.angles[1] = s[ROLL + i], s[PITCH + i]
    cascade.yaw_error = s[YAW_ERROR + i]
    for k in range(6):
        cascade.attitude_integral[k] = s[INTEGRAL + LANES * k + i]
    for axis in range(3):
        cascade.last_rates[axis] = s[LAST_RATE + LANES * axis + i]
    for motor in range(4):
        cascade.pwm[motor] = s[PWM + LANES * motor + i]
