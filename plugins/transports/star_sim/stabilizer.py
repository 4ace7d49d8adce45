"""The firmware's fast loop, at 500 Hz: attitude and rate control, and the PWM of each motor.

Both of the firmware's controllers have the same form here, and differ in their gains: attitude to
body rate to torque command (``attitude_pid_controller.c``), or the moment of Mellinger's controller
(``controller_mellinger.c``) as such a cascade, linear in the error of the angles. Their low-pass
filters are off by default. The attitude is the estimator's, the rates are the true ones.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core.toolkit import subroutine
from star_sim.airframe import STEP
from star_sim.attitude import most
from star_sim.batch import (
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
    ROLL,
    ROLL_COS,
    ROLL_SIN,
    TARGET_PITCH,
    TARGET_ROLL,
    TARGET_THRUST,
    VOLTAGE,
    YAW_ERROR,
    P,
    Q,
    R,
)
from star_sim.drone import Record
from star_sim.powertrain import FULL, motor_thrust, motor_voltage

PID, MELLINGER = 0, 1  # rows of `GAINS`

_DEGREE = math.radians(1.0)

# Rows: PID (``platform_defaults_cf2.h``); Mellinger (``controller_mellinger.c``: kR_xy 70000,
# kw_xy 20000, kd_omega_rp 200, kR_z 60000, kw_z 12000, ki_m_z 500, with an error of the attitude
# that is twice the angle). Columns: roll and pitch, yaw.
GAINS: Final = np.hstack(
    [
        [  # 1/s, 1/s², then of 65535: s/rad, 1/rad, s²/rad
            [6.0, 3.0, 250 / _DEGREE, 500 / _DEGREE, 2.5 / _DEGREE],
            [2 * 70000 / 20000, 0.0, 20000.0, 0.0, 200.0],
        ],
        [  # the same, but for the last: derivative of the angle, without unit
            [6.0, 1.0, 120 / _DEGREE, 16.7 / _DEGREE, 0.35],
            [2 * 60000 / 12000, 2 * 500 / 12000, 12000.0, 0.0, 0.0],
        ],
    ]
)

# Limits of the integrals: PID_ROLL_INTEGRATION_LIMIT 20, PID_YAW_INTEGRATION_LIMIT 360,
# PID_ROLL_RATE_INTEGRATION_LIMIT 33.3, PID_YAW_RATE_INTEGRATION_LIMIT 166.7, in degrees.
TILT_INTEGRAL, YAW_INTEGRAL = 20 * _DEGREE, 360 * _DEGREE  # rad s
TILT_RATE_INTEGRAL, YAW_RATE_INTEGRAL = 33.3 * _DEGREE, 166.7 * _DEGREE  # rad
TORQUE_LIMIT = 32767.0  # of a thrust command: they are 16-bit numbers


@subroutine
def within(value: float, limit: float) -> float:
    """Return a value clipped to plus or minus a limit."""
    return -most(-most(value, -limit), -limit)


@subroutine
def stabilize(s: Record, i: int) -> tuple[float, float, float, float]:
    """Return the motors' thrust of drone number `i` in a batch, by the firmware's controllers.

    Within a cycle of five steps angles are advanced by the rates, at the tilt of its start.
    """
    p, q, r = s[P + i], s[Q + i], s[R + i]
    turning = s[ROLL_SIN + i] * q + s[ROLL_COS + i] * r
    roll = s[ROLL + i] + STEP * (p + s[PITCH_TAN + i] * turning)
    pitch = s[PITCH + i] + STEP * (s[ROLL_COS + i] * q - s[ROLL_SIN + i] * r)
    yaw_error = s[YAW_ERROR + i] - STEP * r
    s[ROLL + i], s[PITCH + i], s[YAW_ERROR + i] = roll, pitch, yaw_error

    torque_x = 0.5 * _tilt_torque(s, i, 0, s[TARGET_ROLL + i] - roll, p)
    torque_y = 0.5 * _tilt_torque(s, i, 1, s[TARGET_PITCH + i] - pitch, q)
    torque_z = _yaw_torque(s, i, yaw_error, r)

    # ``power_distribution_quadrotor.c``: commands to motors, compensation of the battery's
    # voltage, then all are lowered by what the greatest has too much.
    thrust, volts = s[TARGET_THRUST + i], s[VOLTAGE + i]
    s[PWM + i] = thrust - torque_x - torque_y - torque_z
    s[PWM + LANES + i] = thrust - torque_x + torque_y + torque_z
    s[PWM + 2 * LANES + i] = thrust + torque_x + torque_y - torque_z
    s[PWM + 3 * LANES + i] = thrust + torque_x - torque_y + torque_z
    for motor in range(4):
        at = PWM + LANES * motor + i
        s[at] = motor_voltage(s[at])
    v1, v2 = s[PWM + i], s[PWM + LANES + i]
    v3, v4 = s[PWM + 2 * LANES + i], s[PWM + 3 * LANES + i]
    excess = most(0.0, most(most(v1, v2), most(v3, v4)) - volts)
    v1, v2 = s[ON + i] * most(0.0, v1 - excess), s[ON + LANES + i] * most(0.0, v2 - excess)
    v3 = s[ON + 2 * LANES + i] * most(0.0, v3 - excess)
    v4 = s[ON + 3 * LANES + i] * most(0.0, v4 - excess)
    share = FULL / volts
    s[PWM + i], s[PWM + LANES + i] = share * v1, share * v2
    s[PWM + 2 * LANES + i], s[PWM + 3 * LANES + i] = share * v3, share * v4
    return (
        motor_thrust(s[F1 + i], v1),
        motor_thrust(s[F2 + i], v2),
        motor_thrust(s[F3 + i], v3),
        motor_thrust(s[F4 + i], v4),
    )


@subroutine
def _tilt_torque(s: Record, i: int, axis: int, error: float, rate: float) -> float:
    """Return the torque command of roll (axis 0) or pitch (1) from the error of its angle, rad."""
    at = LANES * axis + i
    summed = within(s[INTEGRAL + at] + STEP * error, TILT_INTEGRAL)
    s[INTEGRAL + at] = summed
    lacking = s[GAIN + i] * error + s[GAIN + LANES + i] * summed - rate
    at += 3 * LANES
    summed = within(s[INTEGRAL + at] + STEP * lacking, TILT_RATE_INTEGRAL)
    s[INTEGRAL + at] = summed
    at = LAST_RATE + LANES * axis + i
    turned = (rate - s[at]) / STEP
    s[at] = rate
    torque = s[GAIN + 2 * LANES + i] * lacking + s[GAIN + 3 * LANES + i] * summed
    return within(torque - s[GAIN + 4 * LANES + i] * turned, TORQUE_LIMIT)


@subroutine
def _yaw_torque(s: Record, i: int, error: float, rate: float) -> float:
    """Return the torque command of yaw from the error of the heading, rad."""
    at = INTEGRAL + 2 * LANES + i
    summed = within(s[at] + STEP * error, YAW_INTEGRAL)
    s[at] = summed
    gain = GAIN + 5 * LANES + i
    lacking = s[gain] * error + s[gain + LANES] * summed - (1 + s[gain + 4 * LANES]) * rate
    at += 3 * LANES
    summed = within(s[at] + STEP * lacking, YAW_RATE_INTEGRAL)
    s[at] = summed
    torque = s[gain + 2 * LANES] * lacking + s[gain + 3 * LANES] * summed
    return within(torque, TORQUE_LIMIT)
