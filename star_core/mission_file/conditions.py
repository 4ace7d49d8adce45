"""Conditions of a mission, which are data: whether they hold now, and what is wrong with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from star_core.errors import MAX_LISTED, suggestion
from star_core.plugin_support.specs import Problem

if TYPE_CHECKING:
    from star_core.messages.events import Event
    from star_core.messages.state import Estimate, Health
    from star_core.scene import Scene
    from star_core.world.quaternions import Point

Condition: TypeAlias = Mapping[str, Any]

ROUNDING: Final = 1e-9
"""What mission time may lack of a whole number of ticks, s."""


CLAUSES: Final[Mapping[str, str]] = {
    "elapsed": "{:g} s have passed",
    "found": "{} targets are found",
    "battery_below": "a battery is below {:g} V",
    "event": "{!r} happens",
}


@dataclass(frozen=True, slots=True)
class ConditionContext:
    """What conditions are asked about.

    Attributes:
        rows: The agents of the step.
        begun: When the step began, s.
        time: Mission time, s.
        estimate: Of all agents.
        health: Of all agents.
        names: Of the agents, by row.
        targets: Names of those that were found.
        events: All events so far, the newest last.
    """

    rows: tuple[int, ...]
    begun: float
    time: float
    estimate: Estimate
    health: Health
    names: Sequence[str]
    targets: Sequence[str]
    events: Sequence[Event]


def holds(condition: Condition, now: ConditionContext) -> bool:
    """Return whether a condition holds.

    Args:
        condition: A map of one of ``elapsed``, ``found``, ``near``, ``battery_below``, ``event``,
            ``any``, ``all`` and ``not``, as the mission schema has it.
        now: What it is asked about.
    """
    ((kind, given),) = condition.items()
    return KINDS[kind](given, now)


def longest_wait(condition: Condition) -> float:
    """Return the longest time that a condition waits for as such, s; 0 if it names none."""
    ((kind, given),) = condition.items()
    if kind in {"any", "all"}:
        return max(longest_wait(inner) for inner in given)
    if kind == "not":
        return longest_wait(given)
    return float(given) if kind == "elapsed" else 0.0


def holds_from(condition: Condition, others: float) -> float:
    """Return the time from which a condition holds if all others than ``elapsed`` do from `others`.

    With 0 it is the time before which the condition cannot hold, s; with infinity the time from
    which it holds whatever happens.

    >>> some = {"all": [{"any": [{"found": 1}, {"elapsed": 30}]}, {"elapsed": 5}]}
    >>> holds_from(some, 0.0), holds_from(some, math.inf)
    (5.0, 30.0)
    """
    ((kind, given),) = condition.items()
    if kind in {"any", "all"}:
        return (min if kind == "any" else max)(holds_from(inner, others) for inner in given)
    return float(given) if kind == "elapsed" else others


def in_words(condition: Condition) -> str:
    """Return a condition as a clause.

    >>> in_words({"any": [{"found": 2}, {"not": {"elapsed": 30}}]})
    '(2 targets are found or not 30 s have passed)'
    """
    ((kind, given),) = condition.items()
    if kind in {"any", "all"}:
        word = " or " if kind == "any" else " and "
        return "(" + word.join(in_words(inner) for inner in given) + ")"
    if kind == "not":
        return f"not {in_words(given)}"
    if kind == "near":
        point = given.get("agent") or f"[{', '.join(f'{value:g}' for value in given['point'])}]"
        return f"all are within {given['within']:g} m of {point}"
    if kind == "found" and isinstance(given, str):
        return f"{given!r} is found"
    return CLAUSES[kind].format(given)


def needs_find(condition: Condition) -> bool:
    """Return whether a condition cannot hold as long as no target is found.

    >>> needs_find({"all": [{"found": 1}, {"elapsed": 3}]}), needs_find({"not": {"found": 1}})
    (True, False)
    """
    ((kind, given),) = condition.items()
    if kind == "any":
        return all(needs_find(inner) for inner in given)
    if kind == "all":
        return any(needs_find(inner) for inner in given)
    return kind == "found" or (kind == "event" and given == "found")


def until_problems(
    until: Condition, timeout: float | None, scene: Scene, rows: Sequence[int]
) -> Iterator[Problem]:
    """Yield what is wrong with a step's ``until`` that its schema cannot detect.

    Args:
        until: The condition.
        timeout: Of the step, s; None if not given.
        scene: The mission's scene.
        rows: The agents of the step.
    """
    limit = math.inf if timeout is None else timeout
    targets = tuple(dict.fromkeys(tag.of for tag in scene.world.targets))
    names = tuple(scene.names[row] for row in rows)
    wrong = [*problems(until, scene.names, targets, names, scene.world.fence.distance)]
    yield from wrong
    if not wrong and needs_find(until) and all(agent.camera is None for agent in scene.agents):
        message = "no agent has a camera to find a target with; give agents `camera: aideck`"
        yield Problem((), message, "missing-camera")
    if (least := holds_from(until, 0.0)) > limit:
        message = f"holds after {least:g} s, but the step times out after {limit:g} s"
        yield Problem((), message, "option-conflict")


def problems(
    condition: Condition,
    agents: Sequence[str],
    targets: Sequence[str],
    of_step: Sequence[str] = (),
    outside: Callable[[Point], float] = lambda _: 0.0,
) -> Iterator[Problem]:
    """Yield what is wrong with a condition that its schema cannot detect.

    Args:
        condition: The condition.
        agents: Names of the agents.
        targets: Names of the world's targets.
        of_step: Names of the agents of the step.
        outside: Returns the distance of a point from where agents can be, m.
    """
    ((kind, given),) = condition.items()
    inner = given if kind in {"any", "all"} else [given] if kind == "not" else []
    for i, one in enumerate(inner):
        at = (kind,) if kind == "not" else (kind, i)
        for problem in problems(one, agents, targets, of_step, outside):
            yield problem._replace(path=(*at, *problem.path))
    if kind == "found" and isinstance(given, str) and given not in targets:
        hint = suggestion(given, targets, "there are", MAX_LISTED)
        yield Problem((kind,), f"no target named {given!r}{hint}", "unknown-target")
    elif kind == "found" and isinstance(given, int) and given > len(targets):
        message = f"{given!r} is more than the {len(targets)} targets of the world"
        yield Problem((kind,), message, "out-of-range")
    elif kind == "near" and ("agent" in given) == ("point" in given):
        yield Problem((kind,), "needs either 'point' or 'agent'", "option-conflict")
    elif kind == "near" and given.get("agent", agents[0]) not in agents:
        name = given["agent"]
        hint = suggestion(name, agents, "there are", MAX_LISTED)
        yield Problem((kind, "agent"), f"no agent named {name!r}{hint}", "unknown-agent")
    elif kind == "near" and [*of_step] == [given.get("agent")]:
        message = f"{of_step[0]!r} is always near itself; name another agent"
        yield Problem((kind, "agent"), message, "agent-conflict")
    elif kind == "near" and "point" in given:
        x, y, z = given["point"]
        away = outside((float(x), float(y), float(z)))
        if away > given["within"]:
            yield Problem(
                (kind, "point"),
                f"{given['point']!r} is {away:.2f} m outside the fence; no agent comes within "
                f"{given['within']:g} m",
                "outside-geofence",
            )


def _near(given: Mapping[str, Any], now: ConditionContext) -> bool:
    """Whether every agent of the step is near a point, or near another agent."""
    import numpy as np

    if "agent" in given:
        point = now.estimate.position[now.names.index(given["agent"])]
    else:
        point = np.array(given["point"], float)
    away = np.linalg.norm(now.estimate.position[list(now.rows)] - point, axis=1)
    return bool((away <= given["within"]).all())


def _found(given: str | int, now: ConditionContext) -> bool:
    return given in now.targets if isinstance(given, str) else len(now.targets) >= given


def _told(kind: str, now: ConditionContext) -> bool:
    """Whether there was an event of a kind since the step began."""
    for event in reversed(now.events):
        if event.time < now.begun - ROUNDING:
            return False
        if event.kind == kind:
            return True
    return False


KINDS: Final[Mapping[str, Callable[[Any, ConditionContext], bool]]] = {
    "any": lambda given, now: any(holds(one, now) for one in given),
    "all": lambda given, now: all(holds(one, now) for one in given),
    "not": lambda given, now: not holds(given, now),
    "elapsed": lambda given, now: bool(now.time - now.begun >= given - ROUNDING),
    "found": _found,
    "near": _near,
    "battery_below": lambda given, now: any(now.health.battery[row] < given for row in now.rows),
    "event": _told,
}
"""How each kind of condition is judged."""
