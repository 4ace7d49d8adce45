"""What a schema cannot see: names that mean nothing, places nobody can be at."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from star_core.contracts import Problem
from star_core.errors import suggestion
from star_core.mission_file import conditions
from star_core.mission_file.checks import feasibility as room
from star_core.mission_file.checks.feasibility import Fault, Path
from star_core.mission_file.checks.plugin_checks import PluginChecks
from star_core.mission_file.located import Document
from star_core.mission_file.sound_parts import UNKNOWN, Incomplete
from star_core.mission_file.step_tree import begun, within
from star_core.plugin_schema import JOIN, PARTS, SHARED
from star_core.registry import Registry
from star_core.scene import Scene
from star_core.world.camera import camera_faults


def of_mission(
    document: Document,
    data: Mapping[str, Any],
    scene: Scene,
    registry: Registry,
    *,
    world_known: bool = True,
) -> list[str]:
    """Every reason why a mission cannot be flown that its schema cannot see, located.

    Args:
        document: The mission.
        data: Its content, without what its schema refuses.
        scene: What it describes.
        registry: Where plugins are found.
        world_known: Whether the scene's world is that of the mission; where it is not, the plugins'
            own checks are left out.
    """
    groups = agents_by_name(scene)
    wrong = [*room.faults(data, scene, registry)]
    if wrong:
        scene = room.boundless(scene)
    planner, options = _chosen(data["planner"])
    if isinstance(data["planner"], Incomplete):
        planner = UNKNOWN
    plugins = PluginChecks(registry, scene, planner, options, enabled=world_known)
    faults = [
        *wrong,
        *_groups(data, scene),
        *room.reserve_faults(data, scene),
        *_idle(data, groups, scene),
        *room.safety_faults(data, scene, registry),
        *_cameras(data),
        *room.start_faults(data, scene, registry),
        *_parts(data, plugins),
        *_steps(data["mission"], ("mission",), groups, scene, plugins),
    ]
    return document.located(Problem(*one) for one in faults)


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
    if any(isinstance(step, Incomplete) for step in _given(data["mission"])):
        return  # it may be a `join`
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


def _given(steps: Iterable[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Yield the options of every step, those in an ``each`` included."""
    for step, _ in within(steps, ()):
        for verb, given in step.items():
            yield given
            if verb == "each":
                yield from _given(given["steps"])


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
    unknown = isinstance(data.get("cameras"), Incomplete)
    for name, given in data["swarm"].items():
        if "camera" in given and given["camera"] not in known and not unknown:
            yield ("swarm", name, "camera"), _unknown("camera", given["camera"], known)
    for name, given in data.get("cameras", {}).items():
        if isinstance(given, Incomplete):
            continue
        yield from ((("cameras", name, *path), fault) for path, fault in camera_faults(given))


def _parts(data: Mapping[str, Any], plugins: PluginChecks) -> Iterator[Fault]:
    for kind in PARTS:
        name, options = _chosen(data[kind])
        if isinstance(data[kind], Incomplete):
            continue
        if kind == "transport" and any(isinstance(a, Incomplete) for a in data["swarm"].values()):
            continue  # it may need what is missing: addresses
        yield from plugins.faults(kind, name, (kind,), options)


def _chosen(given: str | Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """Return the name and the options of a plugin that a mission chooses with ``use``."""
    if isinstance(given, str):
        return given, {}
    return given["use"], {key: value for key, value in given.items() if key != "use"}


def _steps(
    steps: Iterable[Mapping[str, Any]],
    path: Path,
    groups: Mapping[str, tuple[int, ...]],
    scene: Scene,
    plugins: PluginChecks,
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
    plugins: PluginChecks,
) -> Iterator[Fault]:
    """What is wrong with steps that every agent does by itself: they name nobody."""
    yield from _nobody(given, path, groups)
    inner = [*within(given["steps"], (*path, "steps"))]
    for step, place in inner:
        ((verb, options),) = step.items()
        if options.get("agents"):
            yield (
                (*place, verb, "agents"),
                "a step of 'each' is for every agent by itself; name the agents in 'each'",
            )
    if not any(next(iter(step.values())).get("agents") for step, _ in inner):
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
    plugins: PluginChecks,
) -> Iterator[Fault]:
    unknown = list(_nobody(given, path, groups))
    yield from unknown
    rows = rows_of(given.get("agents", "all"), groups)
    if verb == JOIN and "agents" not in given and "each" not in path:
        yield path, f"{verb}: missing option 'agents'"
    if "until" in given:
        for place, message in conditions.step_faults(given, scene, rows):
            if plugins.enabled or place[-1:] != ("found",):
                yield (*path, "until", *place), message
    if not unknown and not isinstance(given, Incomplete):
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
    step: Mapping[str, Any],
    path: Path,
    groups: Mapping[str, tuple[int, ...]],
    plugins: PluginChecks,
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
    return f"no {what} named {name!r}{meant or suggestion(name, known, 'there are')}"
