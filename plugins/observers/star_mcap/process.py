"""Runs the recorder in a process of its own, so that recording costs a flight next to nothing.

The process ends with the flight's program however that ends: also after a SIGKILL it writes what it
was sent, and completes the file.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Any, Final

from star_core import Event, Flight, Frames, Odometry, Tick, hookimpl
from star_core.toolkit import python_process

BATCH_PERIOD: Final = 0.2  # s of wall time from one message to the next
BATCH_SIZE: Final = 32  # ticks in a message, at most
BACKLOG: Final = 32  # messages that wait in simulation; in real time the tick never waits
CLOSE_TIMEOUT: Final = 30.0  # s


class RecorderProcess:
    """Sends every tick of a flight to a process that records it.

    Args:
        lost: Extended by what cannot be recorded, with the reason.
    """

    def __init__(self, flight: Flight, folder: Path, lost: list[str] | None = None) -> None:
        self._folder, self._lost = folder, [] if lost is None else lost
        folder.mkdir(parents=True, exist_ok=True)
        self._images = flight.save_frames
        self._process, self._connection = python_process("star_mcap.recorder")
        self._queue: Queue[bytes | None] = Queue(0 if flight.scene.realtime else BACKLOG)
        self._batch: list[Tick | Event] = []
        self._sent = time.monotonic()
        self._thread = Thread(target=self._feed, daemon=True)
        self._thread.start()
        self._queue.put(pickle.dumps((flight, folder, time.time_ns())))

    @hookimpl(specname="star_ticked")
    def add(self, tick: Tick) -> None:
        """Record one tick.

        Raises:
            RuntimeError: The process has failed.
        """
        frames = tick.telemetry.frames if self._images else Frames.none()
        telemetry = replace(tick.telemetry, odometry=Odometry.none(), frames=frames)
        self._batch.append(replace(tick, telemetry=telemetry))
        due = time.monotonic() - self._sent >= BATCH_PERIOD
        if due or len(self._batch) >= BATCH_SIZE:
            self._send()

    @hookimpl(specname="star_event")
    def add_event(self, event: Event) -> None:
        """Record an event."""
        self._batch.append(event)

    @hookimpl(specname="star_mission_ended", tryfirst=True)
    def close(self, summary: Mapping[str, Any]) -> None:
        """Complete the file.

        Raises:
            RuntimeError: The process has failed.
        """
        self._send()
        brief = {key: summary[key] for key in ("mission", "outcome", "reason", "seed")}
        self._queue.put(pickle.dumps(brief))
        self._queue.put(None)
        self._thread.join(CLOSE_TIMEOUT)
        self._process.wait(CLOSE_TIMEOUT)
        self._check()
        self._connection.close()

    def _send(self) -> None:
        self._check()
        self._queue.put(pickle.dumps(self._batch))
        self._batch = []
        self._sent = time.monotonic()

    def _check(self) -> None:
        """Raise if the process has failed.

        Raises:
            RuntimeError: It has.
        """
        if self._process.poll():
            self._queue.put(None)
            self._thread.join(CLOSE_TIMEOUT)
            reason = "no message"
            with self._connection, suppress(EOFError, OSError):
                reason = self._connection.recv()
            wrong = f"the recording failed: {reason}"
            self._lost.append(f"{self._folder}: {wrong}")
            raise RuntimeError(wrong)

    def _feed(self) -> None:
        """Send what is queued to the process."""
        try:
            while (message := self._queue.get()) is not None:
                self._connection.send_bytes(message)
        except OSError:  # the process has failed: `_check` reports it
            while self._queue.get() is not None:
                pass
