"""A world: read from YAML, checked against its schema, frozen.

A world with polygons imports shapely, and numpy with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, pairwise
from typing import Any, Final

from star_core import Fence, InputError, Obstacle, Problem, Tag, World
from star_core.formats import Corner, Point, SourceFile, box, moved, turned, wall
from star_core.toolkit import TAG_RIM, TAG_SIZE, Beacon, outline_fault

MAX_VISIBLE_SIZES: Final = 100
"""Distance at which no camera resolves a tag, in sizes of the tag: with an AI-deck's focal length,
180 px, its eight modules are less than two pixels."""

_AXES: Final = ("roll", "pitch", "yaw")

FACE: Final = 0.01
"""Distance from a face of an obstacle within which a tag is taken to be stuck on it, m."""

SIDES: Final = 24  # of the polygon around a cylinder; its corners are 0.9 % outside the circle


def world(document: SourceFile) -> World:
    """Return the world that `document`, which fits the schema of worlds, describes.

    Raises:
        InputError: It makes no sense; every reason found is listed.
    """
    data = document.data
    faults = [*_fence(data), *_obstacles(data), *_offsets(data), *_tags(data)]
    if faults:
        raise InputError(document.located(faults))
    obstacles = data.get("obstacles", {})
    solid, virtual = (
        tuple(
            obstacle(name, options)
            for name, options in obstacles.items()
            if options.get("virtual", False) is kind
        )
        for kind in (False, True)
    )
    made = World(
        name=data["name"],
        fence=Fence(low=point(data["fence"]["low"]), high=point(data["fence"]["high"])),
        obstacles=solid,
        landmarks=tuple(tag for _, tag in _sheets(data, "landmarks")),
        targets=tuple(tag for _, tag in _sheets(data, "targets")),
        virtual=virtual,
        base_stations=_beacons(data, "base_stations"),
        anchors=_beacons(data, "anchors"),
    )
    if faults := list(_hidden(data, made)):
        raise InputError(document.located(faults))
    return made


def _beacons(data: Mapping[str, Any], kind: str) -> tuple[Beacon, ...]:
    """Return the base stations or the anchors of a world."""
    return tuple(
        Beacon(name, point(options["at"]), _rotation(options))
        for name, options in data.get(kind, {}).items()
    )


def _rotation(options: Mapping[str, Any]) -> tuple[float, float, float, float]:
    """Return the rotation that three angles in degrees describe."""
    return turned(*(math.radians(options.get(f"{axis}_deg", 0.0)) for axis in _AXES))


def point(coordinates: Sequence[float]) -> Point:
    """Return three numbers as a point."""
    x, y, z = coordinates
    return float(x), float(y), float(z)


def _sheets(data: Mapping[str, Any], kind: str) -> Iterator[tuple[tuple[str | int, ...], Tag]]:
    """Every tag of the landmarks or of the targets, with the location of its number in the file."""
    for name, sheet in data.get(kind, {}).items():
        rotation = _rotation(sheet)
        size = float(sheet.get("size", TAG_SIZE))
        spacing = sheet.get("spacing", TAG_RIM * size)
        middle = (len(sheet["tags"]) - 1) / 2
        row = [((i - middle) * spacing, 0.0) for i in range(len(sheet["tags"]))]
        x, y, z = sheet["at"]
        for i, (number, (right, up)) in enumerate(
            zip(sheet["tags"], sheet.get("offsets", row), strict=False)
        ):
            dx, dy, dz = moved(rotation, (right, up, 0.0))
            at = (x + dx, y + dy, z + dz)
            yield (kind, name, "tags", i), Tag(number, size, at, rotation, name)


def _fence(data: Mapping[str, Any]) -> Iterator[Problem]:
    low, high = data["fence"]["low"], data["fence"]["high"]
    if any(a >= b for a, b in zip(low, high, strict=True)):
        swapped = all(a > b for a, b in zip(low, high, strict=True))
        hint = "; exchange low and high" if swapped else ""
        message = f"the fence's low {low!r} is not below high {high!r} in x, y and z{hint}"
        yield Problem(("fence",), message, "empty-range")


def _obstacles(data: Mapping[str, Any]) -> Iterator[Problem]:
    empty = any(_fence(data))
    fence = None if empty else Fence(point(data["fence"]["low"]), point(data["fence"]["high"]))
    for name, options in data.get("obstacles", {}).items():
        for problem in obstacle_faults(options, fence):
            text = f"obstacle {name!r} {problem.message}"
            yield Problem(("obstacles", name, *problem.path), text, problem.code)


def _offsets(data: Mapping[str, Any]) -> Iterator[Problem]:
    for kind in ("landmarks", "targets"):
        for name, sheet in data.get(kind, {}).items():
            n, m = len(sheet.get("offsets", sheet["tags"])), len(sheet["tags"])
            if n != m:
                yield Problem(
                    (kind, name, "offsets"),
                    f"{kind[:-1]} {name!r} has {n} offsets for {m} tags, expected one each",
                    "wrong-length",
                )
            if "offsets" in sheet and "spacing" in sheet:
                yield Problem(
                    (kind, name, "spacing"),
                    f"{kind[:-1]} {name!r}: 'spacing' does not go with 'offsets'",
                    "option-conflict",
                )


def _hidden(data: Mapping[str, Any], room: World) -> Iterator[Problem]:
    """Tags that no camera inside the fence can make out, and targets that no agent can reach."""
    for kind in ("landmarks", "targets"):
        for (_, name, *_), tag in _sheets(data, kind):
            shown = "[" + ", ".join(f"{value:g}" for value in tag.position) + "]"
            away = room.fence.distance(tag.position)
            inside = next((o.name for o in room.obstacles if _deep(o, tag.position)), None)
            if inside is not None:
                message = f"tag {tag.id} at {shown} is inside obstacle {inside!r}"
                yield Problem((kind, name, "at"), message, "inside-obstacle")
            elif away > MAX_VISIBLE_SIZES * tag.size:
                yield Problem(
                    (kind, name, "at"),
                    f"tag {tag.id} at {shown} is {away:.2f} m outside the fence, too far to be "
                    f"made out: {MAX_VISIBLE_SIZES} times its size of {tag.size:g} m",
                    "outside-geofence",
                )


def _deep(obstacle: Obstacle, at: Point) -> bool:
    """Whether a point is inside an obstacle, and neither on its faces nor on its top."""
    x, y, z = at
    return z < obstacle.height[1] and all(
        obstacle.contains((x + dx, y + dy, z)) for dx in (-FACE, FACE) for dy in (-FACE, FACE)
    )


def _tags(data: Mapping[str, Any]) -> Iterator[Problem]:
    """Tags that cannot be distinguished: of one number, or one over the other."""
    by_id: dict[int, tuple[tuple[str | int, ...], Tag]] = {}
    for path, tag in (*_sheets(data, "landmarks"), *_sheets(data, "targets")):
        if tag.id in by_id:
            of = by_id[tag.id][1].of
            message = f"tag {tag.id} belongs to {of!r} already; give each its own number"
            yield Problem(path, message, "duplicate-tag")
        else:
            by_id[tag.id] = path, tag
    for (_, first), (path, second) in combinations(by_id.values(), 2):
        if math.dist(first.position, second.position) < (first.size + second.size) / 2:
            message = f"tag {second.id} overlaps tag {first.id} of {first.of!r}"
            yield Problem(path, message, "overlapping-tags")


def obstacle(name: str, options: Mapping[str, Any]) -> Obstacle:
    """Return an obstacle that fits the schema of worlds and has no fault."""
    foot, top = options["height"]
    return Obstacle(name, _pieces(options), (float(foot), float(top)))


def obstacle_faults(options: Mapping[str, Any], fence: Fence | None) -> Iterator[Problem]:
    """Yield what is wrong with an obstacle that fits the schema, and the keys that lead there.

    Args:
        options: As the world file has it.
        fence: An obstacle that is nowhere inside of it is wrong; None to leave that out.
    """
    foot, top = options["height"]
    if foot >= top:
        message = f"has its foot at {foot!r} m, not below its top at {top!r} m"
        yield Problem(("height",), message, "empty-range")
    if "polygon" in options:
        fault = outline_fault(_corners(options["polygon"]))
    elif any(a == b for a, b in pairwise(options.get("polyline", ()))):
        fault = "has the same point twice in a row"
    else:
        fault = None
    if fault:
        yield Problem((), fault, "invalid-outline")
    elif fence and all(_apart(piece, (foot, top), fence) for piece in _pieces(options)):
        message = "is outside the fence; no agent can come near it"
        yield Problem((), message, "outside-geofence")


def _pieces(options: Mapping[str, Any]) -> tuple[tuple[Corner, ...], ...]:
    """The polygons of an obstacle."""
    if "polyline" in options:
        flat = options.get("flat_ends", False)
        return wall(_corners(options["polyline"]), options["thickness"], flat=flat)
    if "box" in options:
        form = options["box"]
        return (box(form["centre"], form["size"], math.radians(form.get("yaw_deg", 0.0))),)
    if "cylinder" in options:
        return (around_circle(options["cylinder"]["centre"], options["cylinder"]["radius"]),)
    return (_corners(options["polygon"]),)


def _corners(points: list[list[float]]) -> tuple[Corner, ...]:
    return tuple((x, y) for x, y in points)


def _apart(piece: tuple[Corner, ...], height: tuple[float, float], fence: Fence) -> bool:
    """Whether one of the fence's six sides has all of a prism beyond it."""
    ranges = (*((min(axis), max(axis)) for axis in zip(*piece, strict=True)), height)
    return any(
        greatest < low or least > high
        for (least, greatest), low, high in zip(ranges, fence.low, fence.high, strict=True)
    )


def around_circle(centre: Sequence[float], radius: float) -> tuple[Corner, ...]:
    """Return the corners of a regular polygon of `SIDES` around a circle, which it contains.

    Args:
        centre: x and y, m.
        radius: Of the circle, m.
    """
    x, y = centre
    reach = radius / math.cos(math.pi / SIDES)
    angles = (math.tau * i / SIDES for i in range(SIDES))
    return tuple((x + reach * math.cos(angle), y + reach * math.sin(angle)) for angle in angles)
