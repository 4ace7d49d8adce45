"""A flight of some agents to one point each: what ``goto`` and ``hold`` share."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from star_core import Array, Estimate, Goals, Scene
from star_verbs.assignment import assign
from star_verbs.crew import Crew
from star_verbs.places import fault
from star_verbs.slots import slots
from star_verbs.timeouts import time_out


class Approach:
    """A flight of some agents to one point each.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        speed: Greatest speed, m/s; the scene's limit at most, and if None.
        yaw_deg: Heading to turn to, degrees; None keeps each agent's own.
        within: How near to its point each agent must come, m.

    Attributes:
        crew: The agents.
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
        self.crew = Crew(scene, rows)
        self.goals: Goals | None = None
        self._speed = min(speed or math.inf, scene.limits.speed)
        self._yaw = None if yaw_deg is None else math.radians(yaw_deg)
        self._within = within
        self._target: Array | None = None
        self._yaws: Array = np.zeros(len(rows))
        self._fault: str | None = None

    def stay(self, rows: tuple[int, ...]) -> None:
        """Go on with some of the agents, each to the point it had."""
        kept = self.crew.stay(rows)
        if self._target is not None:
            self._yaws, self._target = self._yaws[kept], self._target[kept]
            self.goals = self.crew.goals(self._target, self._yaws, self._speed)

    def swap(self, old: int, new: int) -> None:
        """Let another agent fly to the point that one had."""
        self.crew.swap(old, new)
        if self._target is not None:
            self.goals = self.crew.goals(self._target, self._yaws, self._speed)

    def spread(self, estimate: Estimate, centre: Sequence[float], spacing: float) -> Array:
        """Return (K, 3) places around `centre`, each agent's the one that suits all best, m."""
        here = estimate.position[self.crew.rows]
        place = np.array(slots(len(here), centre, spacing))
        return place[assign(here, place)]

    def aim(self, estimate: Estimate, target: Array) -> None:
        """Send the agents to `target` (K, 3), m."""
        self._yaws = (
            estimate.yaw[self.crew.rows] if self._yaw is None else np.full(len(target), self._yaw)
        )
        self._target = target
        self.goals = self.crew.goals(target, self._yaws, self._speed)

    def fault(self) -> str:
        """Say which agents were sent where no agent can be, and why not; empty if none were.

        A mission's check has seen places for all agents of a step, but not those for the agents
        that are left, nor where an offset leads.
        """
        if self._fault is None and self._target is not None:
            self._fault = "; ".join(
                f"{self.crew.scene.agents[row].name} cannot be there: {message}"
                for row, point in zip(self.crew.rows, self._target.tolist(), strict=True)
                if (message := fault(self.crew.scene, point)) is not None
            )
        return self._fault or ""

    def arrived(self, estimate: Estimate) -> bool:
        """Whether all of them are at their points and have stopped."""
        return (
            self._target is not None
            and self.crew.farthest(estimate, self._target) <= self._within
            and self.crew.slow(estimate)
        )

    def time_out(self, estimate: Estimate, extra: float = 0.0) -> float:
        """Return how long the flight, and `extra` seconds besides, may take, s."""
        return time_out(self.crew.journey(estimate, self._target) / self._speed + extra)
