"""The verb ``wait``: hover until the step's condition holds."""

from __future__ import annotations

from star_core import Estimate, Health, TaskOutput

PATIENCE = 60.0  # s, default timeout of the condition


class Wait:
    """Leaves the goals of its agents unchanged; the core evaluates the condition."""

    def begin(self, estimate: Estimate, health: Health) -> float:
        return PATIENCE

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        return TaskOutput()

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        """The remaining agents keep waiting."""

    def on_agent_replaced(self, old: int, new: int) -> None:
        """The new agent waits too."""
