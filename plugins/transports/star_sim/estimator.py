"""The on-board state estimator of a drone with a Flow deck, at 100 Hz.

A constant-gain filter instead of the firmware's Kalman filter: velocity integrates the
accelerometer and is corrected by the flow sensor, height by the ranger, yaw integrates the gyro,
and position integrates velocity. With an IMU's errors, roll and pitch integrate the gyro and are
corrected by the flow sensor too: a wrong tilt shows as a wrong acceleration. Without, they are
true but for a constant error. `star_sim.sensors` models the sensor errors.
"""

from __future__ import annotations

import math

from star_core.toolkit import subroutine
from star_sim.airframe import CYCLE, GRAVITY, STEP, STEPS_PER_CYCLE, THRUST_MIN
from star_sim.drone import OFF, Record
from star_sim.position import wrap
from star_sim.sensors import flow, ranged

# Per cycle: what a Kalman filter settles at with the firmware's 0.5 m/s² of process and 2 counts of
# flow noise at 0.8 m, 0.005 m/s over 0.33 m/s.
FLOW_GAIN = 0.015
# With an IMU: the same filter of a velocity and the tilt that makes it wrong, with the firmware's
# gyro noise of 0.1 rad/s as well.
IMU_FLOW_GAIN = 0.0284
TILT_GAIN = 0.0030  # rad per m/s
RANGER_CYCLES = 4  # 25 Hz
HEIGHT_GAIN = 0.2
CLIMB_GAIN = 0.5  # 1/s: HEIGHT_GAIN² / 2 over the ranger's period of 0.04 s
# With an IMU: what a Kalman filter settles at with the firmware's 1 m/s² of process noise and
# 2.5 mm of ranger noise at 40 Hz, 2 of 5 cycles. A constant error of the accelerometer makes the
# vertical velocity wrong by 0.09 s times that error.
IMU_HEIGHT_GAIN = 0.432
IMU_CLIMB_GAIN = 4.75  # 1/s
SAMPLE = 13  # numbers of a sample
RESTING = 0.01  # m/s: slower with its motors off, a drone stands still and knows it


@subroutine
def believe(
    drone: Record,
    cycle: int,
    normal: Record,
    texture: Record,
    noisy: bool,  # noqa: FBT001 -- a kernel's arguments have no names
    imu: Record,
    sample: Record,
) -> None:
    """Update the estimate of one drone after cycle number `cycle`, and write it into `sample`.

    Args:
        drone: The drone.
        cycle: Cycles since the start.
        normal: (4,) standard normal numbers: flow ahead, flow aside, gyro, ranger.
        texture: (M, M) scale error of the flow sensor over the floor, as a fraction.
        noisy: False copies the ground truth.
        imu: (WANDERING,) errors of `Wander.block`; None without an IMU.
        sample: (SAMPLE,) output: time s, velocity m/s in the level body frame, yaw rate rad/s,
            roll rad, pitch rad, height m, x m, y m, yaw rad, specific force along x and y of the
            body m/s².
    """
    qx, qy = drone.attitude[0], drone.attitude[1]
    qz, qw = drone.attitude[2], drone.attitude[3]
    upright = 1 - 2 * (qx * qx + qy * qy)
    east, north = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy + qw * qz)
    yaw = math.atan2(north, east)
    level = 1.0 / max(1e-9, math.sqrt(east * east + north * north))
    turned = wrap(yaw - drone.seen_yaw)
    if not noisy:
        drone.believed_yaw = wrap(yaw - drone.origin_yaw)
    elif not _rests(drone):
        if imu is None:
            turned += CYCLE * (drone.gyro_bias + drone.gyro_noise * normal[2])
        else:
            _tilt(drone, turned, imu)
            turned += CYCLE * (drone.gyro_bias + imu[3])
        drone.believed_yaw = wrap(drone.believed_yaw + turned)
    error = drone.level_error if imu is None else drone.tilt_error
    drone.believed_roll = math.atan2(2 * (qy * qz + qw * qx), upright) + error[0]
    drone.believed_pitch = math.asin(min(1.0, max(-1.0, 2 * (qw * qy - qx * qz)))) + error[1]
    _feel(drone, imu, sample)
    cos, sin = math.cos(drone.believed_yaw), math.sin(drone.believed_yaw)
    east, north = east * level, north * level
    drone.slip[0], drone.slip[1] = cos * east + sin * north, sin * east - cos * north

    if not noisy:
        _know(drone)
    elif _rests(drone):
        for axis in range(3):
            drone.believed_velocity[axis] = 0.0
    elif imu is None:
        _dead_reckon(drone, cycle, normal, texture, (cos, sin), upright)
    else:
        _reckon_with_imu(drone, cycle, normal, texture, (cos, sin), upright, imu)
    for axis in range(3):
        drone.seen_position[axis] = drone.position[axis]
        drone.seen_velocity[axis] = drone.velocity[axis]
    drone.seen_yaw = yaw

    vx, vy = drone.believed_velocity[0], drone.believed_velocity[1]
    sample[0] = cycle * STEPS_PER_CYCLE * STEP
    sample[1], sample[2] = cos * vx + sin * vy, cos * vy - sin * vx
    sample[3] = drone.believed_velocity[2]
    sample[4] = turned / CYCLE
    sample[5], sample[6] = drone.believed_roll, drone.believed_pitch
    sample[7] = drone.believed_position[2]
    sample[8], sample[9] = drone.believed_position[0], drone.believed_position[1]
    sample[10] = drone.believed_yaw


