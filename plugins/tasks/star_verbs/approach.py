"""A flight of some agents to one point each, used by ``goto``, ``hold`` and ``leave``."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from star_core import Array, Estimate, Goals, Scene, timeout
from star_verbs.assignment import assign
from star_verbs.places import fault
from star_verbs.slots import slots
from star_verbs.step_agents import StepAgents


class Approach:
    """A flight of some agents to one point each.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        speed: Speed limit, m/s; at most the scene's limit, and that if None.
        yaw_deg: Heading to turn to, degrees; None keeps each agent's own.
        within: Distance to its point that each agent must reach, m.

    Attributes:
        agents: The agents.
        goals: Their goals; None until `aim`.
    """

    def __init__(
        self,
        scene: Scene,
        rows: tuple[int, ...],
        *,
        speed: float | None,
        yaw_deg: float | None,
        within: float,
    ) -> None:
        self.agents = StepAgents(scene, rows)
        self.goals: Goals | None = None
        self._speed = min(speed or math.inf, scene.limits.speed)
        self._yaw = None if yaw_deg is None else math.radians(yaw_deg)
        self._within = within
        self._target: Array | None = None
        self._yaws: Array = np.zeros(len(rows))
        self._fault: str | None = None

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        """Continue with some of the agents, each to its previous point."""
        kept = self.agents.keep(rows)
        if self._target is not None:
            self._yaws, self._target = self._yaws[kept], self._target[kept]
            self.goals = self.agents.goals(self._target, self._yaws, self._speed)

    def on_agent_replaced(self, old: int, new: int) -> None:
        """Send another agent to the point of one."""
        self.agents.replace(old, new)
        if self._target is not None:
            self.goals = self.agents.goals(self._target, self._yaws, self._speed)

    def spread(self, estimate: Estimate, centre: Sequence[float], spacing: float) -> Array:
        """Return (K, 3) positions around `centre`, assigned for the least total distance, m."""
        here = estimate.position[self.agents.rows]
        place = np.array(slots(len(here), centre, spacing))
        return place[assign(here, place)]

    def aim(self, estimate: Estimate, target: Array) -> None:
        """Send the agents to `target` (K, 3), m."""
        self._yaws = (
            estimate.yaw[self.agents.rows] if self._yaw is None else np.full(len(target), self._yaw)
        )
        self._target = target
        self.goals = self.agents.goals(target, self._yaws, self._speed)

    def fault(self) -> str:
        """Return which agents have goals that are not flyable, and why; empty if none.

        The check of the mission covers the positions for all agents of a step, but not those for
        the remaining agents, nor the results of offsets.
        """
        if self._fault is None and self._target is not None:
            self._fault = "; ".join(
                f"{self.agents.scene.agents[row].name} cannot be there: {message}"
                for row, point in zip(self.agents.rows, self._target.tolist(), strict=True)
                if (message := fault(self.agents.scene, point)) is not None
            )
        return self._fault or ""

    def arrived(self, estimate: Estimate) -> bool:
        """Whether all of them are at their points and have stopped."""
        return self.away(estimate) <= self._within and self.agents.slow(estimate)

    def away(self, estimate: Estimate) -> float:
        """Return the greatest distance of an agent from its point, m; infinite if not known."""
        return math.inf if self._target is None else self.agents.farthest(estimate, self._target)

    def timeout(self, estimate: Estimate, extra: float = 0.0) -> float:
        """Return the timeout of the flight and `extra` seconds, s."""
        return timeout(self.agents.journey(estimate, self._target) / self._speed + extra)
