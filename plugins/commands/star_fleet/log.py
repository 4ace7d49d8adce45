"""Log blocks: what a client has a vehicle stream, and the packets that follow from it."""

from __future__ import annotations

import errno
import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from star_fleet.packet import Contents, Port, join, read
from star_fleet.variables import FORMAT, VARIABLES, Readings, cast_one

BLOCKS, VARIABLES_AT_ONCE, MAX_BYTES = 16, 128, 26
DELETE, START, STOP, RESET, CREATE, APPEND, START_MS = 2, 3, 4, 5, 6, 7, 8  # commands
CONTROL, DATA = 1, 2  # channels
TICK: Final = 10  # ms, of START's period

CONTENTS: Final = Contents(b"log", VARIABLES, bytes([BLOCKS, VARIABLES_AT_ONCE]))


@dataclass(slots=True)
class Block:
    """Variables that are sent together.

    Attributes:
        variables: Number and type in the packet of each.
        size: Of the packet's data, bytes.
        period: ms; None if it is not running.
        due: When it is sent next, ms since the start.
        layout: Of the packet.
    """

    variables: list[tuple[int, int]] = field(default_factory=list)
    size: int = 0
    period: int | None = None
    due: int = 0
    layout: struct.Struct = field(default_factory=lambda: struct.Struct("<BHB"))


class Log:
    """The log blocks of one vehicle."""

    def __init__(self, row: int) -> None:
        self._row = row
        self._blocks: dict[int, Block] = {}
        self._next: float = math.inf  # ms, when the next block is due

    def answer(self, payload: bytes, now: float) -> bytes:
        """Carry out a command, at `now`, s, and return the answer: its first bytes and an errno."""
        return payload[:2].ljust(2, b"\0") + bytes([self._result(payload, round(now * 1000))])

    def reset(self) -> None:
        """Delete all blocks."""
        self._blocks.clear()

    def due(self, readings: Readings, now: float) -> Iterator[bytes]:
        """Yield the packets to send at `now`, s."""
        time = round(now * 1000)
        if time < self._next:
            return
        self._next = math.inf
        for number, block in self._blocks.items():
            if block.period is None:
                continue
            if time >= block.due:
                yield self._packet(number, block, readings, time)
                block.due = max(block.due + block.period, time + 1)
                if block.period == 0:  # once
                    block.period = None
                    continue
            self._next = min(self._next, block.due)

    def _packet(self, number: int, block: Block, readings: Readings, time: int) -> bytes:
        values: list[Any] = []
        for variable, code in block.variables:
            value = readings.column(variable)[self._row]
            if code != VARIABLES[variable].code:
                value = cast_one(value, code)
            values.append(value)
        data = block.layout.pack(number, time & 0xFFFF, time >> 16 & 0xFF, *values)
        return join(Port.LOG, DATA, data)

    def _result(self, payload: bytes, time: int) -> int:  # noqa: PLR0911 -- an errno each
        command = payload[0] if payload else -1
        if command == RESET:
            self.reset()
            return 0
        if command not in {DELETE, START, STOP, CREATE, APPEND, START_MS} or len(payload) < 2:  # noqa: PLR2004
            return errno.ENOEXEC
        number = payload[1]
        if command == CREATE:
            if number in self._blocks:
                return errno.EEXIST
            if len(self._blocks) >= BLOCKS:
                return errno.ENOMEM
            self._blocks[number] = Block()
        if (block := self._blocks.get(number)) is None:
            return errno.ENOENT
        if command in {START, START_MS}:
            return self._start(block, payload, time)
        if command == DELETE:
            del self._blocks[number]
        elif command == STOP:
            block.period = None
        else:
            return self._append(block, payload[2:])
        return 0

    def _start(self, block: Block, payload: bytes, time: int) -> int:
        form, unit = ("B", TICK) if payload[0] == START else ("H", 1)
        if (period := read(form, payload, 2)) is None:
            return errno.ENOEXEC
        block.period = period[0] * unit
        block.due = time + period[0] * unit
        self._next = 0
        return 0

    def _append(self, block: Block, settings: bytes) -> int:
        """Add variables until one cannot be; those before it stay, as in the firmware."""
        for at in range(0, len(settings) - 2, 3):
            code, number = struct.unpack_from("<BH", settings, at)
            form = FORMAT.get(code & 0x0F)
            if form is None or number >= len(VARIABLES):
                return errno.ENOENT
            if block.size + struct.calcsize(form) > MAX_BYTES:
                return errno.E2BIG
            if sum(len(other.variables) for other in self._blocks.values()) >= VARIABLES_AT_ONCE:
                return errno.ENOMEM
            block.variables.append((number, code & 0x0F))
            block.size += struct.calcsize(form)
            block.layout = struct.Struct(block.layout.format + form)
        return 0
