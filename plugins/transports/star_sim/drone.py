"""Complete state of each simulated drone: one record per agent.

One table instead of forty arrays keeps kernel calls cheap (each array argument costs as much as a
step of one drone) and the data of one drone together in the cache.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from star_core.toolkit import records
from star_sim import airframe, discharge

# What flies a drone: nothing, its commander, velocity setpoints, or a setpoint of `star_fleet`.
OFF, TRAJECTORY, VELOCITY, DEMAND = 0, 1, 2, 3

FREE, SPEED, POSITION = 0, 1, 2  # control of an axis by a demand: none, velocity, position

SCALED_BIAS = 1 / 6
"""Share of the accelerometer's constant error that is left along z, since the firmware scales it at
rest so that it measures gravity (``processAccScale``). NanoBench: 2 mg along z, 19 mg along x."""

Record: TypeAlias = Any  # one row of a table of `DRONE`; mypy cannot know its fields

DRONE = np.dtype(
    [
        # The rigid body, in the map.
        ("position", "f8", 3),  # m, of its foot
        ("velocity", "f8", 3),  # m/s
        ("attitude", "f8", 4),  # unit quaternion x, y, z, w from the body to the map
        ("rates", "f8", 3),  # rad/s, about the body's axes
        ("thrust", "f8", 4),  # N, of each motor: front right, rear right, rear left, front left
        # Input of the attitude loop, from the position loop.
        ("push", "f8", 3),  # N, force of the propellers, in the map
        ("yaw_rate", "f8"),  # rad/s
        ("windup", "f8", 3),  # m/s², integral of the velocity loop
        # Input of the position loop, from the commander, in the odometry frame.
        ("reference_position", "f8", 3),  # m
        ("reference_velocity", "f8", 3),  # m/s
        ("reference_acceleration", "f8", 3),  # m/s²
        ("reference_yaw", "f8"),  # rad
        ("feed_forward", "f8"),  # of a reference's velocity and acceleration: 1, or 0 for none
        ("mode", "i8"),  # OFF, TRAJECTORY, VELOCITY or DEMAND
        ("setpoint_time", "f8"),  # s, when the last setpoint came
        ("trajectory", "f8", (4, 8)),  # x, y, z, yaw over the fraction of time passed
        ("trajectory_start", "f8"),  # s
        ("trajectory_duration", "f8"),  # s
        ("landing", "i8"),  # whether the motors stop when the trajectory is over
        ("finished", "i8"),  # whether the last trajectory is over
        # State of the supervisor.
        ("motors_time", "f8"),  # s, when the motors were last on
        ("tilted_for", "f8"),  # s
        ("inverted_for", "f8"),  # s
        ("tumbled", "i8"),
        ("crashed", "i8"),
        ("locked", "i8"),
        # The battery.
        ("charge", "f8"),  # as a fraction of full
        ("capacity", "f8"),  # A s
        ("voltage", "f8"),  # V, under load
        ("thrust_limit", "f8"),  # N, of one motor
        # Output of the estimator, in the odometry frame.
        ("believed_position", "f8", 3),  # m
        ("believed_velocity", "f8", 3),  # m/s
        ("believed_roll", "f8"),  # rad
        ("believed_pitch", "f8"),  # rad
        ("believed_yaw", "f8"),  # rad
        ("slip", "f8", 2),  # cosine and sine of the believed yaw less the true yaw in the map
        # Sensor and start errors, unknown to the estimator, drawn once per flight.
        ("origin", "f8", 3),  # m, of the odometry frame in the map
        ("origin_yaw", "f8"),  # rad
        ("scale", "f8"),  # of the flow sensor, as a fraction
        ("misalignment", "f8", 2),  # cosine and sine of the flow sensor's yaw in the body
        ("velocity_bias", "f8", 2),  # m/s, in the body
        ("gyro_bias", "f8"),  # rad/s, about z
        ("level_error", "f8", 2),  # rad, of roll and of pitch, without an IMU
        ("flow_noise", "f8"),  # counts, in every sample
        ("gyro_noise", "f8"),  # rad/s, in every sample, without an IMU
        ("accelerometer_bias", "f8", 3),  # m/s², in the body
        ("ranger_bias", "f8"),  # m
        # State of the estimator between cycles.
        ("seen_position", "f8", 3),  # m, true
        ("seen_velocity", "f8", 3),  # m/s, true
        ("seen_yaw", "f8"),  # rad, true
        ("flow_rest", "f8", 2),  # counts that were not whole
        ("tilt_error", "f8", 2),  # rad, of roll and of pitch, with an IMU
        # Height of the surface that the ranger and the flow sensor see.
        ("surface", "f8"),  # m, in the map
        # Contacts.
        ("clearance", "f8"),  # m, no obstacle is nearer
        # A demand, in addition to the references above.
        ("axes", "i8", 3),  # FREE, SPEED or POSITION along x, y and z; x and y FREE hold the tilt
        ("tilt", "f8", 2),  # rad, roll and pitch (nose down positive)
        ("tilt_rate", "f8", 2),  # rad/s, at which the commanded tilt changes
        ("lift", "f8"),  # N, thrust of all motors where z is FREE
        ("heading", "f8", 2),  # m/s ahead and aside, where `in_body`
        ("in_body", "i8"),  # whether the horizontal velocity turns with the drone
        ("turn_rate", "f8"),  # rad/s, at which the commanded yaw changes
        # Faults: shares of what works, 1 without.
        ("motor_share", "f8", 4),  # of each motor's thrust
        ("flow_share", "f8"),  # of the flow sensor's correction
        ("ranger_share", "f8"),  # of the ranger's correction
    ],
    align=True,
)

Drones: TypeAlias = NDArray[np.void]


def standing(position: NDArray[np.float64], yaw: NDArray[np.float64], charge: float) -> Drones:
    """Return drones level on the ground, with motors off and exact estimates.

    Args:
        position: (N, 3) in the map, m.
        yaw: (N,) in the map, rad.
        charge: Of each battery, as a fraction of full.

    Returns:
        (N,) records of `DRONE`.
    """
    drones = records(len(position), DRONE)
    for name in ("position", "seen_position", "origin"):
        drones[name] = position
    drones["attitude"][:, 2] = np.sin(yaw / 2)
    drones["attitude"][:, 3] = np.cos(yaw / 2)
    drones["seen_yaw"] = drones["origin_yaw"] = yaw
    drones["slip"] = np.stack([np.cos(yaw), -np.sin(yaw)], axis=1)
    drones["misalignment"][:, 0] = 1.0
    for name in ("feed_forward", "motor_share", "flow_share", "ranger_share"):
        drones[name] = 1.0
    drones["motors_time"] = -np.inf
    drones["charge"] = charge
    drones["capacity"] = discharge.CAPACITY
    drones["voltage"] = np.interp(charge, discharge.CHARGE, discharge.VOLTAGE_OF_CHARGE)
    drones["thrust_limit"] = airframe.THRUST_MAX if charge > 0 else 0.0
    return drones


def know_map(drones: Drones) -> None:
    """Let estimates of drones on the ground begin at their poses in the map."""
    drones["believed_position"], drones["believed_yaw"] = drones["origin"], drones["origin_yaw"]
    drones["origin"] = drones["origin_yaw"] = 0.0
    drones["slip"] = (1.0, 0.0)


def without_flow_deck(drones: Drones) -> None:
    """Leave accelerometer and gyro to the estimators.

    With a Flow deck the accelerometer's error along z hardly matters, and is as along x and y.
    """
    drones["flow_share"] = drones["ranger_share"] = 0.0
    drones["accelerometer_bias"][:, 2] *= SCALED_BIAS
