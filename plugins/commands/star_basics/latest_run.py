"""Links ``runs/latest`` to the record of the newest flight."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import Final

from star_core import Flight, hookimpl

LATEST: Final = "latest"


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
