"""The firmware's slow loop, at 100 Hz: position and velocity control, by PID or Mellinger's law.

Its gains and limits are the firmware's defaults. The loops use the estimate, never the ground
truth. Neither controller resets its integrals while the motors are on.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from star_core.toolkit import records, subroutine
from star_sim.airframe import CYCLE, GRAVITY
from star_sim.drone import DEMAND, FREE, OFF, POSITION, TRAJECTORY, VELOCITY, Record
from star_sim.position import wrap
from star_sim.powertrain import FIRMWARE_THRUST_MAX, FULL
from star_sim.stabilizer import MELLINGER, PID

CASCADE = np.dtype(
    [
        ("controller", "i8"),  # PID or MELLINGER
        ("target_tilt", "f8", 2),  # rad, roll and pitch (nose down positive)
        ("thrust", "f8"),  # command, of 65535 for each motor
        ("angles", "f8", 2),  # rad, believed roll and pitch
        ("yaw_error", "f8"),  # rad, commanded less believed heading
        # Integrals: of position, m s; of velocity ahead, aside and up, m; of the attitude, rad s;
        # and of the body rates, rad.
        ("position_integral", "f8", 3),
        ("velocity_integral", "f8", 3),
        ("attitude_integral", "f8", 6),
        ("last_rates", "f8", 3),  # rad/s, one step before
        ("height_integral_gain", "f8"),  # N/(m s), of Mellinger's law
        ("pwm", "f8", 4),  # of 65535, of each motor
    ],
    align=True,
)

Cascades: TypeAlias = NDArray[np.void]

CONTROLLERS: Final = {"pid": PID, "mellinger": MELLINGER}

# PID: ``position_controller_pid.c`` and ``platform_defaults_cf2.h``.
POSITION_GAIN = 2.0  # 1/s, PID_POS_X_KP, PID_POS_Z_KP
HEIGHT_INTEGRAL_GAIN = 0.5  # 1/s², PID_POS_Z_KI
SPEED_LIMIT = 1.0 * 1.1  # m/s along each axis, PID_POS_VEL_X_MAX times velMaxOverhead
TILT_GAIN = math.radians(25.0)  # rad s/m, PID_VEL_X_KP
TILT_INTEGRAL_GAIN = math.radians(1.0)  # rad/m, PID_VEL_X_KI
TILT_LIMIT = math.radians(20.0)  # PID_VEL_ROLL_MAX, PID_VEL_PITCH_MAX
CLIMB_GAIN = 25000.0  # of 65535, s/m, PID_VEL_Z_KP times thrustScale
CLIMB_INTEGRAL_GAIN = 15000.0  # of 65535, 1/m, PID_VEL_Z_KI times thrustScale
CLIMB_LIMIT = 32767.0  # of 65535
THRUST_BASE = 36000.0  # PID_VEL_THRUST_BASE
THRUST_LEAST = 20000.0  # PID_VEL_THRUST_MIN
INTEGRAL_LIMIT = 5000.0  # DEFAULT_PID_INTEGRATION_LIMIT of ``pid.h``

# Mellinger: ``controller_mellinger.c``.
FORCE_GAIN = (0.4, 0.4, 1.25)  # N/m, kp_xy, kp_z
DAMPING = (0.2, 0.2, 0.4)  # N s/m, kd_xy, kd_z
FORCE_INTEGRAL_GAIN = 0.05  # N/(m s), ki_xy
HEIGHT_FORCE_INTEGRAL_GAIN = 1.5  # N/(m s), ki_z
EARLIER_HEIGHT_GAIN = 0.05  # of firmware with which drones hover 0.10 m too low, as in NanoBench
FORCE_INTEGRAL_LIMIT = (2.0, 2.0, 0.4)  # m s, i_range_xy, i_range_z
BELIEVED_MASS = 0.029  # kg, CF_MASS
COMMAND_PER_FORCE = 132000.0  # of 65535 per N, massThrust
# Of velocity setpoints, as of the full states that the transport `radio` sends.
MAX_LEAD: Final = 0.15  # m
MAX_YAW_LEAD: Final = 0.5  # rad


def cascades(count: int, controller: int) -> Cascades:
    """Return the state of `count` controllers of drones that stand still, (N,) of `CASCADE`."""
    table = records(count, CASCADE)
    table["controller"] = controller
    table["height_integral_gain"] = HEIGHT_FORCE_INTEGRAL_GAIN
    return table


@subroutine
def regulate(drone: Record, cascade: Record, lead: Record) -> None:
    """Set the angles and the thrust that take one drone to its reference.

    PID tracks positions without feed-forward of velocity, so a drone trails a moving position by
    half a second. Mellinger's law tracks positions, velocities and accelerations; a velocity
    setpoint is a position that moves with it, at most `MAX_LEAD` in front of the drone along each
    axis.

    Args:
        drone: The drone.
        cascade: Its controller.
        lead: (3,) of Mellinger's moving position in front of the drone, m; None where no drone has
            that controller, which is not compiled then.
    """
    x, y, z, w = drone.attitude[0], drone.attitude[1], drone.attitude[2], drone.attitude[3]
    roll = math.atan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    pitch = math.asin(min(1.0, max(-1.0, 2 * (w * y - x * z))))
    cascade.angles[0] = roll + drone.tilt_error[0]
    cascade.angles[1] = pitch + drone.tilt_error[1]
    if drone.mode == OFF:
        _reset(cascade)
        if lead is not None:
            lead[0] = lead[1] = lead[2] = 0.0
        return
    cascade.yaw_error = wrap(drone.reference_yaw - drone.believed_yaw)
    if drone.mode == VELOCITY and cascade.controller == MELLINGER:
        cascade.yaw_error = min(max(cascade.yaw_error, -MAX_YAW_LEAD), MAX_YAW_LEAD)
    cos, sin = math.cos(drone.believed_yaw), math.sin(drone.believed_yaw)
    free = drone.mode == DEMAND and drone.axes[0] == FREE
    if lead is not None and cascade.controller == MELLINGER:
        _mellinger(drone, cascade, lead, cos, sin, 0.0 if free else 1.0)
    else:
        _steer(drone, cascade, cos, sin)
        _climb(drone, cascade)
    if free:
        cascade.target_tilt[0], cascade.target_tilt[1] = drone.tilt[0], drone.tilt[1]
    if drone.mode == DEMAND and drone.axes[2] == FREE:
        cascade.thrust = drone.lift * (FULL / (4 * FIRMWARE_THRUST_MAX))


@subroutine
def _reset(cascade: Record) -> None:
    """Forget everything, as the firmware does while the thrust is none."""
    cascade.thrust = 0.0
    cascade.yaw_error = 0.0
    for axis in range(3):
        cascade.position_integral[axis] = cascade.velocity_integral[axis] = 0.0
        cascade.attitude_integral[axis] = cascade.attitude_integral[axis + 3] = 0.0
    cascade.target_tilt[0], cascade.target_tilt[1] = cascade.angles[0], cascade.angles[1]


@subroutine
def _steer(drone: Record, cascade: Record, cos: float, sin: float) -> None:
    """Set the roll and pitch of the PID controller, from the horizontal axes of the reference."""
    east, north = drone.reference_velocity[0], drone.reference_velocity[1]
    ahead, aside = cos * east + sin * north, cos * north - sin * east
    if _position_controlled(drone, 0):
        east = drone.reference_position[0] - drone.believed_position[0]
        north = drone.reference_position[1] - drone.believed_position[1]
        ahead = POSITION_GAIN * (cos * east + sin * north)
        aside = POSITION_GAIN * (cos * north - sin * east)
        ahead = min(max(ahead, -SPEED_LIMIT), SPEED_LIMIT)
        aside = min(max(aside, -SPEED_LIMIT), SPEED_LIMIT)
    east, north = drone.believed_velocity[0], drone.believed_velocity[1]
    cascade.target_tilt[1] = _tilt(cascade, 0, ahead - cos * east - sin * north)
    cascade.target_tilt[0] = -_tilt(cascade, 1, aside - cos * north + sin * east)


@subroutine
def _tilt(cascade: Record, axis: int, missing: float) -> float:
    """Return the angle for a missing velocity, m/s, ahead or aside; the latter is rolled left."""
    summed = cascade.velocity_integral[axis] + CYCLE * missing
    summed = min(max(summed, -INTEGRAL_LIMIT), INTEGRAL_LIMIT)
    cascade.velocity_integral[axis] = summed
    angle = TILT_GAIN * missing + TILT_INTEGRAL_GAIN * summed
    return float(min(max(angle, -TILT_LIMIT), TILT_LIMIT))


@subroutine
def _climb(drone: Record, cascade: Record) -> None:
    """Set the thrust command of the PID controller, from the vertical axis of the reference."""
    target = drone.reference_velocity[2]
    if _position_controlled(drone, 2):
        way = drone.reference_position[2] - drone.believed_position[2]
        summed = cascade.position_integral[2] + CYCLE * way
        cascade.position_integral[2] = summed
        target = POSITION_GAIN * way + HEIGHT_INTEGRAL_GAIN * summed
        target = min(max(target, -SPEED_LIMIT), SPEED_LIMIT)
    missing = target - drone.believed_velocity[2]
    summed = cascade.velocity_integral[2] + CYCLE * missing
    cascade.velocity_integral[2] = summed
    more = CLIMB_GAIN * missing + CLIMB_INTEGRAL_GAIN * summed
    more = min(max(more, -CLIMB_LIMIT), CLIMB_LIMIT)
    cascade.thrust = min(max(THRUST_BASE + more, THRUST_LEAST), FULL)


@subroutine
def _position_controlled(drone: Record, axis: int) -> bool:
    """Whether an axis is under position control."""
    return bool(drone.mode == TRAJECTORY or (drone.mode == DEMAND and drone.axes[axis] == POSITION))


@subroutine
def _mellinger(
    drone: Record, cascade: Record, lead: Record, cos: float, sin: float, share: float
) -> None:
    """Set thrust, roll and pitch by Mellinger's law; `share` is of the horizontal force."""
    east, north = share * _force(drone, cascade, lead, 0), share * _force(drone, cascade, lead, 1)
    up = _force(drone, cascade, lead, 2) + BELIEVED_MASS * GRAVITY
    ahead, aside = cos * east + sin * north, cos * north - sin * east
    roll, pitch = cascade.angles[0], cascade.angles[1]
    along = math.cos(roll) * (math.sin(pitch) * ahead + math.cos(pitch) * up)
    along -= math.sin(roll) * aside
    cascade.thrust = min(max(COMMAND_PER_FORCE * along, 0.0), FULL)
    norm = max(1e-9, math.sqrt(ahead * ahead + aside * aside + up * up))
    cascade.target_tilt[0] = -math.asin(aside / norm)
    cascade.target_tilt[1] = math.atan2(ahead, up)


@subroutine
def _force(drone: Record, cascade: Record, lead: Record, axis: int) -> float:
    """Return the force along one axis of the odometry frame that its errors ask for, N."""
    velocity = drone.reference_velocity[axis]
    missing = velocity - drone.believed_velocity[axis]
    if _position_controlled(drone, axis):
        lead[axis] = 0.0
        way = drone.reference_position[axis] - drone.believed_position[axis]
        missing = velocity * drone.feed_forward - drone.believed_velocity[axis]
    else:
        way = lead[axis] + CYCLE * missing
        way = min(max(way, -MAX_LEAD), MAX_LEAD)
        lead[axis] = way
    limit = FORCE_INTEGRAL_LIMIT[axis]
    summed = min(max(cascade.position_integral[axis] + CYCLE * way, -limit), limit)
    cascade.position_integral[axis] = summed
    gain = cascade.height_integral_gain if axis == 2 else FORCE_INTEGRAL_GAIN  # noqa: PLR2004 -- z
    force = FORCE_GAIN[axis] * way + DAMPING[axis] * missing + gain * summed
    ahead = drone.reference_acceleration[axis] if drone.mode != VELOCITY else 0.0
    return float(BELIEVED_MASS * ahead * drone.feed_forward + force)
