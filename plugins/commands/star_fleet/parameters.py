"""The parameters of a vehicle: the firmware's names, types and initial values.

`star_fleet.vehicle` implements those that have an effect. The others, gains and lights among them,
are only stored and read back, for clients that expect them.
"""

from __future__ import annotations

import errno
import math
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from star_fleet.packet import Contents, read

U8, U16, U32, I8, I16, I32, FLOAT = 0x08, 0x09, 0x0A, 0x00, 0x01, 0x02, 0x06  # types
READ_ONLY, EXTENDED, CORE = 0x40, 0x10, 0x20  # flags
FORMAT: Final = {U8: "B", U16: "H", U32: "I", I8: "b", I16: "h", I32: "i", FLOAT: "f"}

READ, WRITE, OTHER = 1, 2, 3  # channels
BY_NAME, STORE, STORED, CLEAR = 0, 3, 4, 5  # commands of the channel OTHER
EXTENDED_TYPE_OLD, DEFAULT_OLD, EXTENDED_TYPE, DEFAULT = 2, 6, 7, 8
PERSISTENT: Final = 1  # the extended type of what can be stored


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter.

    Attributes:
        name: ``group.name``.
        code: Its type and flags.
        first: Its value after a start.
    """

    name: str
    code: int
    first: float = 0

    @property
    def layout(self) -> str:
        """Format of its value."""
        return "<" + FORMAT[self.code & 0x0F]


GAINS: Final[Mapping[str, Mapping[str, tuple[float, float, float]]]] = {
    "pid_attitude": {"roll": (6, 3, 0), "pitch": (6, 3, 0), "yaw": (6, 1, 0.35)},
    "pid_rate": {"roll": (250, 500, 2.5), "pitch": (250, 500, 2.5), "yaw": (120, 16.7, 0)},
    "posCtlPid": {"x": (2, 0, 0), "y": (2, 0, 0), "z": (2, 0.5, 0)},
    "velCtlPid": {"vx": (25, 1, 0), "vy": (25, 1, 0), "vz": (25, 15, 0)},
}
"""Gains kp, ki and kd of the firmware's PID controllers, by group and loop."""


def _gains() -> Iterator[Parameter]:
    """Yield them, named in the two ways of the firmware: ``roll_kp`` and ``xKp``."""
    for group, loops in GAINS.items():
        for loop, gains in loops.items():
            for name, gain in zip(("kp", "ki", "kd"), gains, strict=True):
                full = f"{loop}_{name}" if group.startswith("pid_") else loop + name.capitalize()
                yield Parameter(f"{group}.{full}", FLOAT | EXTENDED, gain)


PARAMETERS: Final = (
    *(
        Parameter(f"deck.bc{name}", U8 | READ_ONLY | CORE, name in {"Flow2", "ZRanger2"})
        for name in (
            *("ACS37800", "ActiveMarker", "AI", "Buzzer", "ColorLedBot", "ColorLedTop", "CPPM"),
            *("DWM1000", "Flow", "Flow2", "GTGPS", "LedRing", "Lighthouse4", "Loco"),
            *("Multiranger", "OA", "Servo", "USD", "ZRanger", "ZRanger2"),
        )
    ),
    *(
        Parameter(f"colorLed{side}.{name}", code, first)
        for side in ("Bot", "Top")
        for name, code, first in (("wrgb8888", U32, 0), ("brightCorr", U8, 1))
    ),
    Parameter("commander.enHighLevel", U8 | CORE),
    Parameter("cpu.flash", U16 | READ_ONLY, 1024),
    Parameter("flightmode.althold", U8),
    Parameter("flightmode.poshold", U8),
    Parameter("flightmode.posSet", U8),
    Parameter("flightmode.stabModeRoll", U8, 1),
    Parameter("flightmode.stabModePitch", U8, 1),
    Parameter("flightmode.stabModeYaw", U8),
    Parameter("firmware.revision0", U32 | READ_ONLY | CORE),
    Parameter("firmware.revision1", U16 | READ_ONLY | CORE),
    Parameter("firmware.modified", U8 | READ_ONLY | CORE),
    Parameter("hlCommander.vtoff", FLOAT | CORE, 0.5),
    Parameter("hlCommander.vland", FLOAT | CORE, 0.5),
    Parameter("hlCommander.groupmask", U8 | CORE),
    Parameter("imu_tests.MPU6500", U8 | READ_ONLY, 1),
    Parameter("imu_tests.HMC5883L", U8 | READ_ONLY, 1),
    Parameter("imu_tests.MS5611", U8 | READ_ONLY, 1),
    Parameter("imu_sensors.BMP3XX", U8 | READ_ONLY, 1),
    Parameter("kalman.resetEstimation", U8 | CORE),
    Parameter("kalman.initialX", FLOAT),
    Parameter("kalman.initialY", FLOAT),
    Parameter("kalman.initialZ", FLOAT),
    Parameter("kalman.initialYaw", FLOAT),
    Parameter("led.bitmask", U8),
    Parameter("led_deck_ctrl.rgb888", U32),
    Parameter("lighthouse.enableEst", U8 | EXTENDED, 1),
    Parameter("lighthouse.systemType", U8 | EXTENDED, 2),
    Parameter("loco.enableEst", U8 | EXTENDED, 1),
    Parameter("locSrv.extPosStdDev", FLOAT, 0.01),
    Parameter("locSrv.extQuatStdDev", FLOAT, 4.5e-3),
    Parameter("memTst.resetW", U8),
    Parameter("motion.disable", U8),
    Parameter("multiranger.filterMask", U16, 1),
    *_gains(),
    Parameter("pm.lowVoltage", FLOAT, 3.2),
    Parameter("pm.criticalLowVoltage", FLOAT, 3.0),
    Parameter("ring.effect", U8 | CORE | EXTENDED, 6),
    Parameter("ring.neffect", U8 | READ_ONLY, 18),
    Parameter("ring.solidRed", U8, 20),
    Parameter("ring.solidGreen", U8, 20),
    Parameter("ring.solidBlue", U8, 20),
    Parameter("ring.headlightEnable", U8),
    Parameter("ring.fadeColor", U32),
    Parameter("ring.fadeTime", FLOAT, 0.5),
    Parameter("stabilizer.estimator", U8 | CORE, 2),  # Kalman
    Parameter("stabilizer.controller", U8 | CORE, 1),  # PID
    Parameter("stabilizer.stop", U8 | CORE),
    Parameter("supervisor.prefltTimeout", U16 | READ_ONLY, 30000),
    Parameter("supervisor.landedTimeout", U16 | READ_ONLY, 3000),
    Parameter("system.selftestPassed", I8 | READ_ONLY | CORE, 1),
)

