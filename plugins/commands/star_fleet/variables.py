"""What a vehicle can log: the firmware's names and types, and where each value comes from.

Signs are the firmware's: ``pitch`` is nose up positive in `stateEstimate`, `stabilizer` and
``ctrltarget``, and so is ``stateEstimateZ.ratePitch``; ``gyro.y`` is right-handed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from star_core import Array, Rows
from star_fleet.conditions import GROWTH, Condition, Conditions, drones_in
from star_fleet.packet import compress
from star_fleet.ranger import AXES, Ranger, seen_along
from star_sim.airframe import DRAG_XY, DRAG_Z, GRAVITY, MASS, THRUST_MAX
from star_sim.attitude import ATTITUDE_GAIN
from star_sim.drone import OFF
from star_sim.fusion import YAW, Fusion
from star_sim.kernel import report
from star_sim.transport import Simulator

if TYPE_CHECKING:
    from star_fleet.vehicle import Vehicle

U8, U16, U32, I8, I16, I32, FLOAT, HALF = 1, 2, 3, 4, 5, 6, 7, 8  # types
FORMAT: Final = {U8: "B", U16: "H", U32: "I", I8: "b", I16: "h", I32: "i", FLOAT: "f", HALF: "e"}
WHOLE: Final = {
    U8: (0, 255),
    U16: (0, 65535),
    U32: (0, 0xFFFFFFFF),
    I8: (-128, 127),
    I16: (-32768, 32767),
    I32: (-0x80000000, 0x7FFFFFFF),
}
ON_BATTERY, LOW_POWER = 0, 3  # ``pm.state``
LOW_VOLTAGE: Final = 3.2  # V, ``pm.lowVoltage``
CELL: Final = (3.0, 4.2)  # V, empty and full, for ``pm.batteryLevel``
LOSS_AT_1_M: Final = 40.0  # dB, of 2.4 GHz in free space (Friis), from a sender of 0 dBm
MIN_DISTANCE: Final = 0.1  # m from the radio, which stands at the map's origin
FULL_PWM: Final = 65535
MIN_PUSH: Final = 1e-6  # N
MAX_RANGE: Final = 4000  # mm, of the ranger
STATIONS, ANCHORS = 0x03, 0xFF  # bits of the two base stations and the eight anchors
DECK_TEMPERATURE: Final = 30  # degrees Celsius, of a color deck; nothing heats it

_DEGREES: Final = math.degrees(1.0)


class Readings:
    """The values of all vehicles at one time, computed on first use.

    Args:
        simulator: Simulator of the fleet.
        info: (N,) bits of the supervisors.
        vehicles: The firmware of each drone.
        ranger: Measures distances to obstacles.
        conditions: Conditions of the drones.
    """

    def __init__(
        self,
        simulator: Simulator,
        info: Rows,
        vehicles: Sequence[Vehicle],
        ranger: Ranger,
        conditions: Conditions = MappingProxyType({}),
    ) -> None:
        self.drones, self.sample = simulator.drones, simulator.sample
        self.cascades = simulator.cascades
        self.info, self.vehicles = info, vehicles
        self.conditions = conditions
        self._ranger = ranger
        self.now, self._fusion = simulator.time, simulator.fusion
        self._columns: dict[int, list[Any]] = {}

    def column(self, number: int) -> list[Any]:
        """Return the values of a variable, one for each vehicle, as its type can hold them."""
        values = self._columns.get(number)
        if values is None:
            variable = VARIABLES[number]
            values = self._columns[number] = cast(variable.read(self), variable.code)
        return values

    @cached_property
    def attitude(self) -> Array:
        """(N, 4) quaternions x, y, z, w from the body to the odometry frame, as estimated."""
        n = len(self.drones)
        attitude = np.empty((n, 4))
        report(self.drones, self.now, attitude, np.empty(n, np.int64))
        return attitude

    @cached_property
    def pwm(self) -> Array:
        """(N, 4) of 65535; of the ideal controller, which has none, the thrust as a share of it."""
        if self.cascades is not None:
            return np.asarray(self.cascades["pwm"])
        return np.asarray(self.drones["thrust"] * (FULL_PWM / THRUST_MAX))

    @cached_property
    def covariance(self) -> Array:
        """(N, 3, 3) of the estimates of x, y and heading, m and rad."""
        return self._fusion.covariance(self.drones, self.now)

    @cached_property
    def position_variance(self) -> Array:
        """(N, 3) of the estimates of x, y and z, m²."""
        return self._fusion.position_variance(self.drones, self.now)

    @cached_property
    def velocity_variance(self) -> Array:
        """(N, 3) of the estimated velocities, m²/s²; they grow while nothing measures these."""
        unmeasured = [Condition.UNSETTLED]
        if isinstance(self._fusion, Fusion):  # it expects Flow decks
            unmeasured.append(Condition.NO_FLOW_DECK)
        without = drones_in(self.conditions, len(self.drones), *unmeasured)
        variance = self._fusion.velocity_variance(self.drones, self.now)
        return variance + GROWTH * self.now * without[:, None]

    @cached_property
    def ranges(self) -> Array:
        """(N, 5) distances of the Multi-ranger deck, mm; 0 without one, as in the firmware."""
        drones = self.drones
        ranges = np.zeros((len(drones), len(AXES)))
        for row, vehicle in enumerate(self.vehicles):
            if vehicle.ranges:
                ranges[row] = seen_along(self._ranger, drones[row], AXES)
        return ranges

    @cached_property
    def body_velocity(self) -> Array:
        """(N, 3) velocity along the body's axes, as estimated, m/s."""
        return into_body(self.attitude, self.drones["believed_velocity"])

    @cached_property
    def force(self) -> Array:
        """(N, 3) specific force along the body's axes, as an accelerometer measures it, g."""
        drones = self.drones
        felt = -np.array([DRAG_XY, DRAG_XY, DRAG_Z]) * into_body(
            drones["attitude"], drones["velocity"]
        )
        felt[:, 2] += drones["thrust"].sum(axis=1)
        resting = (drones["position"][:, 2] <= 0) & (drones["velocity"][:, 2] == 0)
        floor = np.zeros((len(drones), 3))
        floor[:, 2] = MASS * GRAVITY - drones["thrust"].sum(axis=1)
        pressed = np.maximum(0.0, floor) * resting[:, None]
        force: Array = (felt + into_body(drones["attitude"], pressed)) / (MASS * GRAVITY)
        if np.any(self.sample):  # before the first cycle there is none
            force[:, :2] = self.sample[:, 11:] / GRAVITY  # with the errors of the sensor
        return force

    @cached_property
    def acceleration(self) -> Array:
        """(N, 3) without gravity, along the axes of the odometry frame, g."""
        inverse = self.attitude * np.array([-1.0, -1.0, -1.0, 1.0])
        gravity = np.array([0.0, 0.0, 1.0])
        return np.asarray(into_body(inverse, self.force) - gravity)


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable.

    Attributes:
        name: ``group.name``.
        code: Its type.
        read: Returns its (N,) values.
    """

    name: str
    code: int
    read: Callable[[Readings], Any]


def cast(values: Any, code: int) -> list[Any]:
    """Return values as a type of variable can hold them: cut to whole numbers, and to its range.

    >>> cast(np.array([1.9, -3.0]), U8)
    [1, 0]
    """
    if code in WHOLE:
        low, high = WHOLE[code]
        floats = np.asarray(values, float)
        # much faster than numpy's own, which counts
        whole = np.where(np.isnan(floats), 0.0, floats)
        return list(np.minimum(np.maximum(whole, low), high).astype(np.int64).tolist())
    return list(np.asarray(values, float).tolist())


def cast_one(value: float, code: int) -> float:
    """Return one value as a type of variable can hold it; see `cast`.

    >>> cast_one(300.7, U8), cast_one(math.nan, I16), cast_one(0.5, HALF)
    (255, 0, 0.5)
    """
    if code not in WHOLE:
        return float(value)
    low, high = WHOLE[code]
    return 0 if math.isnan(value) else int(min(max(value, low), high))


def into_body(attitude: Array, vectors: Array) -> Array:
    """Turn (N, 3) vectors into the bodies' frames."""
    x, y, z, w = -attitude[:, 0], -attitude[:, 1], -attitude[:, 2], attitude[:, 3]
    axis = np.stack([x, y, z], axis=1)
    twice = 2 * np.cross(axis, vectors)
    return np.asarray(vectors + w[:, None] * twice + np.cross(axis, twice))


