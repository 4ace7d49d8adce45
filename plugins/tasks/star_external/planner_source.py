"""Goals from an external planner, which runs in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

from star_core import ContractError
from star_core.toolkit import PluginGuard
from star_external.planner import Answer, Done, ExternalPlanner, Failed, Goal
from star_external.protocol import GOAL_KEYS, checked_goals, quoted, shortened, ticks_between

if TYPE_CHECKING:
    from star_core import Estimate, Health, Scene


class PlannerSource:
    """Calls a planner in every tick or at a rate, and attributes its failures to it.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents that the planner is created for.
        make: Creates the planner.
        origin: Its name, distribution and version.
        rate: Calls per second, 1/s; None for every tick.

    Raises:
        PluginError: The planner cannot be created; in flight: it raised an exception, or its
            answer violates the contract. The message names the planner.
    """

    def __init__(
        self,
        scene: Scene,
        rows: tuple[int, ...],
        make: Callable[[Scene, tuple[int, ...]], object],
        origin: str,
        rate: float | None = None,
    ) -> None:
        self._scene = scene
        self._guard = PluginGuard(f"external planner {origin}")
        self._every = ticks_between(rate, scene.period)
        self._ticks = 0
        self.messages: list[str] = []
        with self._guard:
            planner = make(scene, rows)
            if not isinstance(planner, ExternalPlanner):
                made = type(planner).__name__
                raise ContractError(f"made {made}, expected plan(estimate, health, rows)")
        self._planner = planner

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
                goals = {name: _fields(name, goal) for name, goal in answer.items()}
                return checked_goals(goals, self._scene, agents)
        raise ContractError(
            f"plan() returned {quoted(answer)}, expected goals by agent, Done() or Failed(why)"
        )


def _fields(name: str, goal: object) -> dict[str, object]:
    """Return the fields of a goal in the form that another process would send."""
    if not isinstance(goal, Goal):
        raise ContractError(f"{name}: the goal is {quoted(goal)}, expected a Goal")
    return {key: value for key in GOAL_KEYS if (value := getattr(goal, key)) is not None}
