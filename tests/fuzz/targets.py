"""All targets."""

from __future__ import annotations

from typing import Final

from tests.fuzz import files, flights, images, links, records, vehicles

TARGETS: Final = (
    *files.TARGETS,
    *vehicles.TARGETS,
    *links.TARGETS,
    *images.TARGETS,
    *records.TARGETS,
    *flights.TARGETS,
)
