"""A plan of a floor with the tags of its world, and the distances by which they are laid out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

import numpy as np

from star_core import InputError, Registry, World
from star_core.formats import format_function, read_as
from star_core.toolkit import (
    PAPERS,
    TAG_SIZE,
    Fill,
    Outline,
    Page,
    Point,
    Text,
    quaternion_from_euler,
    rectangle,
    rotation_from_quaternion,
)

MARGIN: Final = 14.0  # mm: more than the unprintable margin of printers
HEAD: Final = 16.0  # mm at the top for the title
STRIP: Final = 26.0  # mm at the bottom for the bar and what the plan is
SCALES: Final = (5, 10, 20, 25, 30, 40, 50, 75, 100, 150, 200, 250, 500, 1000)  # 1:N
LINE: Final = 6.0  # mm between the lines of the table
COLUMNS: Final = (0.0, 30.0, 71.0, 86.0, 101.0, 116.0, 150.0, 168.0)  # mm, of the table
TITLES: Final = ("tags", "name", "x", "y", "z", "roll, pitch, yaw", "from A", "from B")
TURNS: Final = ("roll", "pitch", "yaw")  # about the map's axes, in this order
LETTER: Final = 1.6  # mm, mean width of a letter of 3 mm
LEAST_BAR: Final = 20.0  # mm
LEAST_DRAWN: Final = 2.5  # mm, edge of a tag on the plan
EDGE_ON: Final = 1.2  # mm, width of an upright tag on the plan


class Place(NamedTuple):
    """Tags that are laid out together."""

    name: str
    tags: tuple[int, ...]
    at: tuple[float, float, float]  # middle, map frame, m
    turn: tuple[float, float, float]  # roll, pitch and yaw, degrees
    size: float  # m

    @property
    def axes(self) -> tuple[Point, Point]:
        """The tag's right and its up direction, as they are seen from above."""
        angles = (np.array([math.radians(angle)]) for angle in self.turn)
        rotation = rotation_from_quaternion(quaternion_from_euler(*angles)[0])
        (right_x, up_x, _), (right_y, up_y, _), _ = rotation.tolist()
        return (right_x, right_y), (up_x, up_y)


def plan_pages(path: Path, paper: str, registry: Registry) -> list[Page]:
    """Return a plan of the world at `path`, and the table of its tags.

    Raises:
        InputError: It cannot be read, has no tags, or is too large for the paper.
    """
    document = read_as(path, "world", registry)
    places = list(_places(document.data))
    if not places:
        raise InputError(f"{path}: has neither landmarks nor targets to print", "no-tags")
    _agents, world = format_function("restore", registry)(
        {"mission": {"swarm": {}}, "world": document.data}, path
    )
    plan = _plan(cast("World", world), places, paper)
    return [plan, *_table(str(document.data["name"]), cast("World", world), places, paper)]


def _places(data: Any) -> Iterator[Place]:
    for kind in ("landmarks", "targets"):
        for name, spec in data.get(kind, {}).items():
            x, y, z = (float(value) for value in spec["at"])
            roll, pitch, yaw = (float(spec.get(f"{turn}_deg", 0.0)) for turn in TURNS)
            size = float(spec.get("size", TAG_SIZE))
            yield Place(str(name), tuple(spec["tags"]), (x, y, z), (roll, pitch, yaw), size)


def _plan(world: World, places: Sequence[Place], paper: str) -> Page:
    """Return the floor to scale: walls of the fence, obstacles, tags and their names."""
    (left, front, _), (right, back, _) = world.fence.low, world.fence.high
    wide, deep = 1000 * (right - left), 1000 * (back - front)  # mm
    small, large = PAPERS[paper]
    width, height = (large, small) if wide > deep else (small, large)
    room = width - 2 * MARGIN, height - HEAD - STRIP
    scale = next((n for n in SCALES if wide / n <= room[0] and deep / n <= room[1]), None)
    if scale is None:
        raise InputError(f"the fence of {world.name!r} is too large for a plan", "paper-too-small")
    per_metre = 1000 / scale
    low = (MARGIN + (room[0] - wide / scale) / 2, STRIP + (room[1] - deep / scale) / 2)

    def on_page(x: float, y: float) -> Point:
        return low[0] + per_metre * (x - left), low[1] + per_metre * (y - front)

    corners = [on_page(*point) for point in _corners(world)]
    walls = tuple(
        _stroke(a, b, 0.4) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    )
    shapes = tuple(
        _anticlockwise([on_page(x, y) for x, y in piece])
        for obstacle in world.obstacles
        for piece in obstacle.polygons
    )
    squares, names = [], []
    for place in places:
        x, y = on_page(*place.at[:2])
        half = max(per_metre * place.size, LEAST_DRAWN) / 2
        (right_x, right_y), (up_x, up_y) = place.axes
        across, up = (half * right_x, half * right_y), (half * up_x, half * up_y)
        squares.append(_parallelogram((x, y), across, up))
        begin, end = (x - across[0], y - across[1]), (x + across[0], y + across[1])
        squares.append(_stroke(begin, end, EDGE_ON))
        squares.append(_stroke((x, y), (x + 2 * up[0], y + 2 * up[1]), 0.4))
        label = f"{_numbers(place.tags)} ({place.at[0]:g}, {place.at[1]:g})"
        below = x - LETTER * len(label) / 2, y - 1.5 * half - 4.0  # of a square turned by any angle
        names.append(Text(below, 3.0, label))
    marks: list[Fill | Text] = [Fill((outline,), gray=0.8) for outline in shapes]
    marks += _axes(on_page, world)
    marks += [Fill((outline,)) for outline in (*walls, *squares)]
    marks += names
    marks += _bar(scale)
    marks += [
        Text((MARGIN, height - 11), 6, f"{world.name}: plan of the tags, 1:{scale}"),
        Text((corners[0][0] - 4, corners[0][1] - 5), 4, "A"),
        Text((corners[1][0] + 1, corners[1][1] - 5), 4, "B"),
    ]
    return Page(width, height, tuple(marks))


