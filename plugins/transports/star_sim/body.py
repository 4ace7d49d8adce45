"""Rigid body with four motors: semi-implicit Euler steps of 2 ms, eight drones at a time.

The data of eight drones is interleaved, so that the compiler can step four of them with each SIMD
instruction; the loop over them has no branch. This makes a step several times cheaper.
"""

from __future__ import annotations

import math

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
from star_sim.compiled import Record, compiled
from star_sim.drone import OFF

GRIP = 0.8  # of sideways speed and of body rates is left after a step on the floor
SETTLE = 0.9  # of the tilt is left after a step of standing on the floor

LANES = 8
BATCH_SIZE = 24 * LANES  # numbers, of eight drones

# Index in a batch of each number of the first drone; those of the others follow.
_X, _Y, _Z, _VX, _VY, _VZ, _QX, _QY, _QZ, _QW, _P, _Q, _R = (LANES * k for k in range(13))
_F1, _F2, _F3, _F4, _PX, _PY, _PZ, _SHARE, _YAW, _CEILING, _ON = (LANES * k for k in range(13, 24))

_GYROSCOPIC = (INERTIA_XY - INERTIA_Z) / INERTIA_XY


@compiled
def fly(drones: Record, first: int, steps: int, batch: Record) -> None:
    """Step up to eight drones from row `first` on by `steps` steps.

    Newton-Euler dynamics with a first-order lag of each motor's thrust, drag linear in the velocity
    along each body axis, and a floor at z = 0 that stops falling drones, holds their feet by
    friction and levels upright ones. Momentum is stepped first, then the pose with the new
    momentum.

    Args:
        drones: (N,) records.
        first: Row of the first.
        steps: Of 2 ms.
        batch: (BATCH_SIZE,) buffer.
    """
    count = min(LANES, len(drones) - first)
    for i in range(BATCH_SIZE):
        batch[i] = 0.0
    for i in range(LANES):
        batch[_QW + i] = 1.0  # of lanes without a drone
    for i in range(count):
        _interleave(drones[first + i], batch, i)
    for _ in range(steps):
        _step(batch)
    for i in range(count):
        _restore(drones[first + i], batch, i)


@compiled
def _step(s: Record) -> None:
    """Take one step of the eight drones interleaved in `s`, (BATCH_SIZE,)."""
    for i in range(LANES):
        vx, vy, vz = s[_VX + i], s[_VY + i], s[_VZ + i]
        qx, qy, qz, qw = s[_QX + i], s[_QY + i], s[_QZ + i], s[_QW + i]
        p, q, r = s[_P + i], s[_Q + i], s[_R + i]
        px, py, pz = s[_PX + i], s[_PY + i], s[_PZ + i]

        bx = 2 * (qx * qz + qw * qy)  # the body's z axis in the map
        by = 2 * (qy * qz - qw * qx)
        bz = 1 - 2 * (qx * qx + qy * qy)
        lift = most(0.0, bx * px + by * py + bz * pz)
        ahead = s[_SHARE + i] * (
            (1 - 2 * (qy * qy + qz * qz)) * px
            + 2 * (qx * qy + qw * qz) * py
            + 2 * (qx * qz - qw * qy) * pz
        )
        aside = s[_SHARE + i] * (
            2 * (qx * qy - qw * qz) * px
            + (1 - 2 * (qx * qx + qz * qz)) * py
            + 2 * (qy * qz + qw * qx) * pz
        )
        w1, w2, w3, w4 = mix(lift, aside, ahead, s[_YAW + i], (p, q, r), s[_CEILING + i])
        f1 = s[_F1 + i] + MOTOR_STEP * (s[_ON + i] * w1 - s[_F1 + i])
        f2 = s[_F2 + i] + MOTOR_STEP * (s[_ON + i] * w2 - s[_F2 + i])
        f3 = s[_F3 + i] + MOTOR_STEP * (s[_ON + i] * w3 - s[_F3 + i])
        f4 = s[_F4 + i] + MOTOR_STEP * (s[_ON + i] * w4 - s[_F4 + i])

        p, q, r = (
            p + STEP * (ARM / INERTIA_XY * (-f1 - f2 + f3 + f4) + _GYROSCOPIC * q * r),
            q + STEP * (ARM / INERTIA_XY * (-f1 + f2 + f3 - f4) - _GYROSCOPIC * p * r),
            r + STEP * (TORQUE_PER_THRUST / INERTIA_Z * (-f1 + f2 - f3 + f4)),
        )
        along = f1 + f2 + f3 + f4 - (DRAG_Z - DRAG_XY) * (bx * vx + by * vy + bz * vz)
        vx += STEP / MASS * (along * bx - DRAG_XY * vx)
        vy += STEP / MASS * (along * by - DRAG_XY * vy)
        vz += STEP / MASS * (along * bz - DRAG_XY * vz) - STEP * GRAVITY

        qx, qy, qz, qw = (
            qx + 0.5 * STEP * (qw * p + qy * r - qz * q),
            qy + 0.5 * STEP * (qw * q + qz * p - qx * r),
            qz + 0.5 * STEP * (qw * r + qx * q - qy * p),
            qw - 0.5 * STEP * (qx * p + qy * q + qz * r),
        )
        z = s[_Z + i] + STEP * vz
        below = z < 0.0
        grip = GRIP if below else 1.0
        settled = SETTLE if below and bz > 0.0 else 1.0  # without tilt x and y are 0
        qx, qy = settled * qx, settled * qy
        unit = 1.0 / math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)

        s[_X + i] += STEP * vx
        s[_Y + i] += STEP * vy
        s[_Z + i] = most(0.0, z)
        s[_VX + i], s[_VY + i] = grip * vx, grip * vy
        s[_VZ + i] = 0.0 if below and vz < 0.0 else vz
        s[_QX + i], s[_QY + i], s[_QZ + i], s[_QW + i] = unit * qx, unit * qy, unit * qz, unit * qw
        s[_P + i], s[_Q + i], s[_R + i] = grip * p, grip * q, grip * r
        s[_F1 + i], s[_F2 + i], s[_F3 + i], s[_F4 + i] = f1, f2, f3, f4


@compiled
def _interleave(drone: Record, s: Record, i: int) -> None:
    """Write one drone's data into a batch, as drone number `i`."""
    for axis in range(3):
        at = LANES * axis + i
        s[_X + at], s[_VX + at] = drone.position[axis], drone.velocity[axis]
        s[_P + at], s[_PX + at] = drone.rates[axis], drone.push[axis]
    for k in range(4):
        s[_QX + LANES * k + i], s[_F1 + LANES * k + i] = drone.attitude[k], drone.thrust[k]
    px, py, pz = s[_PX + i], s[_PY + i], s[_PZ + i]
    s[_SHARE + i] = 1.0 / most(1e-9, math.sqrt(px * px + py * py + pz * pz))
    s[_YAW + i] = drone.yaw_rate
    s[_CEILING + i] = drone.thrust_limit
    s[_ON + i] = 0.0 if drone.mode == OFF else 1.0


@compiled
def _restore(drone: Record, s: Record, i: int) -> None:
    """Copy the data that a step changes from drone number `i` of a batch."""
    for axis in range(3):
        at = LANES * axis + i
        drone.position[axis], drone.velocity[axis] = s[_X + at], s[_VX + at]
        drone.rates[axis] = s[_P + at]
    for k in range(4):
        drone.attitude[k], drone.thrust[k] = s[_QX + LANES * k + i], s[_F1 + LANES * k + i]