def _of(field: str, axis: int | None = None, scale: float = 1.0) -> Callable[[Readings], Any]:
    """Return a function that reads a field of the records, or one axis of it."""
    if axis is None:
        return lambda readings: scale * readings.drones[field]
    return lambda readings: scale * readings.drones[field][:, axis]


def _on(field: str, axis: int | None = None, scale: float = 1.0) -> Callable[[Readings], Any]:
    """Like `_of`, and 0 while the motors are off."""
    read = _of(field, axis, scale)
    return lambda readings: np.where(readings.drones["mode"] == OFF, 0.0, read(readings))


def _column(name: str, axis: int, scale: float = 1.0) -> Callable[[Readings], Any]:
    """Return a function that reads one axis of an attribute of the readings."""
    return lambda readings: scale * getattr(readings, name)[:, axis]


def _each(
    group: str, names: str, code: int, read: Callable[..., Any], *values: Any, scale: float = 1.0
) -> Iterator[Variable]:
    """Yield a variable for each axis: `read` makes its function of values, axis and scale."""
    for axis, name in enumerate(names.split()):
        yield Variable(f"{group}.{name}", code, read(*values, axis, scale))


def _angles(group: str) -> Iterator[Variable]:
    """Yield roll, pitch and yaw, degrees."""
    yield Variable(f"{group}.roll", FLOAT, _of("believed_roll", scale=_DEGREES))
    yield Variable(f"{group}.pitch", FLOAT, _of("believed_pitch", scale=-_DEGREES))
    yield Variable(f"{group}.yaw", FLOAT, _of("believed_yaw", scale=_DEGREES))


