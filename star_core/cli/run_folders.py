"""Default folders of records."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from star_core.hookspecs import hookimpl

if TYPE_CHECKING:
    from star_core.messages.events import Flight

RUNS = Path("runs")
LATEST = "latest"


def new_folder(name: str) -> Path:
    """Return ``runs/TIME-NAME``, or with a number if that exists; it is not created."""
    first = RUNS / f"{time.strftime('%Y-%m-%dT%H%M%S')}-{name}"
    folder, again = first, 2
    while folder.exists():
        folder = first.with_name(f"{first.name}-{again}")
        again += 1
    return folder


class LatestRun:
    """An observer that links ``runs/latest`` to the folder of the flight, where links work."""

    @hookimpl
    def star_mission_started(self, flight: Flight) -> None:
        if flight.folder is None:
            return
        new = flight.folder.with_name(f".{LATEST}-{os.getpid()}")
        with suppress(OSError):
            new.parent.mkdir(parents=True, exist_ok=True)
            new.symlink_to(flight.folder.name)
            try:
                new.replace(flight.folder.with_name(LATEST))  # atomic
            except OSError:  # there is a folder of that name
                new.unlink()
