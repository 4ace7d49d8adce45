"""What a schema cannot see: names without a meaning, conflicts between steps.

Such as steps whose agents would have to be on the ground, but are in the air.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, Literal, TypeAlias

from star_core import Problem, Registry, Scene
from star_core.commands import PIPELINE_KINDS
from star_core.formats import JOIN, LEAVE, Condition, nodes
from star_core.toolkit import Action, Choice, Node, Parallel, Reaction, Repeat, actions
from star_yaml import conditions
from star_yaml.checks import feasibility
from star_yaml.checks.cameras import camera_problems
from star_yaml.checks.plugin_checks import PluginChecks, options_of
from star_yaml.document import Document, Location, unknown_name
from star_yaml.schema import Incomplete

State: TypeAlias = Literal["ground", "air", "reserve", "removed"] | None
"""Of one agent; None if not known."""

MAX_GROUND_HEIGHT: Final = 0.05  # m: an agent that starts higher may stand on something, or fly
PHRASES: Final = {"ground": "on the ground", "air": "in the air"}
ROUNDS: Final = 2  # of a repetition: the second begins where the first ends


def of_mission(
    document: Document,
    data: Mapping[str, Any],
    steps: Sequence[Node],
    reactions: Sequence[Reaction],
    scene: Scene,
    registry: Registry,
    *,
    world_known: bool = True,
) -> Iterator[Problem]:
    """Yield every reason why a mission cannot be flown that its schema cannot see.

    Args:
        document: The mission as read.
        data: Its `sound_parts`.
        steps: Its steps.
        reactions: What it has ``on`` conditions.
        scene: What it describes.
        registry: Registry of the plugins.
        world_known: Whether the scene's world is that of the mission; if not, the plugins' own
            checks are skipped.
    """
    room = feasibility.Room(document, data, scene, registry)
    wrong = [*room.limits()]
    yield from wrong
    if wrong:  # look for problems that do not follow from these
        room = room.boundless()
        scene = room.scene
    plugins = PluginChecks(registry, scene, data["planner"], enabled=world_known)
    every = [*steps, *(step for reaction in reactions for step in reaction.steps)]
    distinct = list({step.path: step for step in actions(every) if step.known}.values())
    yield from _groups(data, scene)
    yield from room.reserve()
    yield from _idle(data, steps, scene)
    yield from room.safety(distinct)
    yield from _cameras(document, data)
    yield from room.starts()
    yield from room.separation()
    yield from _parts(data, plugins)
    yield from _frames(data, scene, registry)
    for step in distinct:
        yield from _action(step, scene, plugins)
    for reaction in reactions:
        yield from _condition(reaction.when, (*reaction.at, "when"), scene, plugins)
    for node in nodes(every):
        if isinstance(node, Parallel):
            if not node.each:
                yield from _shared(node, scene)
            yield from _resource_conflicts(node, plugins)
        elif isinstance(node, Choice):
            yield from _condition(node.when, (*node.at, "when"), scene, plugins)
    if (reserve := _reserve_rows(data, scene)) is not None:
        yield from airborne_problems(steps, scene, reserve, registry)
        for reaction in reactions:
            states: list[State] = [None] * len(scene.agents)
            yield from _Walk(scene, states, registry).through(reaction.steps)
        yield from room.climbs(actions(steps), reserve)


def _reserve_rows(data: Mapping[str, Any], scene: Scene) -> list[int] | None:
    """Return the rows of agents that are not in the mission at first; None if not known."""
    names = data["reserve"].get("agents", [])
    if not {*names} <= {*scene.names} or (isinstance(data["reserve"], Incomplete) and not names):
        return None
    return [scene.names.index(name) for name in names]


def _groups(data: Mapping[str, Any], scene: Scene) -> Iterator[Problem]:
    for name, members in data["groups"].items():
        if name in scene.names or name == "all":
            named = "every agent" if name == "all" else "an agent"
            yield Problem(("groups", name), f"{name!r} already names {named}", "duplicate-name")
        for i, member in enumerate(members):
            if member not in scene.names:
                at = ("groups", name, i)
                yield unknown_name(at, "agent", member, scene.names, "unknown-agent")


def _idle(data: Mapping[str, Any], steps: Sequence[Node], scene: Scene) -> Iterator[Problem]:
    """Yield steps for agents that stay in reserve only."""
    reserve = {
        row for row, name in enumerate(scene.names) if name in data["reserve"].get("agents", ())
    }
    listed = list(actions(steps))
    if len(reserve) == len(scene.agents) or not all(step.known for step in listed):
        return  # that is reported of the reserve; an unknown step may be a `join`
    rest = reserve - {row for step in listed if step.verb == JOIN for row in step.rows}
    for node in nodes(steps):
        if "each" in node.at[:-1] or not (isinstance(node, Action) or _is_each(node)):
            continue
        rows = {row for step in actions([node]) for row in step.rows}
        if rows and rows <= rest:
            are = "is" if len(rows) == 1 else "are"
            yield Problem(
                (*node.at, "agents"),
                f"{scene.named(sorted(rows))} {are} in reserve, which is in no step before a "
                "'join'",
                "agent-not-in-mission",
            )


def _is_each(node: Node) -> bool:
    return isinstance(node, Parallel) and node.each


def _cameras(document: Document, data: Mapping[str, Any]) -> Iterator[Problem]:
    inline = document.data.get("cameras", {})
    names = dict.fromkeys([*data["cameras"], "aideck"])
    for name, agent in data["swarm"].items():
        if "camera" in agent and agent["camera"] not in names and isinstance(inline, dict):
            at = ("swarm", name, "camera")
            yield unknown_name(at, "camera", agent["camera"], names, "unknown-camera")
    for name, camera in data["cameras"].items():
        if not isinstance(camera, Incomplete):
            for problem in camera_problems(camera):
                yield problem._replace(path=("cameras", name, *problem.path))


def _parts(data: Mapping[str, Any], plugins: PluginChecks) -> Iterator[Problem]:
    for kind in PIPELINE_KINDS:
        if isinstance(data[kind], Incomplete):
            continue
        if kind == "transport" and any(isinstance(a, Incomplete) for a in data["swarm"].values()):
            continue  # it may need what is missing: addresses
        yield from plugins.problems(kind, data[kind]["use"], (kind,), options_of(data[kind]))


def _frames(data: Mapping[str, Any], scene: Scene, registry: Registry) -> Iterator[Problem]:
    """Yield a localizer that takes reports in the map for odometry."""
    choice = data["localizer"]
    if scene.onboard_system is None or isinstance(choice, Incomplete):
        return
    names = registry.names("localizer")
    able = [name for name in names if registry.find("localizer", name).offer.reports_in_map]
    if choice["use"] in names and choice["use"] not in able:
        text = (
            f"the drones report positions in the map, by {scene.onboard_system!r}, which "
            f"{choice['use']!r} takes for odometry; use {' or '.join(able)}"
        )
        yield Problem(("localizer",), text, "option-conflict")


def _action(step: Action, scene: Scene, plugins: PluginChecks) -> Iterator[Problem]:
    if step.until is not None:
        wrong = conditions.until_problems(step.until, step.timeout, scene, step.rows)
        yield from _within(wrong, (*step.at, "until"), plugins)
    yield from plugins.problems("task", step.verb, step.at, step.options, step.rows)


def _condition(
    when: Condition, path: Location, scene: Scene, plugins: PluginChecks
) -> Iterator[Problem]:
    """Yield what is wrong with a condition that is not one of a step."""
    if when.has_elapsed:
        message = "'elapsed' is the time of a step, and this is about none; write 'time'"
        yield Problem(path, message, "option-conflict")
    wrong = conditions.until_problems(when, None, scene, range(len(scene.agents)))
    yield from _within(wrong, path, plugins)


def _within(wrong: Iterable[Problem], path: Location, plugins: PluginChecks) -> Iterator[Problem]:
    """Yield the problems of the condition at a path; of targets only if the world is known."""
    for problem in wrong:
        if plugins.enabled or problem.path[-1:] != ("found",):
            yield problem._replace(path=(*path, *problem.path))


def _shared(node: Parallel, scene: Scene) -> Iterator[Problem]:
    """Yield agents that two branches of a ``parallel`` would both move."""
    taken: set[int] = set()
    for branch in node.branches:
        rows = {row for step in actions([branch]) for row in step.rows}
        if twice := sorted(taken & rows):
            yield Problem(
                branch.at,
                f"{scene.named(twice)} already moves in another branch of this 'parallel'; "
                "name the agents of each branch",
                "agent-conflict",
            )
        taken |= rows


def _resource_conflicts(node: Parallel, plugins: PluginChecks) -> Iterator[Problem]:
    """Yield steps that begin at once and hold the same exclusive resource, such as a port."""
    taken = set()
    for step in actions([node], first=True):
        resource = plugins.exclusive_resource(step) if step.known else ()
        if resource and (step.verb, resource) in taken:
            what = ", ".join(f"{name} {value}" for name, value in resource)
            yield Problem(
                (*step.at, resource[-1][0]),
                f"{step.verb}: another step that begins at the same time holds {what}; "
                f"give each its own {resource[-1][0]!r}",
                "resource-conflict",
            )
        taken.add((step.verb, resource))


def airborne_problems(
    steps: Sequence[Node], scene: Scene, reserve: Iterable[int], registry: Registry
) -> Iterator[Problem]:
    """Yield steps that cannot succeed because agents are on the ground or in the air.

    After a step that may fail or end early, or a verb that does not announce it, the state of its
    agents is unknown, and nothing is reported until a verb determines it. After a step that is not
    known, this holds for every agent.

    Args:
        steps: Of the mission, in order.
        scene: The mission's scene.
        reserve: Rows of agents that are not in the mission at first.
        registry: Registry of the verbs.
    """
    starts = (agent.start[2] for agent in scene.agents)
    states: list[State] = ["ground" if z < MAX_GROUND_HEIGHT else None for z in starts]
    for row in reserve:
        states[row] = "reserve"
    yield from dict.fromkeys(_Walk(scene, states, registry).through(steps))


class _Walk:
    """A walk through the steps, with the state of every agent."""

    def __init__(self, scene: Scene, states: list[State], registry: Registry) -> None:
        self._scene = scene
        self._states = states
        self._registry = registry

    def through(self, steps: Sequence[Node], *, together: bool = True) -> Iterator[Problem]:
        """Yield what is wrong; `together` unless every agent has steps of its own."""
        for step in steps:
            match step:
                case Action(known=False):
                    self._states[:] = [None] * len(self._states)
                case Action():
                    yield from self._action(step, together=together)
                case Parallel(branches):
                    yield from self.through(branches, together=False)
                case Repeat(times, inner):
                    for _ in range(min(times, ROUNDS)):
                        yield from self.through(inner, together=together)
                case Choice():
                    before = [*self._states]
                    yield from self.through(step.steps, together=together)
                    after, self._states[:] = [*self._states], before
                    yield from self.through(step.otherwise, together=together)
                    pairs = zip(after, self._states, strict=True)
                    self._states[:] = [a if a == b else None for a, b in pairs]

    def _action(self, action: Action, *, together: bool) -> Iterator[Problem]:
        """Yield what is wrong with one step, and update the states of its agents."""
        spec, states = self._registry.find("task", action.verb).offer, self._states
        rows = [row for row in action.rows if states[row] not in {"reserve", "removed"}]
        if action.verb == JOIN:
            rows = list(action.rows)
        elif together and all(states[row] == "removed" for row in action.rows):
            gone = self._scene.named(action.rows)
            message = f"{action.verb} has no agents: {gone} left the mission before"
            yield Problem(action.path, message, "agent-not-in-mission")
        wrong = []
        if spec.before is not None:
            other = "ground" if spec.before == "air" else "air"
            wrong = [row for row in rows if states[row] == other]
            if wrong:
                are = "are" if len(wrong) > 1 else "is"
                message = (
                    f"{action.verb} needs its agents {PHRASES[spec.before]}; "
                    f"{self._scene.named(wrong)} {are} {PHRASES[other]} here"
                )
                yield Problem(action.path, message, "wrong-airborne-state")
        certain = action.on_failure == "abort" and action.until is None
        for row in rows:
            if action.verb == LEAVE:
                states[row] = "removed"
            elif row in wrong:
                states[row] = None  # reported; what follows depends on the correction
            elif certain and spec.after != "same":
                states[row] = spec.after
            elif spec.after not in {spec.before, "same"} or action.on_failure == "land":
                states[row] = None
