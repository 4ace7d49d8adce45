"""The one log block in which a drone reports how it is, and how its bytes are read.

All that `Telemetry` and `Odometry` need of one drone at one time, state, battery, supervisor and
link, fits into the 26 bytes of one packet: positions and velocities in the firmware's own 16-bit
millimetres, angles as 16-bit floats (0.008° at 10°). So a sample is of one time, and a radio
carries as many of them as it can.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import radians
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, PluginError
from star_radio import packets
from star_radio.tables import Ask, Table

BLOCK: Final = 1  # the block's number; there is no other
ROOM: Final = 26  # bytes of variables in a report
_U8, _U16, _I16, _F16 = 1, 2, 5, 8  # types of the log protocol
_FORMATS: Final = {_U8: "u1", _U16: "<u2", _I16: "<i2", _F16: "<f2"}
_WHAT: Final = "the log block of its state"


class Source(NamedTuple):
    """One way to report a value: the firmware's variable, the type to send, its unit in SI."""

    name: str
    kind: int
    unit: float


X, Y, Z, VX, VY, VZ, ROLL, PITCH, YAW, YAW_RATE, BATTERY, STATE, SIGNAL = range(13)
"""Columns of what `Layout.read` returns: odometry frame, m, m/s, rad, rad/s, V, bits, dBm."""

SOURCES: Final[tuple[tuple[Source, ...], ...]] = (
    (Source("stateEstimateZ.x", _I16, 1e-3), Source("stateEstimate.x", _F16, 1.0)),
    (Source("stateEstimateZ.y", _I16, 1e-3), Source("stateEstimate.y", _F16, 1.0)),
    (Source("stateEstimateZ.z", _I16, 1e-3), Source("stateEstimate.z", _F16, 1.0)),
    (Source("stateEstimateZ.vx", _I16, 1e-3), Source("stateEstimate.vx", _F16, 1.0)),
    (Source("stateEstimateZ.vy", _I16, 1e-3), Source("stateEstimate.vy", _F16, 1.0)),
    (Source("stateEstimateZ.vz", _I16, 1e-3), Source("stateEstimate.vz", _F16, 1.0)),
    (Source("stateEstimate.roll", _F16, radians(1)),),
    (Source("stateEstimate.pitch", _F16, -radians(1)),),  # the firmware's is nose up positive
    (Source("stateEstimate.yaw", _F16, radians(1)),),
    (Source("stateEstimateZ.rateYaw", _I16, 1e-3), Source("gyro.z", _F16, radians(1))),
    (Source("pm.vbatMV", _U16, 1e-3), Source("pm.vbat", _F16, 1.0)),
    (Source("supervisor.info", _U16, 1.0),),
    (Source("radio.rssi", _U8, -1.0),),
)
"""For each column, the variables that hold it, the better first."""

SPARED: Final = frozenset({SIGNAL})
"""Columns that firmware may lack."""


@dataclass(frozen=True)
class Layout:
    """Which variables a drone reports.

    Attributes:
        sources: Of each column; None where there is none.
    """

    sources: tuple[Source | None, ...]

    @classmethod
    def of(cls, table: Table) -> Layout:
        """Choose from a drone's log table.

        Raises:
            PluginError: The firmware lacks variables; the message names them.
        """
        found = [[source for source in ways if source.name in table] for ways in SOURCES]
        lacking = [
            " or ".join(repr(source.name) for source in ways)
            for column, (ways, there) in enumerate(zip(SOURCES, found, strict=True))
            if not there and column not in SPARED
        ]
        if lacking:
            raise PluginError(f"its firmware has no log variable {', '.join(lacking)}; update it")
        return cls(tuple(there[0] if there else None for there in found))

    @cached_property
    def _reported(self) -> tuple[tuple[int, Source], ...]:
        return tuple((column, one) for column, one in enumerate(self.sources) if one is not None)

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """Of a report's payload: block, time stamp of 24 bits, variables."""
        named = [(str(column), _FORMATS[source.kind]) for column, source in self._reported]
        return np.dtype([("block", "u1"), ("stamp", "u1", 3), *named])

    def read(self, payloads: Sequence[bytes]) -> Array:
        """Return (K, 13) values of K payloads, whose columns stand above; NaN if not reported."""
        table = np.frombuffer(b"".join(payloads), self.dtype)
        values = np.full((len(table), len(SOURCES)), np.nan)
        for column, source in self._reported:
            values[:, column] = table[str(column)]
            values[:, column] *= source.unit
        return values

    @property
    def size(self) -> int:
        """Of a report's payload, bytes."""
        return self.dtype.itemsize

    def begin(self, table: Table, period: float, ask: Ask) -> None:
        """Have a drone report every `period`, s.

        Raises:
            PluginError: It refuses, or does not answer.
        """
        variables = b"".join(
            bytes([source.kind]) + table[source.name].number.to_bytes(2, "little")
            for _column, source in self._reported
        )
        ask(packets.packet(packets.LOG, packets.SETTINGS, packets.RESET), packets.RESET, "reports")
        command, entry = packets.CREATE, 3  # bytes of a variable
        most = (packets.MOST - 2) // entry * entry
        for at in range(0, len(variables), most):
            question = packets.log_block(BLOCK, variables[at : at + most], command)
            packets.accepted(ask(question, question[1:3], "reports"), _WHAT)
            command = packets.APPEND
        question = packets.start_block(BLOCK, period)
        packets.accepted(ask(question, question[1:3], "reports"), _WHAT)


def stamp(payload: bytes) -> int:
    """Return the time stamp of a report, ms since the drone was started, of 24 bits."""
    return int.from_bytes(payload[1:4], "little")