@subroutine
def _feel(drone: Record, imu: Record, sample: Record) -> None:
    """Write what the accelerometer measures along x and y of the body in a cycle, m/s².

    The propellers push along z, so it is the drag of the air, and what the sensor errs by. The mean
    velocity change of the cycle is turned by the attitude in its middle.
    """
    qx, qy, qz, qw = drone.attitude[0], drone.attitude[1], drone.attitude[2], drone.attitude[3]
    dx = (drone.velocity[0] - drone.seen_velocity[0]) / CYCLE
    dy = (drone.velocity[1] - drone.seen_velocity[1]) / CYCLE
    dz = (drone.velocity[2] - drone.seen_velocity[2]) / CYCLE + GRAVITY
    ahead = (1 - 2 * (qy * qy + qz * qz)) * dx + 2 * (qx * qy + qw * qz) * dy
    ahead += 2 * (qx * qz - qw * qy) * dz
    aside = 2 * (qx * qy - qw * qz) * dx + (1 - 2 * (qx * qx + qz * qz)) * dy
    aside += 2 * (qy * qz + qw * qx) * dz
    lift = 2 * (qx * qz + qw * qy) * dx + 2 * (qy * qz - qw * qx) * dy
    lift += (1 - 2 * (qx * qx + qy * qy)) * dz
    ahead += 0.5 * CYCLE * drone.rates[1] * lift
    aside -= 0.5 * CYCLE * drone.rates[0] * lift
    if imu is not None:
        ahead += drone.accelerometer_bias[0] + imu[4]
        aside += drone.accelerometer_bias[1] + imu[5]
    sample[11], sample[12] = ahead, aside


@subroutine
def _rests(drone: Record) -> bool:
    """Whether a drone is at rest with its motors off, so that its estimate does not drift."""
    speed = drone.velocity[0] ** 2 + drone.velocity[1] ** 2 + drone.velocity[2] ** 2
    return bool(drone.mode == OFF and drone.thrust[0] < THRUST_MIN and speed < RESTING**2)


@subroutine
def _know(drone: Record) -> None:
    """Set the estimate to the true position and velocity, in the odometry frame."""
    x, y = drone.position[0] - drone.origin[0], drone.position[1] - drone.origin[1]
    cos, sin = drone.slip[0], drone.slip[1]
    drone.believed_position[0], drone.believed_position[1] = cos * x - sin * y, sin * x + cos * y
    drone.believed_position[2] = drone.position[2] - drone.origin[2]
    x, y = drone.velocity[0], drone.velocity[1]
    drone.believed_velocity[0], drone.believed_velocity[1] = cos * x - sin * y, sin * x + cos * y
    drone.believed_velocity[2] = drone.velocity[2]


@subroutine
def _dead_reckon(
    drone: Record,
    cycle: int,
    normal: Record,
    texture: Record,
    heading: tuple[float, float],
    upright: float,
) -> None:
    """Update the estimated position and velocity with the measurements of one cycle."""
    cos, sin = drone.slip[0], drone.slip[1]
    dx = drone.velocity[0] - drone.seen_velocity[0]
    dy = drone.velocity[1] - drone.seen_velocity[1]
    vx = drone.believed_velocity[0] + cos * dx - sin * dy
    vy = drone.believed_velocity[1] + sin * dx + cos * dy
    vz = drone.believed_velocity[2] + drone.velocity[2] - drone.seen_velocity[2]

    height = drone.believed_position[2] + drone.origin[2]
    ahead, aside = flow(drone, normal, texture, heading, height, upright, 0.0)
    cos, sin = heading
    gain = drone.flow_share * FLOW_GAIN
    ahead = gain * (ahead - cos * vx - sin * vy)
    aside = gain * (aside - cos * vy + sin * vx)
    vx += cos * ahead - sin * aside
    vy += sin * ahead + cos * aside

    z = drone.believed_position[2] + CYCLE * vz
    if cycle % RANGER_CYCLES == 0:
        surprise = ranged(drone.position[2], normal[3]) + drone.ranger_bias - drone.origin[2] - z
        surprise *= drone.ranger_share
        z += HEIGHT_GAIN * surprise
        vz += CLIMB_GAIN * surprise
    drone.believed_position[0] += CYCLE * vx
    drone.believed_position[1] += CYCLE * vy
    drone.believed_position[2] = z
    drone.believed_velocity[0], drone.believed_velocity[1] = vx, vy
    drone.believed_velocity[2] = vz


