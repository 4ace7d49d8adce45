"""The accelerometer reports of one drone, in a log block of their own: ``acc.x`` and ``acc.y``.

They do not fit into the packet of the state reports, and are needed less often: the check of the
velocity by the drag of the air (`star_monitors.drag_check`) averages over a second. A drone
whose firmware refuses the block flies without that check.
"""

from __future__ import annotations

import logging
import math
import struct
import time
from typing import Final

from star_core import PluginError
from star_radio.connection import log_blocks, packets
from star_radio.connection.link import Link
from star_radio.connection.questions import Ask
from star_radio.connection.tables import Table

BLOCK: Final = 3  # number of the block
PERIOD: Final = 0.1  # s between two reports: 10 exchanges of a link per second
MAX_AGE: Final = 0.25  # s, of the report that counts
RESTORE_AFTER: Final = 1.0  # s without a report, after which the drone may have lost its log block
POLL_PERIOD: Final = 0.005  # s, between checks for the first report
GRAVITY: Final = 9.81  # m/s² per g, the unit of the firmware
VARIABLES: Final = ("acc.x", "acc.y")

_HALF: Final = 8  # type of the log protocol
_DATA: Final = struct.Struct("<B3x2e")  # block, timestamp, values

log = logging.getLogger(__name__)


class Accelerometer:
    """Reports of what a drone's accelerometer measures along x and y of the body.

    Args:
        link: Its link.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._newest = (math.nan, math.nan)  # m/s²
        self._heard = -math.inf  # s of the computer's clock
        self._restorer: log_blocks.Restorer | None = None
        self._restore_due = 0.0  # s

    def begin(self, name: str, table: Table, ask: Ask, timeout: float) -> None:
        """Start the reports, blocking; without success, log a warning.

        Args:
            name: Of the agent.
            table: The drone's log table.
            ask: Asks the drone.
            timeout: For the first report, s.
        """
        if any(variable not in table for variable in VARIABLES):
            return

        def reported() -> bool | None:
            began = time.monotonic()
            while self._heard < began:
                if time.monotonic() > began + timeout:
                    return None
                time.sleep(POLL_PERIOD)
            return True

        ids = b"".join(packets.log_variable(_HALF, table[each].number) for each in VARIABLES)
        try:
            log_blocks.begin(BLOCK, ids, PERIOD, ask, "its accelerometer", reported)
        except PluginError as error:
            log.warning("radio: %s: %s: its velocity is not checked by drag", name, error)
            return
        self._restorer = log_blocks.Restorer(self._link, BLOCK, ids, PERIOD)

    def hear(self, payload: bytes) -> None:
        """Store a report; runs in the receiving thread."""
        if len(payload) == _DATA.size and payload[0] == BLOCK:
            _, ahead, left = _DATA.unpack(payload)
            self._newest = GRAVITY * ahead, GRAVITY * left
            self._heard = time.monotonic()

    def restore(self, now: float) -> None:
        """Restart the reports if none has arrived for `RESTORE_AFTER`, without blocking."""
        late = now - self._heard >= RESTORE_AFTER and now >= self._restore_due
        if self._restorer is not None and late and not self._restorer.busy:
            self._restore_due = now + RESTORE_AFTER
            self._restorer.restore(anew=False)

    def newest(self, now: float) -> tuple[float, float]:
        """Return the newest report, m/s²; NaN without one, or if it is older than `MAX_AGE`."""
        return self._newest if now - self._heard <= MAX_AGE else (math.nan, math.nan)
