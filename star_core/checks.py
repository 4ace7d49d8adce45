"""What a schema cannot see: names that mean nothing, places nobody can be at."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from star_core import conditions, room
from star_core.camera import camera_faults
from star_core.contracts import Problem
from star_core.document import PARTS, Document
from star_core.errors import PluginError, instead
from star_core.options import JOIN, SHARED, held
from star_core.registry import Registry
from star_core.room import Fault, Path
from star_core.scene import Scene
from star_core.steps import begun, within


def of_mission(document: Document, scene: Scene, registry: Registry) -> list[str]:
    """Every reason why a mission that fits its schema cannot be flown, located."""
    groups = agents_by_name(scene)
    wrong = [*room.faults(document.data, scene, registry)]
    if wrong:
        scene = room.boundless(scene)
    plugins = _Plugins(registry, scene)
    faults = [
        *wrong,
        *_groups(document.data, scene),
        *room.reserve_faults(document.data, scene),
        *_idle(document.data, groups, scene),
        *room.safety_faults(document.data, scene, registry),
        *_cameras(document.data),
        *room.start_faults(document.data, scene, registry),
        *_parts(document.data, plugins),
        *_steps(document.data["mission"], ("mission",), groups, scene, plugins),
    ]
    return document.told(faults)


def agents_by_name(scene: Scene) -> dict[str, tuple[int, ...]]:
    """The rows that each name stands for: an agent, a group, or ``all``."""
    row = {name: i for i, name in enumerate(scene.names)}
    agents = {name: (i,) for name, i in row.items()}
    return {**scene.groups, **agents, "all": tuple(row.values())}


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


def _idle(
    data: Mapping[str, Any], groups: Mapping[str, tuple[int, ...]], scene: Scene
) -> Iterator[Fault]:
    """Steps for nobody but agents that stay in reserve: nothing would come of them."""
    steps = [
        ((*place, verb), rows_of(given.get("agents", "all"), groups))
        for step, place in within(data["mission"], ("mission",))
        for verb, given in step.items()
    ]
    if len(data.get("reserve", {}).get("agents", [])) == len(scene.agents):
        return  # that is told of the reserve
    joined = {row for path, rows in steps if path[-1] == JOIN for row in rows}
    joined |= _joined_in_each(data["mission"], groups)
    rest = set(rows_of(data.get("reserve", {}).get("agents", []), groups)) - joined
    for path, rows in steps:
        if rows and rest.issuperset(rows):
            is_are = "is" if len(rows) == 1 else "are"
            yield (
                (*path, "agents"),
                f"{scene.named(rows)} {is_are} in reserve, which is in no step before a 'join'",
            )


def _joined_in_each(
    steps: Iterable[Mapping[str, Any]], groups: Mapping[str, tuple[int, ...]]
) -> set[int]:
    """The rows of those whom the steps of an ``each`` bring into the mission."""
    given = [step["each"] for step, _ in within(steps, ()) if "each" in step]
    return {
        row
        for each in given
        if any(JOIN in step for step, _ in within(each["steps"], ()))
        for row in rows_of(each.get("agents", "all"), groups)
    }


def _cameras(data: Mapping[str, Any]) -> Iterator[Fault]:
    known = dict.fromkeys([*data.get("cameras", {}), "aideck"])
    for name, given in data["swarm"].items():
        if "camera" in given and given["camera"] not in known:
            yield ("swarm", name, "camera"), _unknown("camera", given["camera"], known)
    for name, given in data.get("cameras", {}).items():
        yield from ((("cameras", name, *path), fault) for path, fault in camera_faults(given))


def _parts(data: Mapping[str, Any], plugins: _Plugins) -> Iterator[Fault]:
    for kind in PARTS:
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

    def held(self, verb: str, options: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
        """Return what a step of this verb takes hold of outside of STAR."""
        try:
            return held(self._registry.find("task", verb).offer, options)
        except PluginError:
            return ()

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
            problems = list(found.offer.check(*arguments, **options))
        except (Exception, SystemExit) as error:  # noqa: BLE001 -- whatever a check may raise
            yield (), f"the check of {kind} {name!r} ({found.source}) raised {error!r}"
            return
        for problem in problems:
            if isinstance(problem, Problem):
                yield problem.path, problem.message
            else:
                what = f"yields {problem!r}, expected Problem"
                yield (), f"the check of {kind} {name!r} ({found.source}) {what}"


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
            yield from _held_twice(step, (*path, i), groups, plugins)
        elif verb == "repeat":
            yield from _steps(given["steps"], (*here, "steps"), groups, scene, plugins)
        elif verb == "each":
            yield from _each(given, here, groups, scene, plugins)
            yield from _held_twice(step, (*path, i), groups, plugins)
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
    inner = [*within(given["steps"], (*path, "steps"))]
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


def _nobody(
    given: Mapping[str, Any], path: Path, groups: Mapping[str, tuple[int, ...]]
) -> Iterator[Fault]:
    """Names in a step's ``agents`` that mean nobody."""
    asked = given.get("agents", "all")
    for i, name in enumerate([asked] if isinstance(asked, str) else asked):
        if name not in groups:
            place = ("agents",) if isinstance(asked, str) else ("agents", i)
            several = re.split(r"[,\s]+", name.strip())
            listed = f"; write a list: agents: [{', '.join(several)}]"
            meant = listed if len(several) > 1 and groups.keys() >= {*several} else None
            yield (*path, *place), _unknown("agent or group", name, groups, meant)


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
    if verb == JOIN and "agents" not in given and "each" not in path:
        yield path, f"{verb}: missing option 'agents'"
    if "until" in given:
        for place, message in conditions.step_faults(given, scene, rows):
            yield (*path, "until", *place), message
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


def _held_twice(
    step: Mapping[str, Any], path: Path, groups: Mapping[str, tuple[int, ...]], plugins: _Plugins
) -> Iterator[Fault]:
    """Steps that begin at once and take hold of one thing outside of STAR, as of a port."""
    taken = set()
    for place, verb, given in begun(step, path, lambda given: rows_of(given, groups)):
        held = plugins.held(verb, given)
        if held and (verb, held) in taken:
            what = ", ".join(f"{name} {value}" for name, value in held)
            yield (
                (*place, *[name for name, _ in held[-1:] if name in given]),
                f"{verb}: another step that begins at the same time holds {what}; "
                f"give each its own {held[-1][0]!r}",
            )
        taken.add((verb, held))


def _rows_in(step: Mapping[str, Any], groups: Mapping[str, tuple[int, ...]]) -> set[int]:
    ((verb, given),) = step.items()
    if verb == "parallel":
        return set().union(*(_rows_in(inner, groups) for inner in given))
    if verb == "repeat":  # `each` names its agents as an action does
        return set().union(*(_rows_in(inner, groups) for inner in given["steps"]))
    return set(rows_of(given.get("agents", "all"), groups))


def _unknown(what: str, name: str, known: Iterable[str], meant: str | None = None) -> str:
    return f"no {what} named {name!r}{meant or instead(name, known, 'there are')}"
