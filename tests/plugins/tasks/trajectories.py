"""Files of polynomial pieces, and scenes that have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from star_core import Limits, Scene
from star_core.testing import scene
from star_verbs.follow.files import PIECE_COLUMNS

HEADER = ",".join(PIECE_COLUMNS)
POLY7: dict[str, Any] = {"file": "path.csv", "format": "poly7"}
WIDE = Limits(speed=2.0, acceleration=10.0)
NOTHING = (0.0,) * 8


def rest_to_rest(start: float, way: float, duration: float) -> list[float]:
    """The polynomial of fifth degree that stands still at both ends.

    Its greatest speed is 15/8 way / duration, its greatest acceleration 10/sqrt(3) way / duration².
    """
    third, fourth, fifth = (f * way / duration**k for f, k in ((10, 3), (-15, 4), (6, 5)))
    return [start, 0.0, 0.0, third, fourth, fifth, 0.0, 0.0]


def row(
    duration: float,
    x: Sequence[float] = NOTHING,
    *,
    y: Sequence[float] = NOTHING,
    z: float = 0.0,
    yaw: Sequence[float] = NOTHING,
) -> str:
    return ",".join(map(repr, [duration, *x, *y, z, *NOTHING[1:], *yaw]))


def there_and_back(way: float = 1.0, duration: float = 4.0, **others: Any) -> str:
    """A file with a piece along x and one back, m and s each."""
    out, back = rest_to_rest(0.0, way, duration), rest_to_rest(way, -way, duration)
    return f"{HEADER}\n{row(duration, out, **others)}\n{row(duration, back, **others)}\n"


def with_file(folder: Path, text: str, n: int = 1, limits: Limits = WIDE) -> Scene:
    (folder / "path.csv").write_text(text, encoding="utf-8")
    return replace(scene(n, limits=limits), folder=folder)
