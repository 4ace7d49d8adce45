"""Camera images of a flight, with the tags that they show."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from star_core import Run

MAX_IMAGES: Final = 12
MAX_EXAMINED: Final = 120  # images in which tags are searched for
WIDTH: Final = 324  # px
QUALITY: Final = 75  # %, of JPEG
GREEN: Final = (80, 220, 60)  # BGR


Item = TypeVar("Item")


class Picture(NamedTuple):
    """An image in colour with its tags drawn in, and their numbers."""

    path: Path
    pixels: NDArray[np.uint8]
    tags: list[int]


def images(run: Run) -> Iterator[str]:
    """Yield a section with saved images that show tags, spread over the flight.

    If no image shows a tag, it has others.
    """
    saved = sorted(run.folder.glob("frames/*/*.png"), key=lambda path: (path.stem, path.parent))
    if not saved:
        return
    examined = [found for path in _spread(saved, MAX_EXAMINED) if (found := _examined(path))]
    with_tags = [picture for picture in examined if picture.tags]
    chosen = _spread(with_tags or examined, MAX_IMAGES)
    title = "Images with detected tags" if with_tags else "Camera images"
    note = (
        f"{len(with_tags)} of {len(examined)} images that were searched for tags show some. The "
        "detector is that of this report (OpenCV): the localizer's may find more, or fewer."
        if with_tags
        else ""
    )
    yield (
        f"<section><h2>{title}</h2><p class=quiet>{note}</p>"
        f"<div class=images>{''.join(map(_shown, chosen))}</div></section>"
    )


def _spread(items: Sequence[Item], most: int) -> list[Item]:
    """Return `most` items at the most, evenly spread."""
    if len(items) <= most:
        return list(items)
    return [items[k] for k in np.linspace(0, len(items) - 1, most).round().astype(int)]


def _examined(path: Path) -> Picture | None:
    """Return an image with its tags; None if it cannot be read."""
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if grey is None:
        return None
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, found, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(grey)
    pixels = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    for outline in corners:
        cv2.polylines(
            pixels,
            [outline.round().astype(np.int32)],
            isClosed=True,
            color=GREEN,
            thickness=1,
            lineType=cv2.LINE_AA,
        )
    tags = [] if not corners else sorted(map(int, found.ravel()))
    return Picture(path, np.asarray(pixels, np.uint8), tags)


def _shown(picture: Picture) -> str:
    height = round(picture.pixels.shape[0] * WIDTH / picture.pixels.shape[1])
    pixels = cv2.resize(picture.pixels, (WIDTH, height))
    _, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    caption = f"{picture.path.parent.name}, {int(picture.path.stem) / 1000:.2f} s"
    if picture.tags:
        many = "tag" if len(picture.tags) == 1 else "tags"
        caption += f": {many} {', '.join(map(str, picture.tags))}"
    source = base64.b64encode(jpeg.tobytes()).decode()
    return (
        f'<figure><img alt="" src="data:image/jpeg;base64,{source}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )
