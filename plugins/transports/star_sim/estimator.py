"""The on-board state estimator of a drone with a Flow deck, at 100 Hz.

A constant-gain filter instead of the firmware's Kalman filter: velocity integrates the
accelerometer and is corrected by the flow sensor, height by the ranger, yaw integrates the gyro,
and position integrates velocity. `star_sim.sensors` models the sensor errors.
"""

from __future__ import annotations

import math

from star_sim.airframe import CYCLE, STEP, STEPS_PER_CYCLE, THRUST_MIN
from star_sim.compiled import Record, compiled
from star_sim.drone import OFF
from star_sim.position import wrap
from star_sim.sensors import GYRO_NOISE, flow, ranged

# Per cycle: what a Kalman filter settles at with the firmware's 0.5 m/s² of process and 2 counts of
# flow noise at 0.8 m, 0.005 m/s over 0.33 m/s.
FLOW_GAIN = 0.015
RANGER_CYCLES = 4  # 25 Hz
HEIGHT_GAIN = 0.2
CLIMB_GAIN = 0.5  # 1/s: HEIGHT_GAIN² / 2 over the ranger's period of 0.04 s
RESTING = 0.01  # m/s: slower with its motors off, a drone stands still and knows it


@compiled
def believe(
    drone: Record,
    cycle: int,
    normal: Record,
    texture: Record,
    noisy: bool,  # noqa: FBT001 -- a kernel's arguments have no names
    sample: Record,
) -> None:
    """Update the estimate of one drone after cycle number `cycle`, and write it into `sample`.

    Args:
        drone: The drone.
        cycle: Cycles since the start.
        normal: (4,) standard normal numbers: flow ahead, flow aside, gyro, ranger.
        texture: (M, M) scale error of the flow sensor over the floor, as a fraction.
        noisy: False copies the ground truth.
        sample: (8,) output: time s, velocity m/s in the level body frame, yaw rate rad/s,
            roll rad, pitch rad, height m.
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
        turned += CYCLE * (drone.gyro_bias + GYRO_NOISE * normal[2])
        drone.believed_yaw = wrap(drone.believed_yaw + turned)
    drone.believed_roll = math.atan2(2 * (qy * qz + qw * qx), upright) + drone.level_error[0]
    drone.believed_pitch = (
        math.asin(min(1.0, max(-1.0, 2 * (qw * qy - qx * qz)))) + drone.level_error[1]
    )
    cos, sin = math.cos(drone.believed_yaw), math.sin(drone.believed_yaw)
    east, north = east * level, north * level
    drone.slip[0], drone.slip[1] = cos * east + sin * north, sin * east - cos * north

    if not noisy:
        _know(drone)
    elif _rests(drone):
        for axis in range(3):
            drone.believed_velocity[axis] = 0.0
    else:
        _dead_reckon(drone, cycle, normal, texture, (cos, sin), upright)
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


@compiled
def _rests(drone: Record) -> bool:
    """Whether a drone is at rest with its motors off, so that its estimate does not drift."""
    speed = drone.velocity[0] ** 2 + drone.velocity[1] ** 2 + drone.velocity[2] ** 2
    return bool(drone.mode == OFF and drone.thrust[0] < THRUST_MIN and speed < RESTING**2)


@compiled
def _know(drone: Record) -> None:
    """Set the estimate to the true position and velocity, in the odometry frame."""
    x, y = drone.position[0] - drone.origin[0], drone.position[1] - drone.origin[1]
    cos, sin = drone.slip[0], drone.slip[1]
    drone.believed_position[0], drone.believed_position[1] = cos * x - sin * y, sin * x + cos * y
    drone.believed_position[2] = drone.position[2] - drone.origin[2]
    x, y = drone.velocity[0], drone.velocity[1]
    drone.believed_velocity[0], drone.believed_velocity[1] = cos * x - sin * y, sin * x + cos * y
    drone.believed_velocity[2] = drone.velocity[2]


@compiled
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
    ahead, aside = flow(drone, normal, texture, heading, height, upright)
    cos, sin = heading
    ahead = FLOW_GAIN * (ahead - cos * vx - sin * vy)
    aside = FLOW_GAIN * (aside - cos * vy + sin * vx)
    vx += cos * ahead - sin * aside
    vy += sin * ahead + cos * aside

    z = drone.believed_position[2] + CYCLE * vz
    if cycle % RANGER_CYCLES == 0:
        surprise = ranged(drone.position[2], normal[3]) - drone.origin[2] - z
        z += HEIGHT_GAIN * surprise
        vz += CLIMB_GAIN * surprise
    drone.believed_position[0] += CYCLE * vx
    drone.believed_position[1] += CYCLE * vy
    drone.believed_position[2] = z
    drone.believed_velocity[0], drone.believed_velocity[1] = vx, vy
    drone.believed_velocity[2] = vz
