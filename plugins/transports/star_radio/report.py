"""The log block of a drone's state reports, and their decoding.

All data that `Telemetry` and `Odometry` need of one drone (state, battery, supervisor and link)
fits into the 26 bytes of one packet: positions and velocities in the firmware's 16-bit
millimetres, angles as 16-bit floats (0.008° at 10°). So all values of a sample have the same time,
and a radio carries as many samples as possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import radians
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, PluginError
from star_radio.connection import packets
from star_radio.connection.tables import Table

BLOCK: Final = 1  # number of the block
MAX_SIZE: Final = 26  # bytes of variables in a report
_U8, _U16, _I16, _F16 = 1, 2, 5, 8  # types of the log protocol
_FORMATS: Final = {_U8: "u1", _U16: "<u2", _I16: "<i2", _F16: "<f2"}


class Source(NamedTuple):
    """A log variable that provides a value: its name, the type to send, and its unit in SI."""

    name: str
    kind: int
    unit: float


X, Y, Z, VX, VY, VZ, ROLL, PITCH, YAW, YAW_RATE, BATTERY, STATE, SIGNAL = range(13)
"""Columns returned by `Layout.read`: odometry frame, m, m/s, rad, rad/s, V, bits, dBm."""

SOURCES: Final[tuple[tuple[Source, ...], ...]] = (
    (Source("stateEstimateZ.x", _I16, 1e-3), Source("stateEstimate.x", _F16, 1.0)),
    (Source("stateEstimateZ.y", _I16, 1e-3), Source("stateEstimate.y", _F16, 1.0)),
    (Source("stateEstimateZ.z", _I16, 1e-3), Source("stateEstimate.z", _F16, 1.0)),
    (Source("stateEstimateZ.vx", _I16, 1e-3), Source("stateEstimate.vx", _F16, 1.0)),
    (Source("stateEstimateZ.vy", _I16, 1e-3), Source("stateEstimate.vy", _F16, 1.0)),
    (Source("stateEstimateZ.vz", _I16, 1e-3), Source("stateEstimate.vz", _F16, 1.0)),
    (Source("stateEstimate.roll", _F16, radians(1)),),
    (Source("stateEstimate.pitch", _F16, -radians(1)),),  # positive nose up in the firmware
    (Source("stateEstimate.yaw", _F16, radians(1)),),
    (Source("stateEstimateZ.rateYaw", _I16, 1e-3), Source("gyro.z", _F16, radians(1))),
    (Source("pm.vbatMV", _U16, 1e-3), Source("pm.vbat", _F16, 1.0)),
    (Source("supervisor.info", _U16, 1.0),),
    (Source("radio.rssi", _U8, -1.0),),
)
"""For each column, the variables that provide it, in order of preference."""

OPTIONAL: Final = frozenset({SIGNAL})
"""Columns that firmware may lack."""


@dataclass(frozen=True)
class Layout:
    """Variables that a drone reports.

    Attributes:
        sources: Source of each column; None where there is none.
    """

    sources: tuple[Source | None, ...]

    @classmethod
    def of(cls, table: Table) -> Layout:
        """Choose from a drone's log table."""
        found = [[source for source in ways if source.name in table] for ways in SOURCES]
        lacking = [
            " or ".join(repr(source.name) for source in ways)
            for column, (ways, there) in enumerate(zip(SOURCES, found, strict=True))
            if not there and column not in OPTIONAL
        ]
        if lacking:
            raise PluginError(
                f"its firmware has no log variable {', '.join(lacking)}; update it",
                "outdated-firmware",
            )
        return cls(tuple(there[0] if there else None for there in found))

    @cached_property
    def _reported(self) -> tuple[tuple[int, Source], ...]:
        return tuple((column, one) for column, one in enumerate(self.sources) if one is not None)

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """Type of a report's payload: block, 24-bit timestamp, variables."""
        named = [(str(column), _FORMATS[source.kind]) for column, source in self._reported]
        return np.dtype([("block", "u1"), ("stamp", "u1", 3), *named])

    def read(self, payloads: Sequence[bytes]) -> Array:
        """Return (K, 13) values of K payloads, with the columns above; NaN if not reported."""
        table = np.frombuffer(b"".join(payloads), self.dtype)
        values = np.full((len(table), len(SOURCES)), np.nan)
        for column, source in self._reported:
            values[:, column] = table[str(column)]
            values[:, column] *= source.unit
        return values

    @property
    def size(self) -> int:
        """Size of a report's payload, bytes."""
        return self.dtype.itemsize

    def variables(self, table: Table) -> bytes:
        """Return the type and number of each variable, as a log block is requested."""
        return b"".join(
            packets.log_variable(source.kind, table[source.name].number)
            for _column, source in self._reported
        )


def stamp(payload: bytes) -> int:
    """Return the timestamp of a report, ms since the drone started, 24 bits."""
    return int.from_bytes(payload[1:4], "little")
