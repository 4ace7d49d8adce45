"""``log.txt``: the lines of a flight on stderr, with mission times."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from star_core import Event


class TextLog(logging.Handler):
    """Writes events, and log messages from `logging.WARNING` on, each as soon as it occurs.

    Attributes:
        time: Mission time of log messages, s.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(logging.WARNING)
        self.time = 0.0
        self._file = path.open("w", encoding="utf-8", buffering=1)
        root = logging.getLogger()
        # Without any other handler, Python writes messages to stderr; with this one it would not.
        self._default = None if root.handlers else logging.lastResort
        root.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        if self._default is not None:
            self._default.handle(record)
        self.write(Event(self.time, "log", f"star: {record.getMessage()}"))

    def write(self, event: Event) -> None:
        """Write an event; the flight is recorded even if the disk is full."""
        with suppress(OSError):
            self._file.write(f"{event}\n")

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write the outcome, and close the file."""
        reason = f": {summary['reason']}" if summary["reason"] else ""
        self.write(Event(self.time, "log", f"{summary['outcome']}{reason}"))
        logging.getLogger().removeHandler(self)
        with suppress(OSError):
            self._file.close()
        self.close()
