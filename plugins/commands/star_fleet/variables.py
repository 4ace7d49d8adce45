"""What a vehicle can log: the firmware's names and types, and where each value comes from.

Signs are the firmware's: ``pitch`` is nose up positive in `stateEstimate`, `stabilizer` and
``ctrltarget``, and so is ``stateEstimateZ.ratePitch``; ``gyro.y`` is right-handed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from star_fleet.packet import compress
from star_fleet.readings import FLOAT, I8, I16, U8, U16, U32, Readings, Variable, into_body
from star_fleet.toc import Entry
from star_sim import fusion
from star_sim.airframe import GRAVITY, THRUST_MAX
from star_sim.attitude import ATTITUDE_GAIN
from star_sim.drone import OFF

ON_BATTERY, LOW_POWER = 0, 3  # ``pm.state``
LOW_VOLTAGE: Final = 3.2  # V, ``pm.lowVoltage``
CELL: Final = (3.0, 4.2)  # V, empty and full, for ``pm.batteryLevel``
LOSS_AT_1_M: Final = 40.0  # dB, of 2.4 GHz in free space (Friis), from a sender of 0 dBm
NEAREST: Final = 0.1  # m from the radio, which stands at the map's origin
FULL_PWM: Final = 65535
LEAST_PUSH: Final = 1e-6  # N
MOST_RANGE: Final = 4000  # mm, of the ranger

_DEGREES: Final = math.degrees(1.0)


def _of(field: str, axis: int | None = None, scale: float = 1.0) -> Callable[[Readings], Any]:
    """Return what reads a field of the records, or one axis of it."""

    def read(readings: Readings) -> Any:
        values = readings.source.drones[field]
        return scale * (values if axis is None else values[:, axis])

    return read


def _sampled(place: int, scale: float = 1.0) -> Callable[[Readings], Any]:
    return lambda readings: scale * readings.source.sample[:, place]


def _quaternion(axis: int) -> Callable[[Readings], Any]:
    return lambda readings: readings.attitude[:, axis]


def _body_velocity(axis: int) -> Callable[[Readings], Any]:
    return lambda readings: readings.body_velocity[:, axis]


def _force(axis: int, scale: float = 1.0) -> Callable[[Readings], Any]:
    return lambda readings: scale * readings.force[:, axis]


def _acceleration(axis: int, scale: float) -> Callable[[Readings], Any]:
    """Without gravity, along the axes of the odometry frame, g."""

    def read(readings: Readings) -> Any:
        turned = readings.attitude * np.array([-1.0, -1.0, -1.0, 1.0])
        return scale * (into_body(turned, readings.force)[:, axis] - (axis == 2))  # noqa: PLR2004

    return read


def _packed(readings: Readings) -> Any:
    return compress(readings.attitude)


def _bit(bit: int) -> Callable[[Readings], Any]:
    return lambda readings: readings.source.info >> bit & 1


def _variance(axis: int) -> Callable[[Readings], Any]:
    """Of the estimate of x, y or heading, m² or rad²."""
    return lambda readings: readings.covariance[:, axis, axis]


def _velocity_variance(readings: Readings) -> Any:
    return np.full(len(readings.source.drones), fusion.VELOCITY_VARIANCE)


def _battery_level(readings: Readings) -> Any:
    low, high = CELL
    return 100 * np.clip((readings.source.drones["voltage"] - low) / (high - low), 0, 1)


def _battery_state(readings: Readings) -> Any:
    return np.where(readings.source.drones["voltage"] < LOW_VOLTAGE, LOW_POWER, ON_BATTERY)


def _rssi(readings: Readings) -> Any:
    """-dBm."""
    distance = np.linalg.norm(readings.source.drones["position"], axis=1)
    return LOSS_AT_1_M + 20 * np.log10(np.maximum(distance, NEAREST))


def _range(readings: Readings) -> Any:
    """Mm, along the body's z axis, to the floor."""
    drones = readings.source.drones
    x, y = drones["attitude"][:, 0], drones["attitude"][:, 1]
    upright = 1 - 2 * (x * x + y * y)
    return np.where(
        upright > 0,
        np.minimum(1000 * drones["position"][:, 2] / np.maximum(upright, 1e-6), MOST_RANGE),
        MOST_RANGE,
    )


