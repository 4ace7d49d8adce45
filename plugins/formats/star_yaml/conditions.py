"""Conditions in mission files: parsed, and checked for mistakes that a schema cannot detect."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

from star_core import Problem, Scene
from star_core.formats import Condition, Point
from star_yaml.condition_kinds import (
    AllOf,
    AnyOf,
    BatteryBelow,
    Elapsed,
    Happened,
    NamedAgents,
    Near,
    Not,
    TargetFound,
    TimeReached,
)
from star_yaml.document import Location, unknown_name

OF_AGENTS: Final[Mapping[str, Callable[[Any, NamedAgents | None], Condition]]] = {
    "found": TargetFound,
    "battery_below": BatteryBelow,
    "event": Happened,
}
OF_TIME: Final[Mapping[str, Callable[[Any], Condition]]] = {
    "elapsed": Elapsed,
    "time": TimeReached,
}


def parse(written: Mapping[str, Any], members: Mapping[str, Sequence[str]] = {}) -> Condition:
    """Return the condition that a map of the mission schema's ``condition`` describes.

    Args:
        written: The map.
        members: Names of the agents of each group.

    >>> str(parse({"any": [{"found": 2}, {"not": {"elapsed": 30}}]}))
    '(2 targets are found or not 30 s have passed)'
    """
    ((kind, value),) = ((key, value) for key, value in written.items() if key != "agents")
    match kind:
        case "any":
            return AnyOf(tuple(parse(inner, members) for inner in value))
        case "all":
            return AllOf(tuple(parse(inner, members) for inner in value))
        case "not":
            return Not(parse(value, members))
    if kind in OF_TIME:
        return OF_TIME[kind](value)
    agents = None
    if "agents" in written:
        agents = _agents(written["agents"], members, every=kind == "near")
    if kind == "near":
        point = tuple(value["point"]) if "point" in value else None
        return Near(value["within"], point, value.get("agent"), agents)
    return OF_AGENTS[kind](value, agents)


def _agents(
    written: str | Sequence[str] | Mapping[str, Any],
    members: Mapping[str, Sequence[str]],
    *,
    every: bool,
) -> NamedAgents:
    """Return the agents of a condition; `every` if it is about each of them by default."""
    if isinstance(written, Mapping):
        ((quantity, written),) = written.items()
        every = quantity == "all"
    names = [written] if isinstance(written, str) else written
    agents = dict.fromkeys(agent for name in names for agent in members.get(name, (name,)))
    return NamedAgents(tuple(agents), every)


def needs_find(condition: Condition) -> bool:
    """Return whether a condition cannot hold as long as no target is found.

    >>> needs_find(AllOf((TargetFound(1), Elapsed(3)))), needs_find(Not(TargetFound(1)))
    (True, False)
    """
    match condition:
        case AnyOf(conditions):
            return all(map(needs_find, conditions))
        case AllOf(conditions):
            return any(map(needs_find, conditions))
        case Happened("found"):
            return True
    return isinstance(condition, TargetFound)


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
    if (least := until.holds_from(0.0)) > limit:
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
    parts: list[tuple[Location, Condition]] = []
    yield from _unknown_agents(getattr(condition, "agents", None), agents)
    match condition:
        case AnyOf(conditions):
            parts = [(("any", i), inner) for i, inner in enumerate(conditions)]
        case AllOf(conditions):
            parts = [(("all", i), inner) for i, inner in enumerate(conditions)]
        case Not(inner):
            parts = [(("not",), inner)]
        case TargetFound(str() as name) if name not in targets:
            yield unknown_name(("found",), "target", name, targets, "unknown-target")
        case TargetFound(int() as count) if count > len(targets):
            message = f"{count!r} is more than the {len(targets)} targets of the world"
            yield Problem(("found",), message, "out-of-range")
        case Near():
            yield from _near_problems(condition, agents, of_step, outside)
    for path, inner in parts:
        for problem in problems(inner, agents, targets, of_step, outside):
            yield problem._replace(path=(*path, *problem.path))


def _unknown_agents(named: NamedAgents | None, agents: Sequence[str]) -> Iterator[Problem]:
    for name in () if named is None else named.names:
        if name not in agents:
            yield unknown_name(("agents",), "agent or group", name, agents, "unknown-agent")


def _near_problems(
    near: Near, agents: Sequence[str], of_step: Sequence[str], outside: Callable[[Point], float]
) -> Iterator[Problem]:
    if (near.agent is None) == (near.point is None):
        yield Problem(("near",), "needs either 'point' or 'agent'", "option-conflict")
    elif near.agent is not None and near.agent not in agents:
        yield unknown_name(("near", "agent"), "agent", near.agent, agents, "unknown-agent")
    elif [*(of_step if near.agents is None else near.agents.names)] == [near.agent]:
        message = f"{near.agent!r} is always near itself; name another agent"
        yield Problem(("near", "agent"), message, "agent-conflict")
    elif near.point is not None:
        x, y, z = near.point
        distance = outside((float(x), float(y), float(z)))
        if distance > near.within:
            yield Problem(
                ("near", "point"),
                f"{[*near.point]!r} is {distance:.2f} m outside the fence; no agent comes within "
                f"{near.within:g} m",
                "outside-geofence",
            )
