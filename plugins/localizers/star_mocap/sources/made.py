"""Sources without a system: bodies that are made up, and frames that were recorded."""

from __future__ import annotations

import csv
import itertools
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from star_mocap.source import Frame

COLUMNS: Final = ("time", "body", "x", "y", "z", "qx", "qy", "qz", "qw")


def mock(
    *,
    bodies: Mapping[str, Sequence[float]],
    rate: float,
    radius: float,
    period: float,
    labelled: bool,
) -> Iterator[Frame]:
    """Yield frames of bodies on circles: each starts at its position and heads along its path."""
    began = time.monotonic()
    for k in itertools.count():
        time.sleep(max(0.0, began + k / rate - time.monotonic()))
        angle = math.tau * k / rate / period if radius else 0.0
        ahead, aside = radius * math.sin(angle), radius * (1 - math.cos(angle))
        poses = {
            name: (x + ahead, y + aside, z, 0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))
            for name, (x, y, z) in bodies.items()
        }
        if labelled:
            yield Frame(poses, captured=k / rate, processing=0.0)
        else:
            yield Frame({}, [pose[:3] for pose in poses.values()], k / rate, 0.0)


def replay(*, file: str, repeat: bool) -> Iterator[Frame]:
    """Yield the frames of a CSV file at the times at which they were recorded.

    Raises:
        ValueError: A line is not as `COLUMNS`; the message has its number.
    """
    recorded = read_frames(Path(file))
    began = time.monotonic()
    for turn in itertools.count():
        later = turn * (recorded[-1][0] - recorded[0][0] + 1e-3) - recorded[0][0]
        for captured, bodies, markers in recorded:
            time.sleep(max(0.0, began + captured + later - time.monotonic()))
            yield Frame(bodies, markers, captured + later, 0.0)
        if not repeat:
            return


def read_frames(
    path: Path,
) -> list[tuple[float, dict[str, tuple[float, ...]], list[tuple[float, ...]]]]:
    """Return the frames of a file: times, s, poses of bodies, and markers without a body."""
    frames: list[tuple[float, dict[str, tuple[float, ...]], list[tuple[float, ...]]]] = []
    with path.open(encoding="utf-8", newline="") as lines:
        table = csv.reader(lines)
        header = tuple(next(table, ()))
        if header != COLUMNS:
            raise ValueError(f"{path}:1: expected the header {','.join(COLUMNS)}")
        for number, row in enumerate(table, 2):
            try:
                at, body, pose = float(row[0]), row[1], tuple(map(float, filter(None, row[2:])))
                if len(pose) != (len(COLUMNS) - 2 if body else 3) or not all(
                    map(math.isfinite, (at, *pose))
                ):
                    raise ValueError  # noqa: TRY301 -- as of what is no number
            except (ValueError, IndexError):
                text = f"{path}:{number}: expected {','.join(COLUMNS)}; a marker has x, y, z only"
                raise ValueError(text) from None
            if not frames or at > frames[-1][0]:
                frames.append((at, {}, []))
            elif at < frames[-1][0]:
                raise ValueError(f"{path}:{number}: the time is before that of the line above")
            if body:
                frames[-1][1][body] = pose
            else:
                frames[-1][2].append(pose)
    if not frames:
        raise ValueError(f"{path}: no frames")
    return frames
