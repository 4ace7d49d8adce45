"""The obstacles of a world file: upright prisms from their short forms, and what is wrong with one.

A world with polygons imports shapely, and numpy with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

from star_core.contracts import Problem
from star_core.world.outlines import around_circle, box, outline_fault, wall
from star_core.world.world import Corner, Fence, Obstacle


def obstacle(name: str, given: Mapping[str, Any]) -> Obstacle:
    """Return an obstacle that fits the schema of worlds and has no fault."""
    foot, top = given["height"]
    return Obstacle(name, _pieces(given), (float(foot), float(top)))


def obstacle_faults(given: Mapping[str, Any], fence: Fence | None) -> Iterator[Problem]:
    """Yield what is wrong with an obstacle that fits the schema, and the keys that lead there.

    Args:
        given: As the world file has it.
        fence: An obstacle that is nowhere inside of it is wrong; None to leave that out.
    """
    foot, top = given["height"]
    if foot >= top:
        message = f"has its foot at {foot!r} m, not below its top at {top!r} m"
        yield Problem(("height",), message, "empty-range")
    if "polygon" in given:
        fault = outline_fault(_corners(given["polygon"]))
    elif any(a == b for a, b in pairwise(given.get("polyline", ()))):
        fault = "has the same point twice in a row"
    else:
        fault = None
    if fault:
        yield Problem((), fault, "invalid-outline")
    elif fence and all(_apart(piece, (foot, top), fence) for piece in _pieces(given)):
        message = "is outside the fence; no agent can come near it"
        yield Problem((), message, "outside-geofence")


def _pieces(given: Mapping[str, Any]) -> tuple[tuple[Corner, ...], ...]:
    """The polygons of an obstacle."""
    if "polyline" in given:
        return wall(_corners(given["polyline"]), given["thickness"])
    if "box" in given:
        form = given["box"]
        return (box(form["centre"], form["size"], math.radians(form.get("yaw_deg", 0.0))),)
    if "cylinder" in given:
        return (around_circle(given["cylinder"]["centre"], given["cylinder"]["radius"]),)
    return (_corners(given["polygon"]),)


def _corners(given: list[list[float]]) -> tuple[Corner, ...]:
    return tuple((x, y) for x, y in given)


def _apart(piece: tuple[Corner, ...], height: tuple[float, float], fence: Fence) -> bool:
    """Whether one of the fence's six sides has all of a prism beyond it."""
    ranges = (*((min(axis), max(axis)) for axis in zip(*piece, strict=True)), height)
    return any(
        greatest < low or least > high
        for (least, greatest), low, high in zip(ranges, fence.low, fence.high, strict=True)
    )