def _received(condition: Condition, bits: int) -> Callable[[Readings], Any]:
    """Return a function that reads the bits of what drones with a deck receive; 0 without it."""
    return lambda readings: bits * drones_in(readings.conditions, len(readings.drones), condition)


def _battery_level(readings: Readings) -> Any:
    low, high = CELL
    return 100 * np.clip((readings.drones["voltage"] - low) / (high - low), 0, 1)


def _battery_state(readings: Readings) -> Any:
    return np.where(readings.drones["voltage"] < LOW_VOLTAGE, LOW_POWER, ON_BATTERY)


def _rssi(readings: Readings) -> Any:
    """-dBm."""
    distance = np.linalg.norm(readings.drones["position"], axis=1)
    return LOSS_AT_1_M + 20 * np.log10(np.maximum(distance, MIN_DISTANCE))


def _range(readings: Readings) -> Any:
    """Along the body's z axis, to the floor or the obstacle below, mm."""
    drones = readings.drones
    x, y = drones["attitude"][:, 0], drones["attitude"][:, 1]
    upright = 1 - 2 * (x * x + y * y)
    height = drones["position"][:, 2] - drones["surface"]
    distance = 1000 * height / np.maximum(upright, 1e-6)
    return np.where(upright > 0, np.minimum(distance, MAX_RANGE), MAX_RANGE)


def _commanded_tilt(axis: int, _scale: float = 1.0) -> Callable[[Readings], Any]:
    """Roll, or pitch (nose up positive), that the position loop commands, degrees."""

    def read(readings: Readings) -> Any:
        drones = readings.drones
        if readings.cascades is not None:
            commanded = (_DEGREES, -_DEGREES)[axis] * readings.cascades["target_tilt"][:, axis]
            return np.where(drones["mode"] == OFF, 0.0, commanded)
        x, y, up = drones["push"].T
        yaw = drones["seen_yaw"]
        ahead, aside = np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x
        tilt = -_DEGREES * np.arctan2(aside if axis == 0 else ahead, np.maximum(up, MIN_PUSH))
        return np.where(drones["mode"] == OFF, 0.0, tilt)

    return read


def _commanded_rate(axis: int, _scale: float = 1.0) -> Callable[[Readings], Any]:
    """Degrees per second, of the same."""
    tilt = _commanded_tilt(axis)
    actual = _of("believed_roll") if axis == 0 else _of("believed_pitch", scale=-1.0)
    return lambda readings: np.where(
        readings.drones["mode"] == OFF,
        0.0,
        ATTITUDE_GAIN * (tilt(readings) - _DEGREES * actual(readings)),
    )


def _thrust(readings: Readings) -> Any:
    """Mean of all motors, of 65535 each."""
    if readings.cascades is not None:
        return readings.cascades["thrust"]
    return readings.drones["thrust"].mean(axis=1) / THRUST_MAX * FULL_PWM


def _always(value: float) -> Callable[[Readings], Any]:
    return lambda readings: np.full(len(readings.drones), value)


def _bit(bit: int) -> Callable[[Readings], Any]:
    return lambda readings: readings.info >> bit & 1


