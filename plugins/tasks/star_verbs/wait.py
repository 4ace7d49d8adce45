"""The verb ``wait``: stay where one is until the step's condition holds."""

from __future__ import annotations

from star_core import Estimate, Health, Step

PATIENCE = 60.0  # s: how long a condition is waited for if the mission does not say


class Wait:
    """Wants nothing of its agents, which keep the goals they have; the core knows the condition."""

    def begin(self, estimate: Estimate, health: Health) -> float:
        return PATIENCE

    def step(self, estimate: Estimate, health: Health) -> Step:
        return Step()

    def stay(self, rows: tuple[int, ...]) -> None:
        """Whoever is left waits on."""

    def swap(self, old: int, new: int) -> None:
        """Whoever comes waits too."""
