"""Position and velocity control: from the commander's reference to a thrust vector, at 100 Hz.

The loops use the estimate, never the ground truth, so a drone drifts with its estimate.
"""

from __future__ import annotations

import math

from star_core.toolkit import subroutine, wrap_angle
from star_sim.airframe import CYCLE, GRAVITY, MASS
from star_sim.drone import DEMAND, FREE, OFF, POSITION, TRAJECTORY, Record

POSITION_GAIN = 2.0  # 1/s, the firmware's
POSITION_SPEED = 1.0  # m/s, greatest that the position loop asks for, along each axis; as firmware
VELOCITY_GAIN = 3.5  # 1/s; the firmware's 25° per m/s is 4.3, for a faster attitude loop
CLIMB_GAIN = 6.0  # 1/s
INTEGRAL_GAIN = 2.0  # 1/s²; the firmware's 1° per m is 0.17, too slow to cancel drag
INTEGRAL_LIMIT = 2.0  # m/s²
TILT_LIMIT = math.radians(20)  # the firmware's
TANGENT_LIMIT = math.tan(TILT_LIMIT)
LEAST_LIFT = 0.3 * MASS * GRAVITY  # N: enough to keep control of the attitude in a descent
MOST_LIFT = 1.5 * MASS * GRAVITY  # N
YAW_GAIN = 3.0  # 1/s
YAW_RATE_LIMIT = 2.0  # rad/s

wrap = subroutine(wrap_angle)  # callable from kernels


@subroutine
def aim(drone: Record) -> None:
    """Set the push and the yaw rate that take one drone to its reference.

    A P controller from position to velocity and a PI controller from velocity to acceleration, in
    the odometry frame; then the push for this acceleration, within the limits of lift and tilt,
    rotated to the map by the true heading: this is the effect of the body holding a roll and pitch
    that were computed with the estimated heading.
    """
    if drone.mode == OFF:
        drone.windup[0] = drone.windup[1] = drone.windup[2] = 0.0
        return
    for axis in range(3):
        gain = VELOCITY_GAIN if axis < 2 else CLIMB_GAIN  # noqa: PLR2004 -- z
        drone.push[axis] = _acceleration(drone, axis, gain)
    ax, ay, az = drone.push[0], drone.push[1], drone.push[2]
    lift = min(max(MASS * (az + GRAVITY), LEAST_LIFT), MOST_LIFT)
    cos, sin = drone.slip[0], drone.slip[1]
    east = MASS * (cos * ax + sin * ay)
    north = MASS * (cos * ay - sin * ax)
    share = min(1.0, TANGENT_LIMIT * lift / max(1e-9, math.sqrt(east * east + north * north)))
    drone.push[0], drone.push[1], drone.push[2] = share * east, share * north, lift
    if drone.mode == DEMAND and drone.axes[0] == FREE:
        _tilt(drone, lift)
    rate = YAW_GAIN * wrap(drone.reference_yaw - drone.believed_yaw)
    drone.yaw_rate = min(max(rate, -YAW_RATE_LIMIT), YAW_RATE_LIMIT)


@subroutine
def _tilt(drone: Record, lift: float) -> None:
    """Set the push along the body's z axis at the tilt of a demand.

    Args:
        drone: Its horizontal axes are FREE.
        lift: Vertical force of the height loop, N; used where z is not FREE.
    """
    cr, sr = math.cos(drone.tilt[0]), math.sin(drone.tilt[0])
    cp, sp = math.cos(drone.tilt[1]), math.sin(drone.tilt[1])
    force = drone.lift
    if drone.axes[2] != FREE:
        force = lift / max(0.5, cr * cp)  # up to 60°
    cy, sy = math.cos(drone.believed_yaw), math.sin(drone.believed_yaw)
    x, y = cy * sp * cr + sy * sr, sy * sp * cr - cy * sr
    cos, sin = drone.slip[0], drone.slip[1]
    drone.push[0], drone.push[1] = force * (cos * x + sin * y), force * (cos * y - sin * x)
    drone.push[2] = force * cr * cp
    drone.windup[0] = drone.windup[1] = 0.0


@subroutine
def _acceleration(drone: Record, axis: int, gain: float) -> float:
    """Return the commanded acceleration along one axis of the odometry frame, m/s².

    Without feed-forward a drone in position control tracks the position only, as with the
    firmware's default controller (``position_controller_pid.c``): it lags by 1/`POSITION_GAIN`.
    """
    target, ahead = drone.reference_velocity[axis], drone.reference_acceleration[axis]
    if drone.mode == TRAJECTORY or (drone.mode == DEMAND and drone.axes[axis] == POSITION):
        way = POSITION_GAIN * (drone.reference_position[axis] - drone.believed_position[axis])
        target *= drone.feed_forward
        ahead *= drone.feed_forward
        target += min(max(way, -POSITION_SPEED), POSITION_SPEED)
    missing = target - drone.believed_velocity[axis]
    windup = drone.windup[axis] + INTEGRAL_GAIN * CYCLE * missing
    drone.windup[axis] = windup = min(max(windup, -INTEGRAL_LIMIT), INTEGRAL_LIMIT)
    return float(ahead + gain * missing + windup)
