"""Signals that land all agents, for commands that fly."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from types import FrameType

from star_core.operator import Operator


@contextmanager
def land_on_signals(operator: Operator) -> Iterator[None]:
    """Land at Ctrl-C, SIGTERM and SIGHUP instead of being ended by them; then stop the motors."""
    numbers = count(1)

    def handle(number: int, _frame: FrameType | None) -> None:
        match next(numbers):
            case 1:
                operator.land_all()
                what = "landing; again stops the motors"
            case 2:
                operator.stop_motors()
                what = "stopping the motors; again interrupts a plugin that hangs"
            case _ if operator.recording:
                what = "the flight has ended; its record is being completed"
            case _:  # a plugin hangs
                raise KeyboardInterrupt
        text = f"star: {signal.Signals(number).name}: {what}\n"
        with suppress(OSError):  # the terminal may be gone
            try:
                sys.stderr.write(text)
            except RuntimeError:  # the signal interrupts another write
                os.write(sys.stderr.fileno(), text.encode())

    caught = {signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)}
    before = {number: signal.signal(number, handle) for number in caught}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
