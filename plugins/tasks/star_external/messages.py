"""What the other process may say, one JSON object a line, and what is wrong with it.

    {"goals": {"cf1": {"position": [x, y, z]}}}    goals; those not named keep theirs
    {"done": true}                                 the step is over, and a success
    {"fail": "why"}                                the step failed

A goal has a ``position``, m in the map, and may have a ``velocity`` (of the goal, m/s), a ``yaw``
(rad) and a ``speed`` (greatest on the way, m/s). Nothing here imports numpy.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from reprlib import Repr
from typing import TYPE_CHECKING, Any, Final, NoReturn, TypeAlias

from star_core import InputError

if TYPE_CHECKING:
    from star_core import Scene

Point = tuple[float, float, float]

KEYS: Final = ("goals", "done", "fail")
GOAL_KEYS: Final = ("position", "velocity", "yaw", "speed")
AXES: Final = 3
LONGEST_REASON: Final = 200
"""Of why a step failed this many characters are kept."""

LONGEST_QUOTE: Final = 60
"""Of a value that is refused this many characters are shown."""


@dataclass(frozen=True, slots=True)
class Goal:
    """Where the other process wants one agent.

    Attributes:
        position: In the map, m.
        velocity: Of the goal, m/s.
        yaw: rad; None leaves it.
        speed: Greatest on the way, m/s; None for the mission's limit.
    """

    position: Point
    velocity: Point = (0.0, 0.0, 0.0)
    yaw: float | None = None
    speed: float | None = None


@dataclass(frozen=True, slots=True)
class Done:
    """The step is over."""


@dataclass(frozen=True, slots=True)
class Failed:
    """The step failed, and why."""

    why: str


Message: TypeAlias = Mapping[str, Goal] | Done | Failed


def read(line: bytes, scene: Scene, names: Collection[str]) -> Message:
    """Return what a line says: goals by agent, that the step is over, or that it failed.

    Args:
        line: One line.
        scene: Fence, obstacles and limits, within which goals are to be.
        names: Agents that goals may be for.

    Raises:
        InputError: It says nothing that it may, or one of its goals cannot be flown to.

    Example:
        >>> from star_core.testing import scene
        >>> read(b'{"goals": {"cf1": {"position": [1, 0, 0.8]}}}', scene(1), ["cf1"])["cf1"]
        Goal(position=(1.0, 0.0, 0.8), velocity=(0.0, 0.0, 0.0), yaw=None, speed=None)
    """
    said = _json(line)
    if not isinstance(said, dict) or len(said) != 1 or next(iter(said)) not in KEYS:
        _refuse(f"expected an object with one of {_list(KEYS)}, got {_quoted(said)}")
    ((key, given),) = said.items()
    if key == "done":
        if given is not True:
            _refuse(f"done is {_quoted(given)}, expected true")
        return Done()
    if key == "fail":
        if not isinstance(given, str):
            _refuse(f"fail is {_quoted(given)}, expected why, in words")
        return Failed("".join(c if c.isprintable() else " " for c in given[:LONGEST_REASON]))
    if not isinstance(given, dict):
        _refuse(f"goals are {_quoted(given)}, expected an object of goals by agent")
    return {name: _goal(name, goal, scene, names) for name, goal in given.items()}


def _json(line: bytes) -> Any:
    try:
        return json.loads(line.decode(), parse_constant=_no_number, object_pairs_hook=_once)
    except RecursionError:
        _refuse("no JSON: too deep")
    except ValueError as error:  # of JSON, of UTF-8, and of integers with thousands of digits
        _refuse(f"no JSON: {error}")


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make an object of what is in it, if every name is there once."""
    made = dict(pairs)
    if len(made) < len(pairs):
        raise ValueError(f"a name stands twice in {_quoted([name for name, _ in pairs])}")
    return made


def _goal(name: str, given: Any, scene: Scene, names: Collection[str]) -> Goal:
    if name not in names:
        _refuse(f"no agent named {_quoted(name)} in this step; there are: {', '.join(names)}")
    if not isinstance(given, dict) or "position" not in given:
        _refuse(f"{name}: the goal is {_quoted(given)}, expected an object with a position")
    for key in given:
        if key not in GOAL_KEYS:
            _refuse(f"{name}: unknown {_quoted(key)}, expected {_list(GOAL_KEYS)}")
    position = _point(f"{name}: position", given["position"])
    if (why := _fault(scene, position)) is not None:
        _refuse(f"{name}: {why}")
    velocity = _point(f"{name}: velocity", given.get("velocity", (0.0, 0.0, 0.0)))
    _not_too_fast(f"{name}: velocity", math.hypot(*velocity), scene)
    yaw = _number(f"{name}: yaw", given["yaw"]) if "yaw" in given else None
    speed = None
    if "speed" in given:
        speed = _number(f"{name}: speed", given["speed"])
        if speed <= 0:
            _refuse(f"{name}: speed is {speed:g} m/s, expected more than 0")
        _not_too_fast(f"{name}: speed", speed, scene)
    return Goal(position, velocity, yaw, speed)


def _fault(scene: Scene, point: Point) -> str | None:
    """Say why no agent can fly at `point` (map frame, m), or return None if one can."""
    low, high = scene.limits.height
    if not low <= point[2] <= high:
        x, y, z = point
        return f"[{x:g}, {y:g}, {z:g}] is outside the heights to fly at, from {low:g} to {high:g} m"
    return scene.world.fault(point)


def _not_too_fast(what: str, speed: float, scene: Scene) -> None:
    if speed > scene.limits.speed:
        _refuse(f"{what} of {speed:g} m/s is above limits.speed, {scene.limits.speed:g} m/s")


def _point(what: str, given: Any) -> Point:
    if not isinstance(given, list | tuple) or len(given) != AXES:
        _refuse(f"{what} is {_quoted(given)}, expected [x, y, z]")
    x, y, z = (_number(what, value) for value in given)
    return x, y, z


def _number(what: str, given: Any) -> float:
    value = math.nan
    if isinstance(given, int | float) and not isinstance(given, bool):
        with suppress(OverflowError):  # a whole number beyond all floats
            value = float(given)
    if not math.isfinite(value):
        _refuse(f"{what} has {_quoted(given)}, expected a finite number")
    return value


def _list(names: Collection[str]) -> str:
    *others, last = (repr(name) for name in names)
    return f"{', '.join(others)} and {last}" if others else last


def _quoted(value: Any) -> str:
    """Show a value in few characters, however much there is of it."""
    quote = Repr()
    quote.maxlevel = 2
    text = quote.repr(value)
    return text if len(text) <= LONGEST_QUOTE else f"{text[: LONGEST_QUOTE - 3]}..."


def _refuse(why: str) -> NoReturn:
    raise InputError([why])
