"""Log variables that are read once, in a log block of their own."""

from __future__ import annotations

import struct
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
        """Return at most six values by name, without those it lacks; blocks for `timeout`, s."""
        present = [name for name in names[:MAX_VARIABLES] if name in table]
        if not present:
            return {}
        form = struct.Struct(f"<{len(present)}f")

        def reported() -> bool | None:
            self._newest = b""
            size = _HEAD + form.size
            return log_blocks.await_report(
                lambda: len(self._newest) == size if self._newest else None, timeout
            )

        ids = b"".join(packets.log_variable(_FLOAT, table[name].number) for name in present)
        log_blocks.begin(BLOCK, ids, PERIOD, ask, "single values", reported)
        values = form.unpack_from(self._newest, _HEAD)
        packet = packets.delete_block(BLOCK)
        ask([Question.of(packet, packet[1:3], "the end of single values")])
        return dict(zip(present, values, strict=True))
