"""The planner `orbit` of the verb `external`: agents fly round a circle, evenly apart."""

from __future__ import annotations

from math import cos, pi, sin, tau

from star_core import Estimate, Health, Scene
from star_external.planner import Answer, Done, Goal

RADIUS = 0.6  # m, around the map's origin
HEIGHT = 1.0  # m
PACE = 0.6  # of the greatest speed: what is left is for catching up
LAPS = 1


class Orbit:
    """Leads its agents round once, and is done.

    Args:
        scene: The mission's scene.
        rows: Rows of its agents.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...]) -> None:
        self._names = scene.names
        self._speed = PACE * scene.limits.speed
        self._begun: float | None = None  # s

    def plan(self, estimate: Estimate, health: Health, rows: tuple[int, ...]) -> Answer:
        if self._begun is None:
            self._begun = estimate.time
        flown = self._speed * (estimate.time - self._begun) / RADIUS  # rad
        if flown >= LAPS * tau:
            return Done()
        angles = {row: pi + flown + tau * i / len(rows) for i, row in enumerate(rows)}
        return {self._names[row]: self._goal(angle) for row, angle in angles.items()}

    def _goal(self, angle: float) -> Goal:
        """Where an agent should be on the circle, and how fast it should move along."""
        x, y = cos(angle), sin(angle)
        return Goal(
            position=(RADIUS * x, RADIUS * y, HEIGHT),
            velocity=(-self._speed * y, self._speed * x, 0.0),
        )
