"""Camera images of a flight, with the tags that were detected in them."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Final, TypeVar

import cv2
import numpy as np

from star_core import Detections, Run
from star_core.toolkit import image_with_tags

MAX_IMAGES: Final = 12
WIDTH: Final = 324  # px
QUALITY: Final = 75  # %, of JPEG

Item = TypeVar("Item")


def images(run: Run) -> Iterator[str]:
    """Yield a section with saved images in which tags were detected, spread over the flight.

    If there is none with tags, it has others.
    """
    saved = [path for agent in run.agents for path in run.images(agent).values()]
    saved.sort(key=lambda path: (path.stem, path.parent))
    detections = run.detections
    tags: dict[tuple[str, int], list[int]] = {}  # rows of the detections in each image
    for k, (row, time) in enumerate(
        zip(detections.agent.tolist(), detections.time.tolist(), strict=True)
    ):
        tags.setdefault((run.agents[row], round(1000 * time)), []).append(k)
    with_tags = [path for path in saved if _key(path) in tags]
    chosen = _spread(with_tags or saved, MAX_IMAGES)
    shown = [
        _shown(path, detections.of(np.array(tags.get(_key(path), []), int))) for path in chosen
    ]
    if not shown:
        return
    title = "Images with detected tags" if with_tags else "Camera images"
    note = (
        f"In {len(with_tags)} of {len(saved)} images tags were detected, on board or by the "
        "localizer. Orange: not used."
        if with_tags
        else "The record has no detections in them."
    )
    yield (
        f"<section><h2>{title}</h2><p class=quiet>{note}</p>"
        f"<div class=images>{''.join(shown)}</div></section>"
    )


def _key(path: Path) -> tuple[str, int]:
    """Return the agent and the time, ms, of an image."""
    return path.parent.name, int(path.stem)


def _spread(items: Sequence[Item], most: int) -> list[Item]:
    """Return `most` items at the most, evenly spread."""
    if len(items) <= most:
        return list(items)
    return [items[k] for k in np.linspace(0, len(items) - 1, most).round().astype(int)]


def _shown(path: Path, detections: Detections) -> str:
    """Return an image with its tags; nothing if it cannot be read."""
    gray = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if gray is None:
        return ""
    pixels = image_with_tags(np.asarray(gray, np.uint8), detections, WIDTH)
    _, jpeg = cv2.imencode(".jpg", pixels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    source = base64.b64encode(jpeg.tobytes()).decode()
    caption = escape(_caption(path, detections))
    return (
        f'<figure><img alt="" src="data:image/jpeg;base64,{source}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _caption(path: Path, detections: Detections) -> str:
    agent, time = _key(path)
    reasons = zip(detections.tag, detections.rejected, strict=True)
    tags = [f"{tag} ({reason})" if reason else f"{tag}" for tag, reason in reasons]
    many = "tag" if len(tags) == 1 else "tags"
    return f"{agent}, {time / 1000:.2f} s" + (f": {many} {', '.join(tags)}" if tags else "")
