"""The attitude loop: from the commanded push to the thrust of each motor, at 500 Hz.

Attitude and body rates are the true ones: the drift of a Flow deck is in position and yaw, while
roll and pitch of the firmware's filter stay within 0.3°.
"""

from __future__ import annotations

from star_core.toolkit import subroutine
from star_sim.airframe import ARM, INERTIA_XY, INERTIA_Z, THRUST_MIN, TORQUE_PER_THRUST

ATTITUDE_GAIN = 8.0  # 1/s; the firmware's is 6, made for a faster rate loop
RATE_GAIN = 20.0  # 1/s: damping 0.65 with a motor lag of 0.03 s
YAW_RATE_GAIN = 10.0  # 1/s: the propellers' torque about z is weak

_THRUST_PER_RATE = INERTIA_XY * RATE_GAIN / (4 * ARM)  # N s/rad, of one motor
_THRUST_PER_YAW_RATE = INERTIA_Z * YAW_RATE_GAIN / (4 * TORQUE_PER_THRUST)  # N s/rad


@subroutine
def most(a: float, b: float) -> float:
    """Return the greater of two numbers; `max` minds what is not a number and is slower for it."""
    return a if a > b else b  # noqa: FURB136 -- see above


@subroutine
def mix(
    lift: float,
    aside: float,
    ahead: float,
    yaw_rate: float,
    rates: tuple[float, float, float],
    ceiling: float,
) -> tuple[float, float, float, float]:
    """Return the thrust that each motor should give, N.

    The tilt that is missing is turned into a body rate, the rate that is missing into a torque, and
    collective thrust and torque into four motors (the mixer of the firmware's
    ``power_distribution_quadrotor.c``). Where a motor would exceed its limit all are lowered by as
    much: attitude goes before height.

    Args:
        lift: Wanted collective thrust along the body's z axis, N.
        aside: y component in the body of the unit vector of the commanded push.
        ahead: Its x component.
        yaw_rate: Wanted, rad/s.
        rates: Body rates, rad/s.
        ceiling: Greatest thrust of one motor, N.
    """
    roll = _THRUST_PER_RATE * (-ATTITUDE_GAIN * aside - rates[0])
    pitch = _THRUST_PER_RATE * (ATTITUDE_GAIN * ahead - rates[1])
    yaw = _THRUST_PER_YAW_RATE * (yaw_rate - rates[2])
    each = 0.25 * lift
    first = each - roll - pitch - yaw
    second = each - roll + pitch + yaw
    third = each + roll + pitch - yaw
    fourth = each + roll - pitch + yaw
    excess = most(0.0, most(most(first, second), most(third, fourth)) - ceiling)
    floor = -most(-THRUST_MIN, -ceiling)
    return (
        most(first - excess, floor),
        most(second - excess, floor),
        most(third - excess, floor),
        most(fourth - excess, floor),
    )
