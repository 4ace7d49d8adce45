"""Mistakes of cameras that fit their schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from star_core import Camera, Problem


def camera_problems(written: Mapping[str, Any]) -> Iterator[Problem]:
    """Yield the mistakes of a camera as it is written.

    >>> [problem.message for problem in camera_problems({"width": 160})]
    ['the principal point [169.27, 160.6] is outside the image of 160 x 244 px']
    """
    usual = Camera()
    width, height = written.get("width", usual.width), written.get("height", usual.height)
    _, _, x, y = written.get("matrix", usual.matrix)
    if not (0 <= x < width and 0 <= y < height):
        key = next((name for name in ("matrix", "width", "height") if name in written), "matrix")
        where = f"outside the image of {width} x {height} px"
        text = f"the principal point [{x:g}, {y:g}] is {where}"
        yield Problem((key,), text, "invalid-camera")
    exposure, apart = written.get("exposure", usual.exposure), 1 / written.get("rate", usual.rate)
    if exposure > apart:
        key = "exposure" if "exposure" in written else "rate"
        text = f"an exposure of {exposure:g} s is longer than from one image to the next, "
        yield Problem((key,), f"{text}{apart:g} s", "invalid-camera")
