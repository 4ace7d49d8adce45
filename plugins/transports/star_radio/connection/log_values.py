"""Log variables that are read once, in a log block of their own."""

from __future__ import annotations

import struct
import time
from collections.abc import Sequence
from typing import Final

from star_radio.connection import log_blocks, packets
from star_radio.connection.questions import Ask, Question
from star_radio.connection.tables import Table

BLOCK: Final = 4  # number of the block
PERIOD: Final = 0.1  # s
MAX_VARIABLES: Final = 6  # floats of one report
_FLOAT: Final = 7  # type of the log protocol
_HEAD: Final = 4  # bytes: block and timestamp
_POLL_PERIOD: Final = 0.005  # s


class LogValues:
    """Reads log variables of one drone as floats."""

    def __init__(self) -> None:
        self._newest = b""

    def hear(self, payload: bytes) -> None:
        """Store a report; runs in the receiving thread."""
        if payload[:1] == bytes([BLOCK]):
            self._newest = payload

    def read(
        self, table: Table, names: Sequence[str], ask: Ask, timeout: float
    ) -> dict[str, float]:
        """Return the values of at most six variables by name, without those it lacks; this blocks.

        Args:
            table: The drone's log table.
            names: Of the variables.
            ask: Asks the drone.
            timeout: For the report, s.
        """
        present = [name for name in names[:MAX_VARIABLES] if name in table]
        if not present:
            return {}
        form = struct.Struct(f"<{len(present)}f")

        def reported() -> bool | None:
            self._newest, end = b"", time.monotonic() + timeout
            while not self._newest:
                if time.monotonic() > end:
                    return None
                time.sleep(_POLL_PERIOD)
            return len(self._newest) == _HEAD + form.size

        ids = b"".join(packets.log_variable(_FLOAT, table[name].number) for name in present)
        log_blocks.begin(BLOCK, ids, PERIOD, ask, "single values", reported)
        values = form.unpack_from(self._newest, _HEAD)
        packet = packets.delete_block(BLOCK)
        ask([Question.of(packet, packet[1:3], "the end of single values")])
        return dict(zip(present, values, strict=True))