@subroutine
def _tilt(drone: Record, turned: float, imu: Record) -> None:
    """Carry the error of the estimated tilt through one cycle.

    Args:
        drone: The drone.
        turned: Change of its true yaw, rad: an error that stays in the map turns in the body.
        imu: (WANDERING,) errors.
    """
    roll, pitch = drone.tilt_error[0], drone.tilt_error[1]
    drone.tilt_error[0] = roll + turned * pitch + CYCLE * imu[1]
    drone.tilt_error[1] = pitch - turned * roll + CYCLE * imu[2]


@subroutine
def _reckon_with_imu(
    drone: Record,
    cycle: int,
    normal: Record,
    texture: Record,
    heading: tuple[float, float],
    upright: float,
    imu: Record,
) -> None:
    """Update the estimated position, velocity and tilt with the measurements of one cycle.

    The accelerometer measures the specific force in the body, which the estimator turns by its
    wrong tilt: the acceleration is wrong by the cross product of tilt error and force, and by the
    accelerometer's own error.
    """
    cos, sin = drone.slip[0], drone.slip[1]
    dx = drone.velocity[0] - drone.seen_velocity[0]
    dy = drone.velocity[1] - drone.seen_velocity[1]
    dx, dy, dz = cos * dx - sin * dy, sin * dx + cos * dy, drone.velocity[2]
    dz -= drone.seen_velocity[2]
    cos, sin = heading
    ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
    roll, pitch = drone.tilt_error[0], drone.tilt_error[1]
    lift = dz + CYCLE * GRAVITY
    bias = drone.accelerometer_bias
    ahead += pitch * lift + CYCLE * (bias[0] + imu[4])
    aside += -roll * lift + CYCLE * (bias[1] + imu[5])
    ahead += cos * drone.believed_velocity[0] + sin * drone.believed_velocity[1]
    aside += cos * drone.believed_velocity[1] - sin * drone.believed_velocity[0]
    vz = drone.believed_velocity[2] + dz + CYCLE * (bias[2] + imu[6])

    height = drone.believed_position[2]
    seen_ahead, seen_aside = flow(drone, normal, texture, heading, height, upright, imu[0])
    seen_ahead += height * imu[2] - ahead  # the body's rotation is compensated with the gyro
    seen_aside += -height * imu[1] - aside
    seen_ahead *= drone.flow_share
    seen_aside *= drone.flow_share
    drone.tilt_error[0] -= TILT_GAIN * seen_aside
    drone.tilt_error[1] += TILT_GAIN * seen_ahead
    ahead += IMU_FLOW_GAIN * seen_ahead
    aside += IMU_FLOW_GAIN * seen_aside

    z = drone.believed_position[2] + CYCLE * vz
    if 2 * cycle % 5 < 2:  # noqa: PLR2004 -- 40 Hz
        surprise = ranged(drone.position[2] - drone.surface, normal[3]) + drone.ranger_bias - z
        surprise *= drone.ranger_share
        z += IMU_HEIGHT_GAIN * surprise
        vz += IMU_CLIMB_GAIN * surprise
    vx, vy = cos * ahead - sin * aside, sin * ahead + cos * aside
    drone.believed_position[0] += CYCLE * vx
    drone.believed_position[1] += CYCLE * vy
    drone.believed_position[2] = z
    drone.believed_velocity[0], drone.believed_velocity[1] = vx, vy
    drone.believed_velocity[2] = vz


@subroutine
def lean(drone: Record) -> None:
    """Turn the push of one drone by the error of its estimated tilt.

    The attitude loop holds the tilt that the position loop asks for by its estimate, so the body
    has another one.
    """
    if drone.mode == OFF:
        return
    cos, sin = math.cos(drone.believed_yaw), math.sin(drone.believed_yaw)
    level_cos, level_sin = drone.slip[0], drone.slip[1]
    # The heading of the body in the map: the believed one less the slip.
    east, north = level_cos * cos + level_sin * sin, level_cos * sin - level_sin * cos
    ahead, aside = -drone.push[2] * drone.tilt_error[1], drone.push[2] * drone.tilt_error[0]
    drone.push[0] += east * ahead - north * aside
    drone.push[1] += north * ahead + east * aside
