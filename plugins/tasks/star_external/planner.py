"""What an external planner is: in every tick it says where its agents are to fly.

It runs in this process, made by what an entry point names (`star_external.choice.GROUP`); what
another process says through the socket comes to the same. Nothing here imports numpy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias, runtime_checkable

if TYPE_CHECKING:
    from star_core import Estimate, Health

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Goal:
    """Where one agent is wanted.

    Attributes:
        position: In the map, m.
        velocity: Of the goal, m/s: fed forward, it leads nowhere by itself.
        yaw: rad; None leaves it.
        speed: Greatest on the way, m/s; None for the mission's limit.
    """

    position: Point
    velocity: Point = (0.0, 0.0, 0.0)
    yaw: float | None = None
    speed: float | None = None


@dataclass(frozen=True, slots=True)
class Done:
    """The step is over, and a success."""


@dataclass(frozen=True, slots=True)
class Failed:
    """The step failed, and why."""

    why: str


Answer: TypeAlias = Mapping[str, Goal] | Done | Failed
"""Goals by agent's name, an agent that is not named keeps its goal; or how the step ended."""


@runtime_checkable
class ExternalPlanner(Protocol):
    """Gives the agents of a step goals; it is made with the scene and the rows of those agents.

    One that has ``close()`` is closed once, however the mission ended.
    """

    def plan(self, estimate: Estimate, health: Health, rows: tuple[int, ...]) -> Answer:
        """Return what is wanted now; it is not waited for longer than the call takes.

        A goal must be finite, inside the fence and the heights to fly at, in no obstacle, within
        ``limits.speed``, and for one of `rows`: anything else, like an exception, ends the mission
        in the planner's name.

        Args:
            estimate: Where everybody is.
            health: How everybody is.
            rows: The agents in the step now. Some may have left since the last call, or joined, or
                taken another's place and with it the goal.
        """
        ...
