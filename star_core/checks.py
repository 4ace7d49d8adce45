"""What a schema cannot see: names that mean nothing, places nobody can be at."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from star_core import conditions, room
from star_core.camera import camera_faults
from star_core.contracts import Problem
from star_core.document import Document
from star_core.errors import PluginError, instead
from star_core.options import JOIN, RESERVE, SHARED
from star_core.registry import Registry
from star_core.room import Fault, Path
from star_core.scene import Scene


def of_mission(document: Document, scene: Scene, registry: Registry) -> list[str]:
    """Every reason why a mission that fits its schema cannot be flown, located."""
    groups = agents_by_name(document.data, scene)
    wrong = [*room.faults(document.data, scene, registry)]
    if wrong:
        scene = room.boundless(scene)
    plugins = _Plugins(registry, scene)
    faults = [
        *wrong,
        *_groups(document.data, scene),
        *_reserve(document.data, scene),
        *_idle(document.data, groups, scene),
        *room.safety_faults(document.data, scene),
        *_cameras(document.data),
        *room.start_faults(document.data, scene, registry),
        *_parts(document.data, plugins),
        *_steps(document.data["mission"], ("mission",), groups, scene, plugins),
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
    filled = {**RESERVE, **reserve}
    if reserve and (fault := scene.height_fault(filled["height"])):
        yield ("reserve", "height"), fault
    tired, ready = filled["relieve_below"], filled["ready_above"]
    if tired >= ready:
        key = "ready_above" if "ready_above" in reserve else "relieve_below"
        yield (
            ("reserve", key),
            f"a reserve that takes off at ready_above, {ready:g} V, would be relieved at once: "
            f"relieve_below is {tired:g} V",
        )


def _idle(
    data: Mapping[str, Any], groups: Mapping[str, tuple[int, ...]], scene: Scene
) -> Iterator[Fault]:
    """Steps for nobody but agents that stay in reserve: nothing would come of them."""
    steps = [
        ((*place, verb), rows_of(given.get("agents", "all"), groups))
        for step, place in _within(data["mission"], ("mission",))
        for verb, given in step.items()
    ]
    if len(data.get("reserve", {}).get("agents", [])) == len(scene.agents):
        return  # that is told of the reserve
    joined = {row for path, rows in steps if path[-1] == JOIN for row in rows}
    rest = set(rows_of(data.get("reserve", {}).get("agents", []), groups)) - joined
    for path, rows in steps:
        if rows and rest.issuperset(rows):
            is_are = "is" if len(rows) == 1 else "are"
            yield (
                (*path, "agents"),
                f"{scene.named(rows)} {is_are} in reserve, which is in no step before a 'join'",
            )


def _cameras(data: Mapping[str, Any]) -> Iterator[Fault]:
    known = [*data.get("cameras", {}), "aideck"]
    for name, given in data["swarm"].items():
        if "camera" in given and given["camera"] not in known:
            yield ("swarm", name, "camera"), _unknown("camera", given["camera"], known)
    for name, given in data.get("cameras", {}).items():
        yield from ((("cameras", name, *path), fault) for path, fault in camera_faults(given))


def _parts(data: Mapping[str, Any], plugins: _Plugins) -> Iterator[Fault]:
    for kind in ("transport", "localizer", "planner", "avoider"):
        given = data[kind]
        options = {} if isinstance(given, str) else {k: v for k, v in given.items() if k != "use"}
        name = given if isinstance(given, str) else given["use"]
        yield from plugins.faults(kind, name, (kind,), options)


class _Plugins:
    """What the plugins' own checks find; each is asked once about steps that are alike."""

    def __init__(self, registry: Registry, scene: Scene) -> None:
        self._registry = registry
        self._scene = scene
        self._found: dict[str, list[Fault]] = {}

    def faults(
        self, kind: str, name: str, path: Path, options: Mapping[str, Any], *rows: tuple[int, ...]
    ) -> Iterator[Fault]:
        """Yield what is wrong with the options at `path`; a task's check is told its rows."""
        asked = repr((kind, name, rows, options))
        if asked not in self._found:
            self._found[asked] = list(self._ask(kind, name, (self._scene, *rows), options))
        for inner, message in self._found[asked]:
            yield (*path, *inner), message

    def _ask(
        self, kind: str, name: str, arguments: tuple[Any, ...], options: Mapping[str, Any]
    ) -> Iterator[Fault]:
        """What one check finds; that it raises is told as a problem of the plugin."""
        try:
            found = self._registry.find(kind, name)
        except PluginError as error:
            yield (), str(error)
            return
        if found.offer.check is None:
            return
        try:
            problems: list[Problem] = list(found.offer.check(*arguments, **options))
        except (Exception, SystemExit) as error:  # noqa: BLE001 -- whatever a check may raise
            yield (), f"the check of {kind} {name!r} ({found.source}) raised {error!r}"
            return
        for problem in problems:
            yield problem.path, problem.message


def _steps(
    steps: Iterable[Mapping[str, Any]],
    path: Path,
    groups: Mapping[str, tuple[int, ...]],
    scene: Scene,
    plugins: _Plugins,
) -> Iterator[Fault]:
    for i, step in enumerate(steps):
        ((verb, given),) = step.items()
        here = (*path, i, verb)
        if verb == "parallel":
            yield from _steps(given, here, groups, scene, plugins)
            yield from _shared(given, here, groups, scene)
        elif verb == "repeat":
            yield from _steps(given["steps"], (*here, "steps"), groups, scene, plugins)
        elif verb == "each":
            yield from _each(given, here, groups, scene, plugins)
        else:
            yield from _action(verb, given, here, groups, scene, plugins)


def _each(
    given: Mapping[str, Any],
    path: Path,
    groups: Mapping[str, tuple[int, ...]],
    scene: Scene,
    plugins: _Plugins,
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
            yield from _steps(given["steps"], (*path, "steps"), {"all": (row,)}, scene, plugins)


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


def _until(
    step: Mapping[str, Any], path: Path, scene: Scene, rows: tuple[int, ...]
) -> Iterator[Fault]:
    """What is wrong with a step's condition that its schema cannot see."""
    given, limit = step["until"], step.get("timeout", math.inf)
    targets = tuple(dict.fromkeys(tag.of for tag in scene.world.targets))
    crew = tuple(scene.names[row] for row in rows)
    outside = scene.world.fence.distance
    for place, message in conditions.faults(given, scene.names, targets, crew, outside):
        yield (*path, "until", *place), message
    if (soonest := conditions.soonest(given)) > limit:
        yield (
            (*path, "until"),
            f"holds after {soonest:g} s, but the step times out after {limit:g} s",
        )


def _action(
    verb: str,
    given: Mapping[str, Any],
    path: Path,
    groups: Mapping[str, tuple[int, ...]],
    scene: Scene,
    plugins: _Plugins,
) -> Iterator[Fault]:
    unknown = list(_nobody(given, path, groups))
    yield from unknown
    rows = rows_of(given.get("agents", "all"), groups)
    if "until" in given:
        yield from _until(given, path, scene, rows)
    if not unknown:
        options = {key: value for key, value in given.items() if key not in SHARED}
        yield from plugins.faults("task", verb, path, options, rows)


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