def _wanted_tilt(axis: int) -> Callable[[Readings], Any]:
    """Degrees of roll, or of pitch (nose up positive), that the position loop asks for."""

    def read(readings: Readings) -> Any:
        drones = readings.source.drones
        x, y, up = drones["push"].T
        yaw = drones["seen_yaw"]
        ahead, aside = np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x
        tilt = -_DEGREES * np.arctan2(aside if axis == 0 else ahead, np.maximum(up, LEAST_PUSH))
        return np.where(drones["mode"] == OFF, 0.0, tilt)

    return read


def _wanted_rate(axis: int) -> Callable[[Readings], Any]:
    """Degrees per second, of the same."""
    tilt = _wanted_tilt(axis)
    actual = _of("believed_roll") if axis == 0 else _of("believed_pitch", scale=-1.0)
    return lambda readings: np.where(
        readings.source.drones["mode"] == OFF,
        0.0,
        ATTITUDE_GAIN * (tilt(readings) - _DEGREES * actual(readings)),
    )


def _thrust(readings: Readings) -> Any:
    """Of all motors, of 65535 each, mean."""
    return readings.source.drones["thrust"].mean(axis=1) / THRUST_MAX * FULL_PWM


def _on(field: str, axis: int | None = None, scale: float = 1.0) -> Callable[[Readings], Any]:
    """Like `_of`, and 0 while the motors are off."""
    read = _of(field, axis, scale)
    return lambda readings: np.where(readings.source.drones["mode"] == OFF, 0.0, read(readings))


