"""Messages to and from the other process, one JSON object per line.

Lines of the other process:

    {"goals": {"cf1": {"position": [x, y, z]}}}    goals; agents not listed keep theirs
    {"done": true}                                 the step succeeded
    {"fail": "why"}                                the step failed

A goal has a ``position``, m in the map, and may have a ``velocity`` (of the goal, m/s), a ``yaw``
(rad) and a ``speed`` (maximum on the way, m/s).
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from numbers import Real
from reprlib import Repr
from typing import TYPE_CHECKING, Any, Final, NoReturn

from star_core import InputError
from star_core.toolkit import shortlist
from star_external.planner import Answer, Done, Failed, Goal, Point

if TYPE_CHECKING:
    from star_core import Estimate, Health, Scene

VERSION: Final = 1  # of the protocol
DEFAULT_TIMEOUT: Final = 60.0  # s, of the step
KEYS: Final = ("goals", "done", "fail")
GOAL_KEYS: Final = ("position", "velocity", "yaw", "speed")
MAX_YAW: Final = 1000.0  # rad: headings of clients may add up over turns
MIN_SPEED: Final = 0.01  # m/s: a slower goal is not reached in a flight
MAX_REASON: Final = 200  # characters kept of the reason of a failure
MAX_QUOTE: Final = 60  # characters shown of an invalid value


def ticks_between(rate: float | None, period: float) -> int:
    """Return the number of ticks between two state lines, or two calls to a planner.

    Args:
        rate: Wanted rate, 1/s; None for every tick.
        period: Duration of a tick, s.

    Example:
        >>> ticks_between(10, 0.05), ticks_between(None, 0.05), ticks_between(1000, 0.05)
        (2, 1, 1)
    """
    return 1 if rate is None else max(1, round(1 / (rate * period)))


def greeting(scene: Scene, rows: Sequence[int], rate: float, *, lockstep: bool) -> bytes:
    """Return the greeting: the agents to control, limits and fence.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        rate: State lines per second, 1/s.
        lockstep: Whether the simulation waits for an answer to each state line.
    """
    limits, fence = scene.limits, scene.world.fence
    return _line(
        {
            "star": VERSION,
            "agents": [scene.agents[row].name for row in rows],
            "rate": rate,
            "lockstep": lockstep,
            "limits": {
                "speed": limits.speed,
                "acceleration": limits.acceleration,
                "height": list(limits.height),
                "separation": limits.separation,
                "vertical_separation": limits.vertical_separation,
            },
            "fence": {"low": list(fence.low), "high": list(fence.high)},
        }
    )


def state(scene: Scene, rows: Sequence[int], estimate: Estimate, health: Health) -> bytes:
    """Return the state line of the agents; unknown values are null."""
    from star_core import AgentPhase

    agents = {}
    for row in rows:
        valid, battery = bool(estimate.valid[row]), float(health.battery[row])
        velocity = estimate.velocity[row].tolist()
        agents[scene.agents[row].name] = {
            "position": estimate.position[row].tolist() if valid else None,
            "velocity": velocity if valid and all(map(math.isfinite, velocity)) else None,
            "yaw": float(estimate.yaw[row]) if valid else None,
            "phase": AgentPhase(health.phase[row]).name.lower(),
            "battery": battery if math.isfinite(battery) else None,
        }
    return _line({"time": estimate.time, "agents": agents})


def refusal(why: str, number: int) -> bytes:
    """Return the error line for an invalid line: the reason and its number, from 1."""
    return _line({"error": why, "line": number})


def read(line: bytes, scene: Scene, names: Collection[str]) -> Answer:
    """Return the content of a line: goals by agent, success or failure of the step.

    Args:
        line: One line.
        scene: Fence, obstacles and limits, which goals must respect.
        names: Agents that goals may be for.

    Raises:
        InputError: The line is invalid, or one of its goals cannot be flown to.

    Example:
        >>> from star_core.testing import scene
        >>> read(b'{"fail": "no way"}', scene(1), ["cf1"])
        Failed(why='no way')
    """
    content = _json(line)
    if not isinstance(content, dict) or len(content) != 1 or next(iter(content)) not in KEYS:
        _refuse(f"expected an object with one of {_listed(KEYS)}, got {quoted(content)}")
    ((key, content_value),) = content.items()
    if key == "done":
        if content_value is not True:
            _refuse(f"done is {quoted(content_value)}, expected true")
        return Done()
    if key == "fail":
        if not isinstance(content_value, str):
            _refuse(f"fail is {quoted(content_value)}, expected the reason as a string")
        return Failed(shortened(content_value))
    if not isinstance(content_value, dict):
        _refuse(f"goals are {quoted(content_value)}, expected an object of goals by agent")
    return checked_goals(content_value, scene, names)


def checked_goals(
    goals: Mapping[str, Any], scene: Scene, names: Collection[str]
) -> dict[str, Goal]:
    """Return the validated goals, by agent name.

    Args:
        goals: Goal of each agent: a mapping with a ``position`` and optionally other `GOAL_KEYS`.
        scene: Fence, obstacles and limits, which goals must respect.
        names: Agents that goals may be for.

    Raises:
        InputError: A goal is invalid or cannot be flown to.

    Example:
        >>> from star_core.testing import scene
        >>> checked_goals({"cf1": {"position": [1, 0, 0.8]}}, scene(1), ["cf1"])["cf1"]
        Goal(position=(1.0, 0.0, 0.8), velocity=(0.0, 0.0, 0.0), yaw=None, speed=None)
    """
    return {name: _goal(name, goal, scene, names) for name, goal in goals.items()}


def quoted(value: Any) -> str:
    """Return a short representation of a value of any size."""
    quote = Repr()
    quote.maxlevel = 2
    text = quote.repr(value)
    return text if len(text) <= MAX_QUOTE else f"{text[: MAX_QUOTE - 3]}..."


def shortened(reason: str) -> str:
    """Return the reason of a failure shortened, on one line."""
    return "".join(c if c.isprintable() else " " for c in reason[:MAX_REASON])


def _goal(name: str, spec: Any, scene: Scene, names: Collection[str]) -> Goal:
    if name not in names:
        _refuse(f"no agent named {quoted(name)} in this step; there are: {shortlist(names)}")
    if not isinstance(spec, Mapping) or "position" not in spec:
        _refuse(f"{name}: the goal is {quoted(spec)}, expected an object with a position")
    for key in spec:
        if key not in GOAL_KEYS:
            _refuse(f"{name}: unknown {quoted(key)}, expected {_listed(GOAL_KEYS)}")
    position = _point(f"{name}: position", spec["position"])
    if fault := scene.position_fault(position):
        _refuse(f"{name}: {fault}")
    velocity = _point(f"{name}: velocity", spec.get("velocity", (0.0, 0.0, 0.0)))
    yaw = _number(f"{name}: yaw", spec["yaw"]) if "yaw" in spec else None
    speed = _number(f"{name}: speed", spec["speed"]) if "speed" in spec else None
    if yaw is not None and abs(yaw) > MAX_YAW:
        _refuse(f"{name}: yaw is {yaw:g} rad, expected from -{MAX_YAW:g} to {MAX_YAW:g}")
    if speed is not None and speed < MIN_SPEED:
        _refuse(f"{name}: speed is {speed:g} m/s, expected at least {MIN_SPEED:g}")
    limit = scene.limits.speed
    for what, value in (("velocity", math.hypot(*velocity)), ("speed", speed or 0.0)):
        if value > limit:
            _refuse(f"{name}: {what} of {value:g} m/s is above limits.speed, {limit:g} m/s")
    return Goal(position, velocity, yaw, speed)


def _point(what: str, value: Any) -> Point:
    try:
        x, y, z = value  # a list, a tuple or an array
    except (TypeError, ValueError):
        _refuse(f"{what} is {quoted(value)}, expected [x, y, z]")
    return _number(what, x), _number(what, y), _number(what, z)


def _number(what: str, number: Any) -> float:
    value = math.nan
    if isinstance(number, Real) and not isinstance(number, bool):  # also numpy's numbers
        with suppress(OverflowError):  # an integer too large for a float
            value = float(number)
    if not math.isfinite(value):
        _refuse(f"{what} has {quoted(number)}, expected a finite number")
    return value


def _refuse(why: str) -> NoReturn:
    raise InputError(why, code="invalid-message")


def _listed(names: Sequence[str]) -> str:
    """Return the names as an enumeration: ``'goals', 'done' and 'fail'``."""
    *others, last = map(repr, names)
    return f"{', '.join(others)} and {last}"


def _json(line: bytes) -> Any:
    try:
        return json.loads(line.decode(), parse_constant=_no_number, object_pairs_hook=_object)
    except RecursionError:
        _refuse("invalid JSON: too deeply nested")
    except ValueError as error:  # of JSON, of UTF-8, and of integers with thousands of digits
        _refuse(f"invalid JSON: {error}")


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the object with these pairs; duplicate names are an error."""
    made = dict(pairs)
    if len(made) < len(pairs):
        raise ValueError(f"duplicate name in {quoted([name for name, _ in pairs])}")
    return made


def _line(value: Any) -> bytes:
    return json.dumps(value, allow_nan=False).encode() + b"\n"
