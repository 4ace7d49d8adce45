"""Default folders of records."""

from __future__ import annotations

import time
from pathlib import Path


def new_folder(name: str) -> Path:
    """Return ``runs/TIME-NAME``, or with a number if that exists; it is not created."""
    first = Path("runs") / f"{time.strftime('%Y-%m-%dT%H%M%S')}-{name}"
    folder, again = first, 2
    while folder.exists():
        folder = first.with_name(f"{first.name}-{again}")
        again += 1
    return folder
