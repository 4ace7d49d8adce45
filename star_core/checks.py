"""What a schema cannot see: names that mean nothing, places nobody can be at."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations
from typing import Any, Final, TypeAlias

from star_core import conditions
from star_core.contracts import Problem
from star_core.document import Document
from star_core.errors import PluginError, instead
from star_core.options import SHARED
from star_core.registry import Registry
from star_core.scene import Scene

CONTACT_RADIUS: Final = 0.06
"""Half a Crazyflie's span with propellers, m: two drones nearer than twice this collide."""

Path: TypeAlias = tuple[str | int, ...]
Fault: TypeAlias = tuple[Path, str]


def of_mission(document: Document, scene: Scene, registry: Registry) -> list[str]:
    """Every reason why a mission that fits its schema cannot be flown, located."""
    groups = agents_by_name(document.data, scene)
    faults = [
        *_groups(document.data, scene),
        *_reserve(document.data, scene),
        *_limits(document.data),
        *_cameras(document.data),
        *_starts(document.data, scene, registry),
        *_parts(document.data, scene, registry),
        *_steps(document.data["mission"], ("mission",), groups, scene, registry),
    ]
    return document.told(faults)


def agents_by_name(data: Mapping[str, Any], scene: Scene) -> dict[str, tuple[int, ...]]:
    """The rows that each name stands for: an agent, a group, or ``all``."""
    row = {name: i for i, name in enumerate(scene.names)}
    groups = {
        name: tuple(dict.fromkeys(row[member] for member in members if member in row))
        for name, members in data.get("groups", {}).items()
    }
    return groups | {name: (i,) for name, i in row.items()} | {"all": tuple(row.values())}


def rows_of(given: str | list[str], groups: Mapping[str, tuple[int, ...]]) -> tuple[int, ...]:
    """The rows of a step's ``agents``, each once, in the order of the swarm."""
    names = [given] if isinstance(given, str) else given
    return tuple(sorted({row for name in names for row in groups.get(name, ())}))


def _groups(data: Mapping[str, Any], scene: Scene) -> Iterator[Fault]:
    for name, members in data.get("groups", {}).items():
        if name in scene.names or name == "all":
            whom = "everybody" if name == "all" else "an agent"
            yield ("groups", name), f"{name!r} already names {whom}"
        for i, member in enumerate(members):
            if member not in scene.names:
                yield ("groups", name, i), _unknown("agent", member, scene.names)


def _reserve(data: Mapping[str, Any], scene: Scene) -> Iterator[Fault]:
    reserve = data.get("reserve", {})
    for i, name in enumerate(reserve.get("agents", ())):
        if name not in scene.names:
            yield ("reserve", "agents", i), _unknown("agent", name, scene.names)
    if set(scene.names) <= set(reserve.get("agents", ())):
        yield ("reserve", "agents"), "every agent is in reserve; leave one to be relieved"
    low, high = scene.limits.height
    height = reserve.get("height", 0.8)  # the schema's default
    if reserve and not low <= height <= high:
        yield (
            ("reserve", "height"),
            f"{height:g} m is outside the heights to fly at, from {low:g} to {high:g} m",
        )


def _cameras(data: Mapping[str, Any]) -> Iterator[Fault]:
    known = [*data.get("cameras", {}), "aideck"]
    for name, given in data["swarm"].items():
        if "camera" in given and given["camera"] not in known:
            yield ("swarm", name, "camera"), _unknown("camera", given["camera"], known)


def _limits(data: Mapping[str, Any]) -> Iterator[Fault]:
    low, high = data.get("limits", {}).get("height", (0, 1))
    if low >= high:
        yield ("limits", "height"), f"lowest {low!r} is not below highest {high!r}"


def _starts(data: Mapping[str, Any], scene: Scene, registry: Registry) -> Iterator[Fault]:
    for agent in scene.agents:
        if fault := scene.world.fault(agent.start):
            yield ("swarm", agent.name, "start"), f"start {fault}"
    apart = 2 * _radius(data["avoider"], registry)
    for first, second in combinations(scene.agents, 2):
        distance = math.dist(first.start, second.start)
        if distance < apart:
            yield (
                ("swarm", second.name, "start"),
                f"{second.name!r} starts {distance:.2f} m from {first.name!r}, "
                f"expected at least two radii: {apart:.2f} m",
            )


def _radius(given: str | Mapping[str, Any], registry: Registry) -> float:
    """The radius that the avoider keeps free around an agent: its option of that name, if any."""
    use, options = (given, {}) if isinstance(given, str) else (given["use"], given)
    try:
        known = registry.find("avoider", use).offer.options.get("properties", {})
    except PluginError:
        known = {}
    return float(options.get("radius", known.get("radius", {}).get("default", CONTACT_RADIUS)))


def _parts(data: Mapping[str, Any], scene: Scene, registry: Registry) -> Iterator[Fault]:
    for kind in ("transport", "localizer", "planner", "avoider"):
        given = data[kind]
        options = {} if isinstance(given, str) else {k: v for k, v in given.items() if k != "use"}
        yield from _own(kind, given if isinstance(given, str) else given["use"], registry, (kind,),
                        (scene,), options)  # fmt: skip