VARIABLES: Final = (
    *_each("stateEstimate", "x y z", FLOAT, _of, "believed_position"),
    *_each("stateEstimate", "vx vy vz", FLOAT, _of, "believed_velocity"),
    *_each("stateEstimate", "ax ay az", FLOAT, _column, "acceleration"),
    *_angles("stateEstimate"),
    *_each("stateEstimate", "qx qy qz qw", FLOAT, _column, "attitude"),
    *_each("stateEstimateZ", "x y z", I16, _of, "believed_position", scale=1000),
    *_each("stateEstimateZ", "vx vy vz", I16, _of, "believed_velocity", scale=1000),
    *_each("stateEstimateZ", "ax ay az", I16, _column, "acceleration", scale=1000 * GRAVITY),
    Variable("stateEstimateZ.quat", U32, lambda readings: compress(readings.attitude)),
    Variable("stateEstimateZ.rateRoll", I16, _of("rates", 0, 1000)),
    Variable("stateEstimateZ.ratePitch", I16, _of("rates", 1, -1000)),
    Variable("stateEstimateZ.rateYaw", I16, _column("sample", 4, 1000)),
    *_angles("stabilizer"),
    Variable("stabilizer.thrust", FLOAT, _thrust),
    *_each("gyro", "x y", FLOAT, _of, "rates", scale=_DEGREES),
    Variable("gyro.z", FLOAT, _column("sample", 4, _DEGREES)),
    *_each("acc", "x y z", FLOAT, _column, "force"),
    *_each("kalman", "stateX stateY stateZ", FLOAT, _of, "believed_position"),
    *_each("kalman", "statePX statePY statePZ", FLOAT, _column, "body_velocity"),
    Variable("kalman.q0", FLOAT, _column("attitude", 3)),
    *_each("kalman", "q1 q2 q3", FLOAT, _column, "attitude"),
    *_each("kalman", "varX varY varZ", FLOAT, _column, "position_variance"),
    *_each("kalman", "varPX varPY varPZ", FLOAT, _column, "velocity_variance"),
    Variable("kalman.varD2", FLOAT, lambda readings: readings.covariance[:, YAW, YAW]),
    Variable("lighthouse.bsActive", U16, _received(Condition.LIGHTHOUSE, STATIONS)),
    Variable("ranging.state", U16, _received(Condition.LOCO, ANCHORS)),
    Variable("range.zrange", U16, _range),
    *_each("range", "front back left right up", U16, _column, "ranges"),
    Variable("memTst.errCntW", U32, lambda readings: [v.write_errors for v in readings.vehicles]),
    *(
        Variable(f"colorLed{side}.{name}", U8, _always(value))
        for side in ("Bot", "Top")
        for name, value in (("deckTemp", DECK_TEMPERATURE), ("throttlePct", 0))
    ),
    *_each("motor", "m1 m2 m3 m4", U16, _column, "pwm"),
    Variable("pm.vbat", FLOAT, _of("voltage")),
    Variable("pm.vbatMV", U16, _of("voltage", scale=1000)),
    Variable("pm.batteryLevel", U8, _battery_level),
    Variable("pm.state", I8, _battery_state),
    Variable("radio.rssi", U8, _rssi),
    Variable("supervisor.info", U16, lambda readings: readings.info),
    Variable("sys.canfly", U8, _bit(3)),
    Variable("sys.isFlying", U8, _bit(4)),
    Variable("sys.isTumbled", U8, _bit(5)),
    *_each("ctrltarget", "x y z", FLOAT, _on, "reference_position"),
    *_each("ctrltarget", "vx vy vz", FLOAT, _on, "reference_velocity"),
    Variable("ctrltarget.yaw", FLOAT, _on("reference_yaw", scale=_DEGREES)),
    *_each("posCtl", "targetX targetY targetZ", FLOAT, _on, "reference_position"),
    *_each("posCtl", "targetVX targetVY targetVZ", FLOAT, _on, "reference_velocity"),
    Variable("controller.cmd_thrust", FLOAT, _thrust),
    Variable("controller.actuatorThrust", FLOAT, _thrust),
    *_each("controller", "roll pitch", FLOAT, _commanded_tilt),
    *_each("controller", "rollRate pitchRate", FLOAT, _commanded_rate),
    Variable("controller.yaw", FLOAT, _on("reference_yaw", scale=_DEGREES)),
    Variable("controller.yawRate", FLOAT, _on("yaw_rate", scale=_DEGREES)),
)
