"""The state reports of one drone: keeps their log block running, and holds the newest of them.

The firmware deletes all log blocks after a second without a packet, and flies on (``log.c``).
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Final

from star_radio.connection import log_blocks
from star_radio.connection.link import Link
from star_radio.connection.questions import Ask
from star_radio.connection.tables import Table
from star_radio.handover import Report
from star_radio.report import BLOCK, STATE, Clock, Layout, Z, stamp

RESTORE_AFTER: Final = 0.5  # s without a report, after which the drone may have lost its log block
MAX_BUFFERED_REPORTS: Final = 1000  # 10 s of reports, for a reader that is late


class ReportStream:
    """Reports of a drone's state.

    Attributes:
        layout: Layout of the reports; None before `begin`.
        clock: The drone's clock.
        heard: Arrival of the newest report, s of the computer's clock; before the first report, the
            creation time of this object.
        sampled: The same, of the newest report before a restart of the drone's clock: `take_all`
            returns none that is newer.
    """

    def __init__(self, link: Link, others: Callable[[bytes], object]) -> None:
        self.layout: Layout | None = None
        self.clock = Clock()
        self.heard = self.sampled = time.monotonic()
        self._link, self._others = link, others
        self._samples: deque[tuple[float, bytes]] = deque(maxlen=MAX_BUFFERED_REPORTS)
        self._newest = b""
        self._wrong_size = False  # whether a report of the wrong size has arrived since `heard`
        self._restorer: log_blocks.Restorer | None = None

    def begin(self, layout: Layout, table: Table, period: float, ask: Ask, timeout: float) -> None:
        """Start reports every `period`, s, blocking for up to `timeout`, s, until the first."""
        self.layout = layout
        self._link.report = self._take

        def reported() -> bool | None:
            began, self._wrong_size = time.monotonic(), False

            def arrived() -> bool | None:
                return self.heard >= began or (False if self._wrong_size else None)

            return log_blocks.await_report(arrived, timeout)

        variables = layout.variables(table)
        log_blocks.begin(BLOCK, variables, period, ask, "its state", reported)
        block = BLOCK, variables, period
        self._restorer = log_blocks.Restorer(self._link, block, RESTORE_AFTER)

    def restore(self, now: float) -> None:
        """Restart the reports if none has arrived for `RESTORE_AFTER`, without blocking."""
        anew = self._wrong_size
        if self._restorer is not None and self._restorer.restore(now, self.heard, anew=anew):
            self._wrong_size = False

    def take_all(self) -> list[tuple[float, bytes]]:
        """Return the reports since the last call: time, s of the computer's clock, and payload."""
        return [self._samples.popleft() for _ in range(len(self._samples))]

    @property
    def newest(self) -> Report:
        """The newest report, also one after a restart."""
        if self.layout is None or not self._newest:
            return Report(self.heard, math.nan, 0)
        (values,) = self.layout.read([self._newest])
        state = 0 if math.isnan(values[STATE]) else int(values[STATE])
        return Report(self.heard, float(values[Z]), state)

    def _take(self, payload: bytes, arrived: float) -> None:
        """Store a report with its time; runs in the receiving thread, so outside the tick."""
        layout = self.layout
        if layout is None or len(payload) != layout.size or payload[0] != BLOCK:
            self._wrong_size |= payload[:1] == bytes([BLOCK])
            self._others(payload)
            return
        made = self.clock.time(stamp(payload), arrived)
        if self.clock.doubtful:
            return
        if not self.clock.restarted:
            self._samples.append((made, payload))
            self.sampled = arrived
        self._newest, self.heard = payload, arrived