CONTENTS: Final = Contents(b"param", PARAMETERS)


class Parameters:
    """The values of one vehicle's parameters.

    Args:
        written: Called with the name of one that a client has written.
    """

    def __init__(self, written: Callable[[str], None]) -> None:
        self._written = written
        self._values: list[float] = [parameter.first for parameter in PARAMETERS]
        self._stored: dict[int, bytes] = {}

    def __getitem__(self, name: str) -> float:
        return self._values[CONTENTS.number[name]]

    def put(self, name: str, value: float) -> None:
        """Set one from on board."""
        self._values[CONTENTS.number[name]] = value

    def answer(self, channel: int, payload: bytes) -> bytes | None:
        """Return the answer to a question or an order; None if there is none.

        The answer to a write is the same again; to the write of what is only to be read there is
        none at all.
        """
        if channel == OTHER:
            return self._other(payload)
        if (request := read("H", payload)) is None:
            return None
        number: int = request[0]
        if number >= len(PARAMETERS):
            return payload[:2] + bytes([errno.ENOENT])
        if channel == READ:
            return payload[:2] + b"\0" + self._packed(number)
        if channel == WRITE and self._write(number, payload[2:]) == 0:
            return payload
        return None

    def _packed(self, number: int) -> bytes:
        return struct.pack(PARAMETERS[number].layout, self._values[number])

    def _write(self, number: int, data: bytes) -> int:
        """Set a value; return an errno."""
        parameter = PARAMETERS[number]
        if parameter.code & READ_ONLY:
            return errno.EACCES
        value = read(parameter.layout[1:], data)
        if value is None or not math.isfinite(value[0]):
            return errno.EINVAL
        self._values[number] = value[0]
        self._written(parameter.name)
        return 0

    def _other(self, payload: bytes) -> bytes | None:
        if payload[:1] == bytes([BY_NAME]):
            return self._by_name(payload)
        if (request := read("BH", payload)) is None:
            return None
        command, number = request
        exists = number < len(PARAMETERS)
        persistent = exists and bool(PARAMETERS[number].code & EXTENDED)
        result: bytes | None = None
        if command in {EXTENDED_TYPE, EXTENDED_TYPE_OLD}:
            status = b"" if command == EXTENDED_TYPE_OLD else bytes([0 if exists else errno.ENOENT])
            result = status + (bytes([PERSISTENT if persistent else 0]) if exists else b"")
        elif command in {DEFAULT, DEFAULT_OLD}:
            result = bytes([errno.ENOENT])
            if exists and not PARAMETERS[number].code & READ_ONLY:
                result = (b"\0" if command == DEFAULT else b"") + self._first(number)
        elif command in {STORE, STORED, CLEAR}:
            result = self._keep(command, number) if persistent else bytes([errno.ENOENT])
        return None if result is None else payload[:3] + result

    def _keep(self, command: int, number: int) -> bytes:
        """Store a persistent value, return its state, or clear it."""
        kept = self._stored.get(number)
        if command == STORED:
            return bytes([kept is not None]) + self._first(number) + (kept or b"")
        if command == CLEAR:
            self._stored.pop(number, None)
            return bytes([errno.ENOENT if kept is None else 0])
        self._stored[number] = self._packed(number)
        return b"\0"

    @staticmethod
    def _first(number: int) -> bytes:
        return struct.pack(PARAMETERS[number].layout, PARAMETERS[number].first)

    def _by_name(self, payload: bytes) -> bytes | None:
        group, group_end, rest = payload[1:].partition(b"\0")
        name, name_end, rest = rest.partition(b"\0")
        if not (group_end and name_end and rest):
            return None
        full = f"{group.decode('latin-1')}.{name.decode('latin-1')}"
        if (number := CONTENTS.number.get(full)) is None:
            status = errno.ENOENT
        elif rest[0] != PARAMETERS[number].code & ~(CORE | READ_ONLY | EXTENDED):
            status = errno.EINVAL
        else:
            status = self._write(number, rest[1:])
        return payload[: len(payload) - len(rest)] + bytes([status])
