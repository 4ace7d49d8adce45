"""Validation of goals from any source. Does not import numpy."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from contextlib import suppress
from numbers import Real
from typing import TYPE_CHECKING, Any, Final

from star_external.planner import Goal, Point
from star_external.text import listed, quoted, refuse

if TYPE_CHECKING:
    from star_core import Scene

GOAL_KEYS: Final = ("position", "velocity", "yaw", "speed")


def checked(given: Mapping[str, Any], scene: Scene, names: Collection[str]) -> dict[str, Goal]:
    """Return the validated goals, by agent name.

    Args:
        given: Goal of each agent: a mapping with a ``position`` and optionally other `GOAL_KEYS`.
        scene: Fence, obstacles and limits, which goals must respect.
        names: Agents that goals may be for.

    Raises:
        InputError: A goal is invalid or cannot be flown to.

    Example:
        >>> from star_core.testing import scene
        >>> checked({"cf1": {"position": [1, 0, 0.8]}}, scene(1), ["cf1"])["cf1"]
        Goal(position=(1.0, 0.0, 0.8), velocity=(0.0, 0.0, 0.0), yaw=None, speed=None)
    """
    return {name: _goal(name, goal, scene, names) for name, goal in given.items()}


def _goal(name: str, given: Any, scene: Scene, names: Collection[str]) -> Goal:
    if name not in names:
        refuse(f"no agent named {quoted(name)} in this step; there are: {', '.join(names)}")
    if not isinstance(given, Mapping) or "position" not in given:
        refuse(f"{name}: the goal is {quoted(given)}, expected an object with a position")
    for key in given:
        if key not in GOAL_KEYS:
            refuse(f"{name}: unknown {quoted(key)}, expected {listed(GOAL_KEYS)}")
    position = _point(f"{name}: position", given["position"])
    if (why := _fault(scene, position)) is not None:
        refuse(f"{name}: {why}")
    velocity = _point(f"{name}: velocity", given.get("velocity", (0.0, 0.0, 0.0)))
    _not_too_fast(f"{name}: velocity", math.hypot(*velocity), scene)
    yaw = _number(f"{name}: yaw", given["yaw"]) if "yaw" in given else None
    speed = None
    if "speed" in given:
        speed = _number(f"{name}: speed", given["speed"])
        if speed <= 0:
            refuse(f"{name}: speed is {speed:g} m/s, expected more than 0")
        _not_too_fast(f"{name}: speed", speed, scene)
    return Goal(position, velocity, yaw, speed)


def _fault(scene: Scene, point: Point) -> str | None:
    """Return why no agent can fly at `point` (map frame, m), None if one can."""
    low, high = scene.limits.height
    if not low <= point[2] <= high:
        x, y, z = point
        return f"[{x:g}, {y:g}, {z:g}] is outside the heights to fly at, from {low:g} to {high:g} m"
    return scene.world.fault(point)


def _not_too_fast(what: str, speed: float, scene: Scene) -> None:
    if speed > scene.limits.speed:
        refuse(f"{what} of {speed:g} m/s is above limits.speed, {scene.limits.speed:g} m/s")


def _point(what: str, given: Any) -> Point:
    try:
        x, y, z = given  # a list, a tuple or an array
    except (TypeError, ValueError):
        refuse(f"{what} is {quoted(given)}, expected [x, y, z]")
    return _number(what, x), _number(what, y), _number(what, z)


def _number(what: str, given: Any) -> float:
    value = math.nan
    if isinstance(given, Real) and not isinstance(given, bool):  # also numpy's numbers
        with suppress(OverflowError):  # an integer too large for a float
            value = float(given)
    if not math.isfinite(value):
        refuse(f"{what} has {quoted(given)}, expected a finite number")
    return value