VARIABLES: Final = (
    Variable("stateEstimate.x", FLOAT, _of("believed_position", 0)),
    Variable("stateEstimate.y", FLOAT, _of("believed_position", 1)),
    Variable("stateEstimate.z", FLOAT, _of("believed_position", 2)),
    Variable("stateEstimate.vx", FLOAT, _of("believed_velocity", 0)),
    Variable("stateEstimate.vy", FLOAT, _of("believed_velocity", 1)),
    Variable("stateEstimate.vz", FLOAT, _of("believed_velocity", 2)),
    Variable("stateEstimate.ax", FLOAT, _acceleration(0, 1.0)),
    Variable("stateEstimate.ay", FLOAT, _acceleration(1, 1.0)),
    Variable("stateEstimate.az", FLOAT, _acceleration(2, 1.0)),
    Variable("stateEstimate.roll", FLOAT, _of("believed_roll", scale=_DEGREES)),
    Variable("stateEstimate.pitch", FLOAT, _of("believed_pitch", scale=-_DEGREES)),
    Variable("stateEstimate.yaw", FLOAT, _of("believed_yaw", scale=_DEGREES)),
    Variable("stateEstimate.qx", FLOAT, _quaternion(0)),
    Variable("stateEstimate.qy", FLOAT, _quaternion(1)),
    Variable("stateEstimate.qz", FLOAT, _quaternion(2)),
    Variable("stateEstimate.qw", FLOAT, _quaternion(3)),
    Variable("stateEstimateZ.x", I16, _of("believed_position", 0, 1000)),
    Variable("stateEstimateZ.y", I16, _of("believed_position", 1, 1000)),
    Variable("stateEstimateZ.z", I16, _of("believed_position", 2, 1000)),
    Variable("stateEstimateZ.vx", I16, _of("believed_velocity", 0, 1000)),
    Variable("stateEstimateZ.vy", I16, _of("believed_velocity", 1, 1000)),
    Variable("stateEstimateZ.vz", I16, _of("believed_velocity", 2, 1000)),
    Variable("stateEstimateZ.ax", I16, _acceleration(0, 1000 * GRAVITY)),
    Variable("stateEstimateZ.ay", I16, _acceleration(1, 1000 * GRAVITY)),
    Variable("stateEstimateZ.az", I16, _acceleration(2, 1000 * GRAVITY)),
    Variable("stateEstimateZ.quat", U32, _packed),
    Variable("stateEstimateZ.rateRoll", I16, _of("rates", 0, 1000)),
    Variable("stateEstimateZ.ratePitch", I16, _of("rates", 1, -1000)),
    Variable("stateEstimateZ.rateYaw", I16, _sampled(4, 1000)),
    Variable("stabilizer.roll", FLOAT, _of("believed_roll", scale=_DEGREES)),
    Variable("stabilizer.pitch", FLOAT, _of("believed_pitch", scale=-_DEGREES)),
    Variable("stabilizer.yaw", FLOAT, _of("believed_yaw", scale=_DEGREES)),
    Variable("stabilizer.thrust", FLOAT, _thrust),
    Variable("gyro.x", FLOAT, _of("rates", 0, _DEGREES)),
    Variable("gyro.y", FLOAT, _of("rates", 1, _DEGREES)),
    Variable("gyro.z", FLOAT, _sampled(4, _DEGREES)),
    Variable("acc.x", FLOAT, _force(0)),
    Variable("acc.y", FLOAT, _force(1)),
    Variable("acc.z", FLOAT, _force(2)),
    Variable("kalman.stateX", FLOAT, _of("believed_position", 0)),
    Variable("kalman.stateY", FLOAT, _of("believed_position", 1)),
    Variable("kalman.stateZ", FLOAT, _of("believed_position", 2)),
    Variable("kalman.statePX", FLOAT, _body_velocity(0)),
    Variable("kalman.statePY", FLOAT, _body_velocity(1)),
    Variable("kalman.statePZ", FLOAT, _body_velocity(2)),
    Variable("kalman.q0", FLOAT, _quaternion(3)),
    Variable("kalman.q1", FLOAT, _quaternion(0)),
    Variable("kalman.q2", FLOAT, _quaternion(1)),
    Variable("kalman.q3", FLOAT, _quaternion(2)),
    Variable("kalman.varX", FLOAT, _variance(0)),
    Variable("kalman.varY", FLOAT, _variance(1)),
    Variable("kalman.varPX", FLOAT, _velocity_variance),
    Variable("kalman.varPY", FLOAT, _velocity_variance),
    Variable("kalman.varPZ", FLOAT, _velocity_variance),
    Variable("kalman.varD2", FLOAT, _variance(fusion.YAW)),
    Variable("range.zrange", U16, _range),
    Variable("motor.m1", U16, _of("thrust", 0, FULL_PWM / THRUST_MAX)),
    Variable("motor.m2", U16, _of("thrust", 1, FULL_PWM / THRUST_MAX)),
    Variable("motor.m3", U16, _of("thrust", 2, FULL_PWM / THRUST_MAX)),
    Variable("motor.m4", U16, _of("thrust", 3, FULL_PWM / THRUST_MAX)),
    Variable("pm.vbat", FLOAT, _of("voltage")),
    Variable("pm.vbatMV", U16, _of("voltage", scale=1000)),
    Variable("pm.batteryLevel", U8, _battery_level),
    Variable("pm.state", I8, _battery_state),
    Variable("radio.rssi", U8, _rssi),
    Variable("supervisor.info", U16, lambda readings: readings.source.info),
    Variable("sys.canfly", U8, _bit(3)),
    Variable("sys.isFlying", U8, _bit(4)),
    Variable("sys.isTumbled", U8, _bit(5)),
    Variable("ctrltarget.x", FLOAT, _on("reference_position", 0)),
    Variable("ctrltarget.y", FLOAT, _on("reference_position", 1)),
    Variable("ctrltarget.z", FLOAT, _on("reference_position", 2)),
    Variable("ctrltarget.vx", FLOAT, _on("reference_velocity", 0)),
    Variable("ctrltarget.vy", FLOAT, _on("reference_velocity", 1)),
    Variable("ctrltarget.vz", FLOAT, _on("reference_velocity", 2)),
    Variable("ctrltarget.yaw", FLOAT, _on("reference_yaw", scale=_DEGREES)),
    Variable("posCtl.targetX", FLOAT, _on("reference_position", 0)),
    Variable("posCtl.targetY", FLOAT, _on("reference_position", 1)),
    Variable("posCtl.targetZ", FLOAT, _on("reference_position", 2)),
    Variable("posCtl.targetVX", FLOAT, _on("reference_velocity", 0)),
    Variable("posCtl.targetVY", FLOAT, _on("reference_velocity", 1)),
    Variable("posCtl.targetVZ", FLOAT, _on("reference_velocity", 2)),
    Variable("controller.cmd_thrust", FLOAT, _thrust),
    Variable("controller.actuatorThrust", FLOAT, _thrust),
    Variable("controller.roll", FLOAT, _wanted_tilt(0)),
    Variable("controller.pitch", FLOAT, _wanted_tilt(1)),
    Variable("controller.rollRate", FLOAT, _wanted_rate(0)),
    Variable("controller.pitchRate", FLOAT, _wanted_rate(1)),
    Variable("controller.yaw", FLOAT, _on("reference_yaw", scale=_DEGREES)),
    Variable("controller.yawRate", FLOAT, _on("yaw_rate", scale=_DEGREES)),
)

ENTRIES: Final = tuple(Entry(variable.name, variable.code) for variable in VARIABLES)