def _axes(on_page: Any, world: World) -> list[Fill | Text]:
    """Return the map's axes where its origin is inside the fence."""
    if not world.fence.contains((0.0, 0.0, world.fence.low[2])):
        return []
    x, y = on_page(0.0, 0.0)
    lines = _stroke((x, y), (x + 8, y), 0.3), _stroke((x, y), (x, y + 8), 0.3)
    return [
        *(Fill((line,), gray=0.5) for line in lines),
        Text((x + 8.5, y - 1), 3, "x"),
        Text((x - 0.8, y + 9), 3, "y"),
    ]


def _bar(scale: int) -> list[Fill | Text]:
    """Return a bar of a round length in the room, and what to do with the plan."""
    lengths = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
    metres = next(length for length in lengths if 1000 * length / scale >= LEAST_BAR)
    long = 1000 * metres / scale
    ends = rectangle((MARGIN, 13), 0.5, 4), rectangle((MARGIN + long - 0.5, 13), 0.5, 4)
    return [
        Fill((*ends, rectangle((MARGIN + 0.5, 14.75), long - 1, 0.5))),
        Text((MARGIN + long + 2, 13.5), 3.5, f"{metres:g} m"),
        Text((MARGIN, 7), 3.5, "Frame: the fence. Lines point to upper edges; upright tags have"
             " none. Labels: tags, (x, y) in m."),
    ]  # fmt: skip


def _table(name: str, world: World, places: Sequence[Place], paper: str) -> list[Page]:
    """Return pages with the position of each tag, and its distances from two corners."""
    width, height = PAPERS[paper]
    (ax, ay), (bx, by) = _corners(world)[:2]
    about = (
        f"A is the fence's corner at ({ax:g}, {ay:g}) m, B that at ({bx:g}, {by:g}) m, "
        f"{math.hypot(bx - ax, by - ay):.3f} m apart.",
        "Measure both distances on the floor, to the point below the middle of the tags; all in m.",
    )
    rows = [
        (
            _numbers(place.tags),
            place.name[:22],
            *(f"{value:.3f}" for value in place.at),
            ", ".join(f"{angle:g}°" for angle in place.turn),
            f"{math.hypot(place.at[0] - ax, place.at[1] - ay):.3f}",
            f"{math.hypot(place.at[0] - bx, place.at[1] - by):.3f}",
        )
        for place in places
    ]
    per_page = int((height - 58 - MARGIN) / LINE)
    pages = []
    for first in range(0, len(rows), per_page):
        top = height - 18
        marks: list[Fill | Text] = [Text((MARGIN, top), 6, f"{name}: distances of the tags")]
        marks += [Text((MARGIN, top - 9 - 5 * i), 3.5, line) for i, line in enumerate(about)]
        for i, row in enumerate((TITLES, *rows[first : first + per_page])):
            y = top - 24 - LINE * i
            marks += [
                Text((MARGIN + x, y), 3.3, cell) for x, cell in zip(COLUMNS, row, strict=True)
            ]
            marks.append(Fill((rectangle((MARGIN, y - 1.8), width - 2 * MARGIN, 0.15),), gray=0.6))
        pages.append(Page(width, height, tuple(marks)))
    return pages


def _corners(world: World) -> list[Point]:
    """Return the corners of the fence, anticlockwise from the least x and y, m."""
    (left, front, _), (right, back, _) = world.fence.low, world.fence.high
    return [(left, front), (right, front), (right, back), (left, back)]


def _numbers(tags: Sequence[int]) -> str:
    """Return numbers of tags as text.

    >>> _numbers((0, 1)), _numbers((3, 4, 5, 9))
    ('0, 1', '3 to 9, 4 tags')
    """
    if len(tags) < 4:  # noqa: PLR2004 -- as many as fit a column
        return ", ".join(map(str, tags))
    return f"{tags[0]} to {tags[-1]}, {len(tags)} tags"


def _stroke(begin: Point, end: Point, width: float) -> Outline:
    """Return a line as a polygon, anticlockwise."""
    x, y = end[0] - begin[0], end[1] - begin[1]
    length = max(math.hypot(x, y), 1e-9)
    dx, dy = -y / length * width / 2, x / length * width / 2
    return (
        (begin[0] - dx, begin[1] - dy),
        (end[0] - dx, end[1] - dy),
        (end[0] + dx, end[1] + dy),
        (begin[0] + dx, begin[1] + dy),
    )


def _parallelogram(middle: Point, first: Point, second: Point) -> Outline:
    """Return the outline whose edges are twice two vectors, anticlockwise."""
    corners = [
        (middle[0] + a * first[0] + b * second[0], middle[1] + a * first[1] + b * second[1])
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return _anticlockwise(corners)


def _anticlockwise(outline: list[Point]) -> Outline:
    area = sum(
        a[0] * b[1] - b[0] * a[1] for a, b in zip(outline, [*outline[1:], outline[0]], strict=True)
    )
    return tuple(outline if area > 0 else outline[::-1])
