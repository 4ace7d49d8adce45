"""Setpoints and positions as they come over the link, and their effect on the drone.

Signs are the firmware's: pitch in packets is nose up positive (``attitude.pitch`` of the legacy
body frame), yaw is anticlockwise positive except in three old formats and in degrees except in a
full state, and thrust is of 65535.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from star_core.toolkit import yaw_from_quaternion
from star_fleet.packet import expand, read, sound
from star_sim.airframe import THRUST_MAX
from star_sim.drone import FREE, POSITION, SPEED

Three = tuple[float, float, float]
NOTHING: Final[Three] = (0.0, 0.0, 0.0)

MIN_THRUST, MAX_THRUST = 1000, 60000  # of 65535, ``crtp_commander_rpyt.c``
FULL_THRUST: Final = 65535
MAX_CLIMB: Final = 32767.0  # of thrust per m/s in ``flightmode.althold``
STICK: Final = 30.0  # degrees per m/s in ``flightmode.poshold``


@dataclass(frozen=True, slots=True)
class Demand:
    """Demand of a setpoint. Where x and y are FREE it is a tilt.

    Attributes:
        axes: FREE, SPEED or POSITION along x, y and z.
        position: Of the axes under POSITION control, odometry frame, m.
        velocity: m/s; under POSITION control the feed-forward velocity.
        acceleration: m/s².
        in_body: Whether the horizontal velocity is ahead and aside instead of along x and y.
        tilt: Roll and pitch (nose down positive), rad.
        tilt_rate: At which they change, rad/s.
        lift: Thrust of all motors where z is FREE, N; none stops them.
        yaw: Heading, rad; None keeps what it is and turns it by `turn_rate`.
        turn_rate: rad/s.
    """

    axes: tuple[int, int, int] = (FREE, FREE, FREE)
    position: Three = NOTHING
    velocity: Three = NOTHING
    acceleration: Three = NOTHING
    in_body: bool = False
    tilt: tuple[float, float] = (0.0, 0.0)
    tilt_rate: tuple[float, float] = (0.0, 0.0)
    lift: float = 0.0
    yaw: float | None = None
    turn_rate: float = 0.0

    @property
    def stops(self) -> bool:
        """Whether it demands no thrust at all."""
        return self.axes[2] == FREE and self.lift <= 0

    def levelled(self) -> Demand:
        """What the supervisor makes of it when no other follows: level, no turn, z as it is."""
        return replace(
            self,
            axes=(FREE, FREE, self.axes[2]),
            tilt=(0.0, 0.0),
            tilt_rate=(0.0, 0.0),
            yaw=None,
            turn_rate=0.0,
        )


STOP: Final = Demand()


def decode(payload: bytes) -> Demand | None:
    """Return the demand of a packet of the port SETPOINT; None if it cannot be flown."""
    kind = payload[0] if payload else -1
    reader = _READERS.get(kind)
    return None if reader is None else reader(payload, kind)


class Sticks:
    """Reads the packets of roll, pitch, yaw rate and thrust that come from a hand.

    Thrust is locked until a packet with none has come. ``flightmode`` parameters give the sticks
    another meaning.
    """

    def __init__(self) -> None:
        self._locked = True

    def decode(self, payload: bytes, mode: Mapping[str, float]) -> Demand | None:
        """Return the demand of a packet; None if it cannot be flown.

        Args:
            payload: Roll, pitch and yaw rate in degrees, thrust.
            mode: Values of the parameters ``althold``, ``poshold``, ``posSet``, ``stabModeRoll``
                and ``stabModePitch``.
        """
        values = read("fffH", payload)
        if values is None or not sound(values[:3]):
            return None
        roll, pitch, yaw, thrust = values
        if thrust == 0:
            self._locked = False
        if mode["posSet"] and thrust:
            position = (-pitch, roll, thrust / 1000)
            return Demand((POSITION, POSITION, POSITION), position, yaw=math.radians(yaw))
        high = FREE
        climb = lift = 0.0
        if mode["althold"]:
            high, climb = SPEED, (thrust - MAX_CLIMB) / MAX_CLIMB
        elif not self._locked and thrust >= MIN_THRUST:
            lift = _lift(min(thrust, MAX_THRUST))
        turn = math.radians(yaw)
        if mode["poshold"]:
            velocity = (pitch / STICK, roll / STICK, climb)
            return Demand((SPEED, SPEED, high), NOTHING, velocity, lift=lift, turn_rate=turn)
        rated = [mode["stabModeRoll"] == 0, mode["stabModePitch"] == 0]
        angles = [math.radians(roll), -math.radians(pitch)]
        return Demand(
            (FREE, FREE, high),
            velocity=(0.0, 0.0, climb),
            tilt=(0.0 if rated[0] else angles[0], 0.0 if rated[1] else angles[1]),
            tilt_rate=(angles[0] if rated[0] else 0.0, angles[1] if rated[1] else 0.0),
            lift=lift,
            turn_rate=turn,
        )


def _stop(_payload: bytes, _kind: int) -> Demand:
    return STOP


def _four(payload: bytes, kind: int) -> Demand | None:
    """Formats of four numbers; angles and turns in degrees.

    1, 8: velocity in the odometry frame, turn. 2, 9: roll, pitch, turn, height. 4: roll, pitch,
    turn, vertical velocity. 5, 10: velocity ahead and aside, turn, height. 7: position, heading.
    """
    values = read("ffff", payload, 1)
    if values is None or not sound(values):
        return None
    x, y, z, last = values
    sign = -1 if kind in _CLOCKWISE else 1
    tilt, turn = (math.radians(x), -math.radians(y)), sign * math.radians(z)
    match kind:
        case 1 | 8:
            turn = sign * math.radians(last)
            return Demand((SPEED, SPEED, SPEED), velocity=(x, y, z), turn_rate=turn)
        case 2 | 9:
            return Demand((FREE, FREE, POSITION), (0.0, 0.0, last), tilt=tilt, turn_rate=turn)
        case 4:
            axes = (FREE, FREE, SPEED)
            return Demand(axes, velocity=(0.0, 0.0, last), tilt=tilt, turn_rate=turn)
        case 5 | 10:
            axes, velocity = (SPEED, SPEED, POSITION), (x, y, 0.0)
            return Demand(axes, (0.0, 0.0, last), velocity, in_body=True, turn_rate=turn)
        case _:
            return Demand((POSITION, POSITION, POSITION), (x, y, z), yaw=math.radians(last))


def _full_state(payload: bytes, _kind: int) -> Demand | None:
    """Position, velocity, acceleration in mm, attitude; body rates in mrad/s go unused.

    So they do in the firmware with its default controller, which this one stands for:
    ``fullStateDecoder`` (``crtp_commander_generic.c``) disables roll, pitch and yaw and has heading
    by the quaternion, and ``controller_pid.c`` heeds rates only where one of them is a velocity.
    A client that packs deg/s for rad/s is therefore not seen to be wrong here, nor there; with the
    Mellinger controller (``controller_mellinger.c``), which damps towards them, it is.
    """
    values = read("9hI3h", payload, 1)
    if values is None:
        return None
    metres = [value / 1000 for value in values[:9]]
    return Demand(
        (POSITION, POSITION, POSITION),
        _three(metres[:3]),
        _three(metres[3:6]),
        _three(metres[6:]),
        yaw=float(yaw_from_quaternion(expand(values[9]))),
    )


def _manual(payload: bytes, _kind: int) -> Demand | None:
    """Roll, pitch (angles or rates), turn, thrust."""
    values = read("fffHB", payload, 1)
    if values is None or not sound(values[:3]):
        return None
    roll, pitch, turn, thrust, rated = values
    angles = (math.radians(roll), -math.radians(pitch))
    return Demand(
        tilt=(0.0, 0.0) if rated else angles,
        tilt_rate=angles if rated else (0.0, 0.0),
        lift=_lift(thrust),
        turn_rate=math.radians(turn),
    )


_CLOCKWISE: Final = frozenset({1, 2, 5})  # formats of old firmware

_READERS: Final[Mapping[int, Callable[[bytes, int], Demand | None]]] = {
    0: _stop,
    **dict.fromkeys((1, 2, 4, 5, 7, 8, 9, 10), _four),
    6: _full_state,
    11: _manual,
}


def _lift(thrust: int) -> float:
    """Return the thrust of all motors, N."""
    return 4 * THRUST_MAX * thrust / FULL_THRUST


def _three(values: list[float]) -> Three:
    x, y, z = values
    return x, y, z


POSITION_CHANNEL, GENERIC_CHANNEL, PACKED_CHANNEL = 0, 1, 2  # channels
POSE, PACKED_POSES = 8, 9  # commands of GENERIC_CHANNEL
UNIT: Final = (0.9, 1.1)  # length of what is taken for a unit quaternion


@dataclass(frozen=True, slots=True)
class Fix:
    """Where a vehicle is.

    Attributes:
        name: Last byte of the address of the vehicle it is for; None for any receiver.
        position: Odometry frame, m.
        attitude: x, y, z, w from the body to that frame, if known.
    """

    name: int | None
    position: tuple[float, float, float]
    attitude: tuple[float, float, float, float] | None = None


def fixes(channel: int, payload: bytes) -> Iterator[Fix]:
    """Yield the positions and poses in a packet, those of other vehicles among them."""
    if channel == POSITION_CHANNEL:
        if (position := read("fff", payload)) is not None and sound(position):
            yield Fix(None, (position[0], position[1], position[2]))
    elif channel == PACKED_CHANNEL:
        for name, x, y, z in _each("Bhhh", payload):
            yield Fix(name, (x / 1000, y / 1000, z / 1000))
    elif payload[:1] == bytes([POSE]):
        if (pose := read("7f", payload, 1)) is not None and sound(pose):
            x, y, z, *attitude = pose
            length = math.hypot(*attitude)
            if UNIT[0] < length < UNIT[1]:
                qx, qy, qz, qw = (part / length for part in attitude)
                yield Fix(None, (x, y, z), (qx, qy, qz, qw))
    elif payload[:1] == bytes([PACKED_POSES]):
        for name, x, y, z, packed in _each("BhhhI", payload[1:]):
            yield Fix(name, (x / 1000, y / 1000, z / 1000), expand(packed))


def _each(form: str, payload: bytes) -> Iterator[tuple[int, ...]]:
    layout = struct.Struct("<" + form)
    whole = len(payload) // layout.size * layout.size
    yield from layout.iter_unpack(payload[:whole])
