"""Cameras of an import: the ``camera_info`` files of ROS, and how the original mounts a camera."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from star_core.formats import Value
from star_import.import_log import ImportLog, show
from star_import.text import Line, word

MODELS: Final = ("plumb_bob", "rational_polynomial")
LENSES: Final = 5  # coefficients k1, k2, p1, p2, k3
READ: Final = ("image_width", "image_height", "camera_name", "camera_matrix", "distortion_model",
               "distortion_coefficients", "rectification_matrix", "projection_matrix")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Calibration:
    """What a ``camera_info`` file says of a camera.

    Attributes:
        name: Of the camera.
        size: Width and height of its images, px.
        matrix: Focal lengths and principal point fx, fy, cx, cy, px.
        distortion: k1, k2, p1, p2, k3.
        location: Source location, ``file:line:col``.
    """

    name: str
    size: tuple[int, int]
    matrix: tuple[float, ...]
    distortion: tuple[float, ...]
    location: str

    def line(self, key: str, pitch_deg: float | None) -> Line:
        """Return it as a line of a mission under ``cameras:``."""
        width, height = self.size
        pitch = "" if pitch_deg is None else f", pitch_deg: {show(pitch_deg)}"
        matrix, lens = show(list(self.matrix)), show(list(self.distortion))
        return Line(
            f"  {word(key)}: {{width: {width}, height: {height}, matrix: {matrix}, "
            f"distortion: {lens}{pitch}}}",
            self.location,
        )


def calibration(path: Path, file: Value, log: ImportLog) -> Calibration:
    """Return the calibration of a camera.

    Raises:
        InputError: It is not one of a pinhole camera.
    """
    keys = file.map()
    sides = [keys[key].number() for key in ("image_width", "image_height") if key in keys]
    matrix = _data(file, "camera_matrix", 9)
    lens = _data(file, "distortion_coefficients", None)
    model = keys.get("distortion_model")
    if model is not None and model.text() not in MODELS:
        raise model.wrong(f"{model.text()!r}, expected one of {', '.join(MODELS)}")
    if any(lens[LENSES:]):
        where = file.need("distortion_coefficients").begins_at
        log.changed(where, f"of the lens's coefficients the first {LENSES} are used", path.name)
    log.ignore_keys(file, READ, why="has no meaning for a mono camera")
    width, height = sides if len(sides) == 2 else (324, 244)  # noqa: PLR2004 -- an AI-deck's
    fx, _, cx, _, fy, cy, *_ = matrix
    name = keys["camera_name"].text() if "camera_name" in keys else path.stem
    return Calibration(
        name=name,
        size=(int(width), int(height)),
        matrix=(fx, fy, cx, cy),
        distortion=(*lens, *[0.0] * LENSES)[:LENSES],
        location=file.begins_at,
    )


def pitch_deg(quaternion: Value) -> float:
    """Return how far down a camera looks, degrees, of its rotation x, y, z, w about the body's y.

    Raises:
        InputError: It is no rotation about that axis.
    """
    numbers = quaternion.numbers()
    length = math.hypot(*numbers)
    if len(numbers) != 4 or not length:  # noqa: PLR2004 -- a quaternion
        raise quaternion.wrong(f"{list(numbers)}, expected a quaternion x, y, z, w")
    x, y, z, w = (number / length for number in numbers)
    if math.hypot(x, z) > 0.01:  # noqa: PLR2004 -- rounding of a file
        raise quaternion.wrong("is not a rotation about the body's y axis, as STAR's cameras have")
    return round(math.degrees(2 * math.atan2(y, w)), 3)


def _data(file: Value, key: str, count: int | None) -> Sequence[float]:
    """Return the numbers of a matrix of ROS."""
    entry = file.need(key)
    listed = entry.need("data") if isinstance(entry.data, dict) else entry
    numbers = listed.numbers()
    if count is not None and len(numbers) != count:
        raise listed.wrong(f"{key} has {len(numbers)} numbers, expected {count}")
    return numbers