def _own(
    kind: str,
    name: str,
    registry: Registry,
    path: Path,
    arguments: tuple[Any, ...],
    options: Mapping[str, Any],
) -> Iterator[Fault]:
    """What a plugin's own check finds; a check that raises is told as a problem of the plugin."""
    try:
        found = registry.find(kind, name)
    except PluginError as error:
        yield path, str(error)
        return
    if found.offer.check is None:
        return
    try:
        problems: list[Problem] = list(found.offer.check(*arguments, **options))
    except (Exception, SystemExit) as error:  # noqa: BLE001 -- whatever a check may raise
        yield path, f"the check of {kind} {name!r} ({found.source}) raised {error!r}"
        return
    for problem in problems:
        yield (*path, *problem.path), problem.message


def _steps(
    steps: Iterable[Mapping[str, Any]],
    path: Path,
    groups: Mapping[str, tuple[int, ...]],
    scene: Scene,
    registry: Registry,
) -> Iterator[Fault]:
    for i, step in enumerate(steps):
        ((verb, given),) = step.items()
        here = (*path, i, verb)
        if verb == "parallel":
            yield from _steps(given, here, groups, scene, registry)
            yield from _shared(given, here, groups, scene)
        elif verb == "repeat":
            yield from _steps(given["steps"], (*here, "steps"), groups, scene, registry)
        elif verb == "each":
            yield from _each(given, here, groups, scene, registry)
        else:
            yield from _action(verb, given, here, groups, scene, registry)


def _each(
    given: Mapping[str, Any],
    path: Path,
    groups: Mapping[str, tuple[int, ...]],
    scene: Scene,
    registry: Registry,
) -> Iterator[Fault]:
    """What is wrong with steps that every agent does by itself: they name nobody."""
    yield from _nobody(given, path, groups)
    inner = [*_within(given["steps"], (*path, "steps"))]
    for step, place in inner:
        ((verb, options),) = step.items()
        if "agents" in options:
            yield (
                (*place, verb, "agents"),
                "a step of 'each' is for every agent by itself; name the agents in 'each'",
            )
    if not any("agents" in next(iter(step.values())) for step, _ in inner):
        for row in rows_of(given.get("agents", "all"), groups)[:1]:  # what is wrong is so for all
            yield from _steps(given["steps"], (*path, "steps"), {"all": (row,)}, scene, registry)


def _within(
    steps: Iterable[Mapping[str, Any]], path: Path
) -> Iterator[tuple[Mapping[str, Any], Path]]:
    """Every step with a verb of its own in some steps, and every ``each``, with its place."""
    for i, step in enumerate(steps):
        ((verb, given),) = step.items()
        if verb == "parallel":
            yield from _within(given, (*path, i, verb))
        elif verb == "repeat":
            yield from _within(given["steps"], (*path, i, verb, "steps"))
        else:
            yield step, (*path, i)


def _nobody(
    given: Mapping[str, Any], path: Path, groups: Mapping[str, tuple[int, ...]]
) -> Iterator[Fault]:
    """Names in a step's ``agents`` that mean nobody."""
    asked = given.get("agents", "all")
    for i, name in enumerate([asked] if isinstance(asked, str) else asked):
        if name not in groups:
            place = ("agents",) if isinstance(asked, str) else ("agents", i)
            yield (*path, *place), _unknown("agent or group", name, groups)


def _until(given: Mapping[str, Any], path: Path, scene: Scene) -> Iterator[Fault]:
    """What is wrong with a step's condition that its schema cannot see."""
    targets = tuple(dict.fromkeys(tag.of for tag in scene.world.targets))
    for place, message in conditions.faults(given, scene.names, targets):
        yield (*path, "until", *place), message


def _action(
    verb: str,
    given: Mapping[str, Any],
    path: Path,
    groups: Mapping[str, tuple[int, ...]],
    scene: Scene,
    registry: Registry,
) -> Iterator[Fault]:
    unknown = list(_nobody(given, path, groups))
    yield from unknown
    if "until" in given:
        yield from _until(given["until"], path, scene)
    if not unknown:
        options = {key: value for key, value in given.items() if key not in SHARED}
        rows = rows_of(given.get("agents", "all"), groups)
        yield from _own("task", verb, registry, path, (scene, rows), options)


def _shared(
    branches: Iterable[Mapping[str, Any]],
    path: Path,
    groups: Mapping[str, tuple[int, ...]],
    scene: Scene,
) -> Iterator[Fault]:
    """Agents that two branches of a ``parallel`` would both move."""
    taken: set[int] = set()
    for i, branch in enumerate(branches):
        rows = _rows_in(branch, groups)
        if twice := sorted(taken & rows):
            verb = next(iter(branch))
            yield (
                (*path, i, verb),
                f"{scene.named(twice)} already moves in another branch of this 'parallel'; "
                "name the agents of each branch",
            )
        taken |= rows


def _rows_in(step: Mapping[str, Any], groups: Mapping[str, tuple[int, ...]]) -> set[int]:
    ((verb, given),) = step.items()
    if verb == "parallel":
        return set().union(*(_rows_in(inner, groups) for inner in given))
    if verb == "repeat":  # `each` names its agents as an action does
        return set().union(*(_rows_in(inner, groups) for inner in given["steps"]))
    return set(rows_of(given.get("agents", "all"), groups))


def _unknown(what: str, name: str, known: Iterable[str]) -> str:
    return f"no {what} named {name!r}{instead(name, known, 'there are')}"
