"""Reports of a drone in log blocks of their own, beside those of its state.

They do not fit into the packet of the state reports, and are needed less often: the accelerometer
for the check of the velocity by the drag of the air (`star_monitors.drag_check`), which averages
over a second, and the variances of positions where the on-board estimator knows the map.
"""

from __future__ import annotations

import logging
import math
import struct
import time
from typing import Final, NamedTuple

from star_core import PluginError
from star_radio.connection import log_blocks, packets
from star_radio.connection.link import Link
from star_radio.connection.questions import Ask
from star_radio.connection.tables import Table

PERIOD: Final = 0.1  # s between two reports: 10 exchanges of a link per second
RESTORE_AFTER: Final = 1.0  # s without a report, after which the drone may have lost its log block
GRAVITY: Final = 9.81  # m/s² per g, the unit of the firmware

_HALF: Final = 8  # type of the log protocol
_HEADER: Final = struct.Struct("<B3x")  # block, timestamp

log = logging.getLogger(__name__)


class Block(NamedTuple):
    """A log block.

    Attributes:
        number: Its number.
        variables: Reported in it, as numbers of 16 bits.
        what: They are, for messages.
        without: What a drone does without them, for a warning; empty if it cannot fly.
        unit: Of the values, in SI units.
        max_age: Of the report that counts, s.
    """

    number: int
    variables: tuple[str, ...]
    what: str
    without: str
    unit: float
    max_age: float


ACCELEROMETER: Final = Block(
    3, ("acc.x", "acc.y"), "its accelerometer", "its velocity is not checked by drag", GRAVITY, 0.25
)
"""What the accelerometer measures along x and y of the body, m/s²."""

POSITION_VARIANCE: Final = Block(
    5, ("kalman.varX", "kalman.varY", "kalman.varZ"), "its variances of positions", "", 1.0, 0.5
)
"""Variances of the estimated position along x, y and z, m²."""


class ExtraReports:
    """Reports of one drone in a log block of their own."""

    def __init__(self, link: Link, block: Block) -> None:
        self._link, self._block = link, block
        self._values = struct.Struct(f"<{len(block.variables)}e")
        self._unknown = (math.nan,) * len(block.variables)
        self._newest = self._unknown
        self._heard = -math.inf  # s of the computer's clock
        self._restorer: log_blocks.Restorer | None = None

    def begin(self, name: str, table: Table, ask: Ask, timeout: float) -> None:
        """Start the reports, blocking for up to `timeout`, s, until the first.

        Without success, log a warning if a drone can do without.

        Raises:
            PluginError: A drone that cannot do without refuses them, or has no such variables.
        """
        block = self._block
        missing = [variable for variable in block.variables if variable not in table]
        if missing:
            if not block.without:
                text = f"its firmware does not log {missing[0]}: update it"
                raise PluginError(text, "outdated-firmware")
            return

        def reported() -> bool | None:
            began = time.monotonic()
            return log_blocks.await_report(lambda: self._heard >= began or None, timeout)

        ids = b"".join(packets.log_variable(_HALF, table[each].number) for each in block.variables)
        try:
            log_blocks.begin(block.number, ids, PERIOD, ask, block.what, reported)
        except PluginError as error:
            if not block.without:
                raise
            log.warning("radio: %s: %s: %s", name, error, block.without)
            return
        self._restorer = log_blocks.Restorer(self._link, (block.number, ids, PERIOD), RESTORE_AFTER)

    def hear(self, payload: bytes) -> None:
        """Store a report; runs in the receiving thread."""
        size = _HEADER.size + self._values.size
        if len(payload) == size and payload[0] == self._block.number:
            values = self._values.unpack_from(payload, _HEADER.size)
            self._newest = tuple(self._block.unit * value for value in values)
            self._heard = time.monotonic()

    def restore(self, now: float) -> None:
        """Restart the reports if none has arrived for `RESTORE_AFTER`, without blocking."""
        if self._restorer is not None:
            self._restorer.restore(now, self._heard)

    def newest(self, now: float) -> tuple[float, ...]:
        """Return the newest report; NaN without one, or if it is older than `Block.max_age`."""
        return self._newest if now - self._heard <= self._block.max_age else self._unknown
