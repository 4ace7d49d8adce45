"""What the plugins' own functions find wrong with a mission, and goals that no agent can reach."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from numbers import Real
from typing import Any, Final, TypeAlias

from star_core import PluginError, Problem, Registry, Scene, TaskSpec
from star_core.commands import Found
from star_core.toolkit import Action, StepGoal
from star_yaml.checks.feasibility import position_code
from star_yaml.document import Location

LISTED: Final = 3
"""How many of the other goals that are refused for the same value a message lists."""

_Answer: TypeAlias = tuple[list[Any], list[Problem]]
"""What a function of an offer yields, and what is wrong with the function itself."""


class PluginChecks:
    """Calls the functions with which plugins check a mission; once for equal steps.

    Args:
        registry: Registry of the plugins.
        scene: What they are asked about.
        planner: The mission's planner and its options: ``{use: name, ...}``, with defaults.
        enabled: Whether to call any: they may depend on everything in the scene.
    """

    def __init__(
        self, registry: Registry, scene: Scene, planner: Mapping[str, Any], *, enabled: bool = True
    ) -> None:
        self.enabled = enabled
        self._registry = registry
        self._scene = scene
        self._planner = planner["use"]
        self._planner_options = options_of(planner)
        self._problems: dict[str, list[Problem]] = {}

    def problems(
        self,
        kind: str,
        name: str,
        path: Location,
        options: Mapping[str, Any],
        *rows: tuple[int, ...],
    ) -> Iterator[Problem]:
        """Yield what is wrong with the options at `path`; a task's check is given its rows."""
        if not self.enabled:
            return
        request = repr((kind, name, rows, options))
        if request not in self._problems:
            problems, wrong = self._call(
                kind, name, "check", (self._scene, *rows), options, _is_problem, "Problem"
            )
            if kind == "task" and not problems and not wrong:
                problems, wrong = self._goal_problems(name, options, *rows)
            self._problems[request] = [*problems, *wrong]
        for problem in self._problems[request]:
            yield problem._replace(path=(*path, *problem.path))

    def exclusive_resource(self, step: Action) -> tuple[tuple[str, Any], ...]:
        """Return the exclusive resource that a step holds."""
        return held(self._registry.find("task", step.verb).offer, step.written)

    def _goal_problems(
        self, verb: str, options: Mapping[str, Any], rows: tuple[int, ...]
    ) -> _Answer:
        """Return goals of a step where no agent can be, or that the planner refuses.

        Of the goals that follow from one value the first is reported, with the labels of the
        others.
        """
        goals, wrong = self._call(
            "task", verb, "goals", (self._scene, rows), options, _is_goal, "StepGoal at [x, y, z]"
        )
        if wrong or not goals:
            return [], wrong
        world = self._scene.world
        faults = {
            i: (fault, position_code(self._scene, goal.position))
            for i, goal in enumerate(goals)
            if (fault := world.fault(goal.position))
        }
        free = [i for i in range(len(goals)) if i not in faults]
        refused, wrong = self._refused([goals[i].position for i in free])
        for refusal in refused:
            index = free[int(refusal.path[0])]
            x, y, z = goals[index].position
            message = f"goal [{x:g}, {y:g}, {z:g}] {refusal.message}"
            faults[index] = message, "unreachable-goal"
        by_path: dict[Location, dict[str, tuple[str, str]]] = {}  # by path, the first of each label
        for index in sorted(faults):
            by_path.setdefault(goals[index].path, {}).setdefault(goals[index].label, faults[index])
        return [_first(path, by_label) for path, by_label in by_path.items()], wrong

    def _refused(self, goals: list[tuple[float, float, float]]) -> _Answer:
        """Return which goals the planner refuses, by their indices."""
        if self._planner not in self._registry.names("planner"):
            return [], []  # that is reported of the planner
        indices = {(i,) for i in range(len(goals))}
        return self._call(
            "planner",
            self._planner,
            "check_goals",
            (self._scene, goals),
            self._planner_options,
            lambda answer: _is_problem(answer) and answer.path in indices,
            "Problem with the index of a goal",
        )

    def _call(
        self,
        kind: str,
        name: str,
        function: str,
        arguments: tuple[Any, ...],
        options: Mapping[str, Any],
        sound: Callable[[Any], bool],
        expected: str,
    ) -> _Answer:
        """Return what a function of an offer yields, and what is wrong with the function itself.

        Args:
            kind: Of the plugin.
            name: Of the plugin.
            function: Field of the offer that holds the function; it may be None.
            arguments: What it is called with.
            options: Keyword arguments, with defaults.
            sound: Whether a value is what it should yield.
            expected: What that is, in words.
        """
        try:
            plugin = self._registry.find(kind, name)
        except PluginError as error:
            return [], [Problem((), error.message, error.code)]
        call = getattr(plugin.offer, function)
        if call is None:
            return [], []
        try:
            answer = list(call(*arguments, **options))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 -- whatever it may raise
            return [], [_broken(plugin, kind, function, f"raised {error!r}", "plugin-failed")]
        return [value for value in answer if sound(value)], [
            _broken(plugin, kind, function, f"yields {value!r}, expected {expected}")
            for value in answer
            if not sound(value)
        ]


def options_of(choice: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of the choice of a plugin, ``{use: name, ...options}``."""
    return {key: value for key, value in choice.items() if key != "use"}


def _broken(
    plugin: Found, kind: str, function: str, what: str, code: str = "contract-broken"
) -> Problem:
    text = f"the {function} of {kind} {plugin.offer.name!r} ({plugin.source}) {what}"
    return Problem((), text, code)


def _is_problem(value: Any) -> bool:
    return isinstance(value, Problem)


def _is_goal(value: Any) -> bool:
    if not isinstance(value, StepGoal):
        return False
    position: Any = value.position
    try:
        x, y, z = position
    except (TypeError, ValueError):
        return False
    return all(isinstance(number, Real) for number in (x, y, z))


def _first(path: Location, faults: Mapping[str, tuple[str, str]]) -> Problem:
    """Return the first of some faults by label, with up to `LISTED` labels of the others."""
    (label, (text, code)), *others = faults.items()
    also = [other for other, _ in others[:LISTED]] + ["…"] * (len(others) > LISTED)
    named = f"{label}: {text}".removeprefix(": ")
    return Problem(path, named + (f" (also {', '.join(also)})" if also else ""), code)


def held(offer: TaskSpec, options: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    """Return the options that identify the resource that a step holds, with their values."""
    exclusive = offer.exclusive
    if exclusive is None or exclusive.unless in options:
        return ()
    properties = offer.options.get("properties", {})
    return tuple(
        (name, options.get(name, properties[name].get("default"))) for name in exclusive.options
    )
