"""Motors, propellers and battery under load of the Crazyflie 2.1 that flew NanoBench.

Identified from flights of NanoBench (Ullah and Baca, arXiv 2603.09908, 2026; brushed Crazyflie 2.1
under Vicon) by ``benchmarks/identify.py``. Flights give accelerations; the forces here are those of
a drone with the mass of `star_sim.airframe`.

The firmware assumes the thrust of another motor, that of the 2.1+ (`FIRMWARE_THRUST`): it inverts
this curve and divides by the measured voltage to find the PWM of a motor.
"""

from __future__ import annotations

import math

from star_core.toolkit import subroutine
from star_sim.airframe import INERTIA_XY, STEP
from star_sim.batch import QW, QX, QY, QZ, VX, VY, VZ, P, Q
from star_sim.drone import Record

# Thrust of one motor over the square of its mean voltage, which is its share of PWM times the
# battery's voltage.
THRUST_PER_SQUARED_VOLTAGE = 0.00897  # N/V²
MOTOR_LAG = 0.069  # s, of the thrust after the PWM
DRAG = 0.0125  # N s/m, along the body's x and its y axis
# Of the air on the propellers, which are above the centre of mass and flap: it raises the side that
# moves ahead, and lets a drone tilt less than its controller wants.
MOMENT = 4.66e-4  # N m / (m/s)

# ``platform_defaults_cf2.h``: VMOTOR2THRUST0 to 3 of the 2.1+, THRUST_MIN, THRUST_MAX.
FIRMWARE_THRUST = (
    -0.02476537915958403,  # N, of one motor
    0.06523793527519485,  # N/V
    -0.026792504967750107,  # N/V²
    0.006776789303971145,  # N/V³
)
FIRMWARE_THRUST_MIN = 0.012817578393224994  # N; a motor that should give less is stopped
FIRMWARE_THRUST_MAX = 0.12  # N, at a thrust command of 65535
FULL = 65535.0  # greatest PWM; also the unit of thrust commands

# V, V/N, ...: the inverse of FIRMWARE_THRUST within 0.12 V up to 0.3 N, to start Newton's method.
_START = (0.2933292, 39.3776976, -162.510797, 257.239973)

_LAG_STEP = 1.0 - math.exp(-STEP / MOTOR_LAG)  # of the way to the commanded thrust, in one step


@subroutine
def turn(s: Record, i: int) -> None:
    """Step the rates of drone number `i` in a batch under the moment of the air."""
    x, y, z, w = s[QX + i], s[QY + i], s[QZ + i], s[QW + i]
    vx, vy, vz = s[VX + i], s[VY + i], s[VZ + i]
    ahead = (1 - 2 * (y * y + z * z)) * vx + 2 * (x * y + w * z) * vy + 2 * (x * z - w * y) * vz
    aside = 2 * (x * y - w * z) * vx + (1 - 2 * (x * x + z * z)) * vy + 2 * (y * z + w * x) * vz
    s[P + i] += STEP * MOMENT / INERTIA_XY * aside
    s[Q + i] -= STEP * MOMENT / INERTIA_XY * ahead


@subroutine
def motor_voltage(command: float) -> float:
    """Return the voltage that the firmware gives a motor for a thrust command of 65535.

    It solves the cubic `FIRMWARE_THRUST` (``motorsCompensateBatteryVoltage`` in ``motors.c``), here
    by two steps of Newton's method, exact to 5 µV up to twice the full command.

    Example:
        >>> round(motor_voltage(65535.0), 3)
        3.08
    """
    thrust = command * (FIRMWARE_THRUST_MAX / FULL)
    a, b, c, d = FIRMWARE_THRUST
    p, q, r, s = _START
    volts = p + thrust * (q + thrust * (r + thrust * s))
    for _ in range(2):
        missing = a + volts * (b + volts * (c + volts * d)) - thrust
        volts -= missing / (b + volts * (2 * c + volts * 3 * d))
    return volts if thrust >= FIRMWARE_THRUST_MIN else 0.0


@subroutine
def motor_thrust(thrust: float, voltage: float) -> float:
    """Return a motor's thrust one step later, N, at a mean voltage, V."""
    return thrust + _LAG_STEP * (THRUST_PER_SQUARED_VOLTAGE * voltage * voltage - thrust)
