"""Magnitudes of the simulated errors: one profile per option value of ``sim``'s ``profile``.

``ideal`` has a Flow deck that drifts like one, and no further error: an exact accelerometer, a
level floor, a lossless link without delay, and a careful survey. ``realistic`` has the errors of a
Crazyflie with a Flow deck and an AI-deck in a careful lab, and feels the air that others move.
"NanoBench" is the set of 21 recorded flights of arXiv 2603.09908, from which
`benchmarks/imu_errors.py` identifies the figures; "assumed" marks those without a source.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from star_sim.airframe import GRAVITY


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorProfile:
    """Standard deviations and rates of the simulated errors; defaults are those of ``ideal``."""

    # Flow sensor, in every sample and slowly changing.
    flow_noise: float = 1.0  # counts
    flow_scale_wander: float = 0.0  # fraction
    flow_scale_time: float = 30.0  # s, correlation time

    # IMU. Without `imu` the estimator integrates the true velocity increments and knows its tilt
    # but for a constant error.
    imu: bool = False
    gyro_noise: float = math.radians(0.14)  # rad/s at 100 Hz: 0.014 °/s/√Hz of a BMI088
    gyro_wander: float = 0.0  # rad/s, about each axis
    gyro_time: float = 30.0  # s, correlation time
    accelerometer_bias: float = 0.0  # m/s², along each axis, constant
    accelerometer_wander: float = 0.0  # m/s²
    accelerometer_time: float = 10.0  # s, correlation time
    accelerometer_noise: float = 0.0  # m/s² at 100 Hz, vibration included

    # Ranger.
    ranger_bias: float = 0.0  # m, constant
    surfaces: bool = False  # whether ranger and flow sensor measure the distance to what is below

    aerodynamics: bool = False  # whether there are downwash and ground effect

    # Radio link; the values that the option ``radio`` does not give.
    report_delay: float = 0.0  # s from a sample to its arrival, in whole cycles of 10 ms
    report_loss: float = 0.0  # fraction of the packets
    setpoint_delay: float = 0.0  # s from sending to effect, of setpoints and commands
    setpoint_loss: float = 0.0  # fraction of the setpoints

    # Default values of the options of ``camera``, which has the units.
    timestamps: bool = True
    latency_offset_std: float = 0.0
    survey_std: float = 0.005
    survey_yaw_std_deg: float = 0.5
    survey_height_std: float = 0.0
    survey_tilt_std_deg: float = 0.0
    mounting_std_deg: float = 0.5
    mounting_position_std: float = 0.002
    focal_length_std: float = 0.0
    image_center_std: float = 0.0


IDEAL: Final = ErrorProfile()

REALISTIC: Final = ErrorProfile(
    flow_noise=2.0,  # `flowStdFixed` of the firmware's flowdeck_v1v2.c
    flow_scale_wander=0.02,  # assumed; the floor's texture has its own error
    imu=True,
    gyro_noise=math.radians(0.3),  # NanoBench, above 10 Hz
    gyro_wander=math.radians(0.1),  # NanoBench: heading errors change by less than 0.8° in 10 s
    accelerometer_bias=0.015 * GRAVITY,  # NanoBench: 18 and 5 mg; BMI088: ±20 mg, typically
    accelerometer_wander=0.003 * GRAVITY,  # NanoBench: 1 to 8 mg below 0.2 Hz
    accelerometer_noise=0.003 * GRAVITY,  # NanoBench, above 10 Hz
    ranger_bias=0.01,  # VL53L1X: ±20 mm of error, read as two deviations
    surfaces=True,
    aerodynamics=True,
    report_delay=0.01,  # assumed: a log block waits for up to a cycle and takes some ms on the air
    report_loss=0.02,  # assumed
    setpoint_delay=0.01,  # assumed: a packet waits for those of the other agents
    timestamps=False,  # as `radio` receives images
    latency_offset_std=0.02,  # s, assumed
    survey_std=0.015,  # assumed: a tape measure
    survey_yaw_std_deg=1.5,  # assumed
    survey_height_std=0.015,  # assumed
    survey_tilt_std_deg=1.5,  # assumed
    mounting_std_deg=1.5,  # assumed
    mounting_position_std=0.003,  # assumed
    focal_length_std=0.005,  # as `star calibrate` estimates, doubled
    image_center_std=1.0,  # px, assumed
)

PROFILES: Final = {"realistic": REALISTIC, "ideal": IDEAL}
