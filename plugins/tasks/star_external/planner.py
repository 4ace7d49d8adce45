"""Interface of external planners, which set goals for their agents in every tick.

They run in this process; plugins offer them by the hook ``star_external_planners``. The messages of
another process are equivalent. Does not import numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias, runtime_checkable

from star_core.toolkit import Spec

if TYPE_CHECKING:
    from star_core import Estimate, Health, Scene

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Goal:
    """Goal of one agent.

    Attributes:
        position: In the map, m.
        velocity: Of the goal, m/s; feed-forward only, it does not move the goal.
        yaw: rad; None keeps the current one.
        speed: Maximum on the way, m/s; None for the mission's limit.
    """

    position: Point
    velocity: Point = (0.0, 0.0, 0.0)
    yaw: float | None = None
    speed: float | None = None


@dataclass(frozen=True, slots=True)
class Done:
    """The step succeeded."""


@dataclass(frozen=True, slots=True)
class Failed:
    """The step failed, with the reason."""

    why: str


Answer: TypeAlias = Mapping[str, Goal] | Done | Failed
"""Goals by agent name (agents not listed keep their goals), or the outcome of the step."""


@runtime_checkable
class ExternalPlanner(Protocol):
    """Sets goals for the agents of a step; created with the scene and the rows of those agents.

    If it has a ``close()`` method, that is called once, however the mission ended.
    """

    def plan(self, estimate: Estimate, health: Health, rows: tuple[int, ...]) -> Answer:
        """Return the current goals; the tick waits for this call.

        A goal must be finite, inside the fence and the flight heights, clear of obstacles, within
        ``limits.speed``, and for one of `rows`. Anything else, like an exception, ends the mission
        with an error that names the planner.

        Args:
            estimate: State of all agents.
            health: Health of all agents.
            rows: The agents currently in the step. Since the last call some may have been removed,
                added, or have replaced another agent and inherited its goal.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class ExternalPlannerSpec(Spec):
    """Announces an external planner, which ``external: {planner: NAME}`` chooses.

    Attributes:
        make: ``make(scene, rows)`` with the rows of a step's agents.
    """

    make: Callable[[Scene, tuple[int, ...]], ExternalPlanner]
