"""Installed external planners, and goals from one of them, which runs in this process."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Final

from star_core import ContractError, PluginError
from star_core.toolkit import PluginGuard, permitted_entry_points
from star_external.planner import Answer, Done, ExternalPlanner, Failed, Goal
from star_external.protocol import GOAL_KEYS, checked_goals, quoted, shortened, ticks_between

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from star_core import Estimate, Health, Scene

GROUP: Final = "star.external_planners"
"""Entry points of planners: each names a function that is called with the scene and the rows of a
step's agents and returns a `star_external.planner.ExternalPlanner`."""


@cache
def _installed() -> tuple[EntryPoint, ...]:
    return tuple(permitted_entry_points(GROUP))


def planner_names() -> tuple[str, ...]:
    """Return the names of all planners."""
    return tuple(dict.fromkeys(point.name for point in _installed()))


def find_planner(name: str) -> EntryPoint:
    """Return the entry point of a planner.

    Raises:
        PluginError: There is none of that name, or there are two.
    """
    found = [point for point in _installed() if point.name == name]
    if not found:
        installed = ", ".join(planner_names()) or f"none (planners are entry points of {GROUP!r})"
        message = f"no external planner named {name!r}; installed: {installed}"
        raise PluginError(message, code="unknown-plugin")
    if len(found) > 1:
        values = " and ".join(point.value for point in found)
        message = f"two external planners are named {name!r}: {values}; uninstall one"
        raise PluginError(message, code="duplicate-plugin")
    return found[0]


class PlannerSource:
    """Calls a planner in every tick or at a rate, and attributes its failures to it.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents that the planner is created for.
        point: Entry point of the planner.
        rate: Calls per second, 1/s; None for every tick.

    Raises:
        PluginError: The planner cannot be created; in flight: it raised an exception, or its
            answer violates the contract. The message names the planner.
    """

    def __init__(
        self, scene: Scene, rows: tuple[int, ...], point: EntryPoint, rate: float | None = None
    ) -> None:
        self._scene = scene
        dist = point.dist
        origin = f"{dist.name} {dist.version}: {point.value}" if dist else point.value
        self._guard = PluginGuard(f"external planner {point.name!r} ({origin})")
        self._every = ticks_between(rate, scene.period)
        self._ticks = 0
        self.messages: list[str] = []
        with self._guard:
            self._planner = point.load()(scene, rows)
            if not isinstance(self._planner, ExternalPlanner):
                made = type(self._planner).__name__
                raise ContractError(f"made {made}, expected plan(estimate, health, rows)")

    def poll(
        self, estimate: Estimate, health: Health, agents: Mapping[str, int]
    ) -> Iterator[Answer]:
        due = self._ticks % self._every == 0
        self._ticks += 1
        if due:
            with self._guard:
                answer = self._planner.plan(estimate, health, tuple(agents.values()))
                answer = self._checked(answer, agents)
            yield answer

    def close(self) -> None:
        with self._guard:
            getattr(self._planner, "close", lambda: None)()

    def _checked(self, answer: object, agents: Mapping[str, int]) -> Answer:
        """Return the planner's answer, validated."""
        match answer:
            case Done():
                return answer
            case Failed(str(why)):
                return Failed(f"{self._guard.plugin} gave up: {shortened(why)}")
            case Mapping():
                given = {name: _fields(name, goal) for name, goal in answer.items()}
                return checked_goals(given, self._scene, agents)
        raise ContractError(
            f"plan() returned {quoted(answer)}, expected goals by agent, Done() or Failed(why)"
        )


def _fields(name: str, goal: object) -> dict[str, object]:
    """Return the fields of a goal in the form that another process would send."""
    if not isinstance(goal, Goal):
        raise ContractError(f"{name}: the goal is {quoted(goal)}, expected a Goal")
    return {key: value for key in GOAL_KEYS if (value := getattr(goal, key)) is not None}
