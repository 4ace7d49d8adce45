"""The log block of a drone's state reports, their decoding, and the drone's clock.

All data that `Telemetry` and `Odometry` need of one drone (state, battery, supervisor and link)
fits into the 26 bytes of one packet: positions and velocities in the firmware's 16-bit
millimetres, angles as 16-bit floats (0.008° at 10°). So all values of a sample have the same time,
and a radio carries as many samples as possible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import radians
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Mask, PluginError, Rows, Supervisor
from star_radio.connection import packets
from star_radio.connection.tables import Table

BLOCK: Final = 1  # number of the block
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
    *(
        (Source(f"stateEstimateZ.{axis}", _I16, 1e-3), Source(f"stateEstimate.{axis}", _F16, 1.0))
        for axis in ("x", "y", "z", "vx", "vy", "vz")
    ),
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
        available = [[source for source in ways if source.name in table] for ways in SOURCES]
        lacking = [
            " or ".join(repr(source.name) for source in ways)
            for column, (ways, sources) in enumerate(zip(SOURCES, available, strict=True))
            if not sources and column not in OPTIONAL
        ]
        if lacking:
            raise PluginError(
                f"its firmware has no log variable {', '.join(lacking)}; update it",
                "outdated-firmware",
            )
        return cls(tuple(sources[0] if sources else None for sources in available))

    @cached_property
    def _reported(self) -> tuple[tuple[int, Source], ...]:
        return tuple(
            (column, source) for column, source in enumerate(self.sources) if source is not None
        )

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """Type of a report's payload: block, 24-bit timestamp, variables."""
        named = [(str(column), _FORMATS[source.kind]) for column, source in self._reported]
        return np.dtype([("block", "u1"), ("stamp", "u1", 3), *named])

    def read(self, payloads: Sequence[bytes]) -> Array:
        """Return (K, 13) values of K payloads, with the columns above.

        Values that are not reported, or not finite, are NaN.
        """
        table = np.frombuffer(b"".join(payloads), self.dtype)
        values = np.full((len(table), len(SOURCES)), np.nan)
        for column, source in self._reported:
            values[:, column] = table[str(column)]
            with np.errstate(invalid="ignore"):  # a NaN of any kind remains one
                values[:, column] *= source.unit
        values[np.isinf(values)] = np.nan
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


LANDED_HEIGHT: Final = 0.1  # m: a drone below it that has finished its plan is on the ground
_FLYING: Final = int(Supervisor.FLYING)
_FINISHED: Final = int(Supervisor.COMMANDER_FINISHED)
_COMMANDER: Final = int(Supervisor.COMMANDER_ACTIVE) | _FINISHED


def flying(state: int | Rows, height: float | Array) -> Mask:
    """Return which drones fly, or stand with their motors on, by their newest reports.

    A drone that has landed reports to fly for another 2 s: low, with a finished plan and no active
    one. At an unknown height it may hover.

    Args:
        state: Bits of `Supervisor`.
        height: In the odometry frame, m; NaN if unknown.
    """
    state, height = np.asarray(state), np.asarray(height)
    landed = (state & _COMMANDER == _FINISHED) & (height < LANDED_HEIGHT)
    flies: Mask = (state & _FLYING != 0) & ~landed
    return flies


def stamp(payload: bytes) -> int:
    """Return the timestamp of a report, ms since the drone started, 24 bits."""
    return int.from_bytes(payload[1:4], "little")


WRAP: Final = 1 << 24  # ms: timestamps have 24 bits and wrap after 4.7 h
WINDOW: Final = 2.0  # s: at least 20 reports; a clock that falls behind is followed within two
MIN_RESTART_STEP: Final = 1000  # ms, backward step that means a restart: no packet is so late
MAX_AHEAD: Final = 60_000  # ms, forward step beyond the time that passed, likewise


class Clock:
    """Estimates the offset of a drone's clock as the minimum of arrival time minus timestamp.

    That difference is the offset plus a positive delay, so its minimum is closest to the offset (as
    in Cristian, Distributed Computing 3, 1989). Only the current and the previous `WINDOW` are
    used, so that the offset follows clock drift (40 ppm are 0.2 ms in two windows) and a simulated
    drone that cannot keep up with real time. The remaining error is the minimum latency of the
    link, some milliseconds, by which times are late.

    A timestamp that does not follow the earlier ones means a restart only if the next one follows
    it: a single one may have been altered on its way.

    Attributes:
        restarted: Whether the drone's clock has restarted since its first report.
    """

    def __init__(self) -> None:
        self.restarted = False
        self._last: int | None = None  # ms, newest timestamp, unwrapped
        self._heard = 0.0  # s, arrival of the newest report that follows
        self._suspect: tuple[int, float] | None = None  # timestamp and arrival of one that does not
        self._began = 0.0  # s, start of the current window
        self._offset = self._before = math.inf  # s, of the current and the previous window

    @property
    def doubtful(self) -> bool:
        """Whether the last timestamp does not follow the earlier ones: it may be altered."""
        return self._suspect is not None

    def time(self, stamp: int, arrived: float) -> float:
        """Return the time of a report, s of the computer's clock, never after its arrival.

        Args:
            stamp: Timestamp of the report, ms since the drone started, 24 bits.
            arrived: Arrival of the report, s.
        """
        if self._last is None:
            self._last = self._begin(stamp, arrived)
        ahead = 1000 * (arrived - self._heard) + MAX_AHEAD
        if not -MIN_RESTART_STEP <= _difference(stamp, self._last) <= ahead:
            suspect, self._suspect = self._suspect, (stamp, arrived)
            if suspect is None or abs(_difference(stamp, suspect[0])) > MIN_RESTART_STEP:
                return arrived
            self.restarted = True
            self._last = self._begin(*suspect)
        self._suspect, self._heard = None, arrived
        unwound = self._last + _difference(stamp, self._last)
        self._last = max(self._last, unwound)
        if arrived - self._began > WINDOW:
            self._began, self._before, self._offset = arrived, self._offset, math.inf
        self._offset = min(self._offset, arrived - unwound / 1000)
        return unwound / 1000 + min(self._offset, self._before)

    def _begin(self, stamp: int, arrived: float) -> int:
        """Estimate the offset anew from a report; return its timestamp."""
        self._heard = self._began = arrived
        self._offset, self._before = arrived - stamp / 1000, math.inf
        return stamp


def _difference(stamp: int, earlier: int) -> int:
    """Return the time from one timestamp to another, ms: less than half of `WRAP`."""
    return (stamp - earlier + WRAP // 2) % WRAP - WRAP // 2
