"""The verb ``hold``: hover in place for a time."""

from __future__ import annotations

from collections.abc import Sequence

from star_core import Estimate, Health, Status, TaskOutput, timeout
from star_verbs.approach import Approach

ROUNDING = 1e-9  # s: ticks are sums of periods


class Hold:
    """Keeps agents in place, or at a point and spread around it, for a time from their arrival.

    It waits until all its agents are located, and fails if a goal is not flyable. Agents that stay
    at their positions have arrived at once.

    Args:
        approach: The flight there.
        at: Point to hover at, map frame, m; None keeps each agent in place.
        spacing: Least distance between agents sent to one point, m.
        seconds: Duration, s.
    """

    def __init__(
        self, approach: Approach, *, at: Sequence[float] | None, spacing: float, seconds: float
    ) -> None:
        self._approach = approach
        self._at = at
        self._spacing = spacing
        self._seconds = seconds
        self._since: float | None = None

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._aim(estimate)
        if self._at is None:
            return timeout(self._seconds)
        return self._approach.timeout(estimate, self._seconds)

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if self._approach.goals is None:
            self._aim(estimate)
        if self._at is not None and (why := self._approach.fault()):
            return TaskOutput(status=Status.FAILURE, reason=why)
        if self._since is None and self._here(estimate):
            self._since = estimate.time
        over = self._since is not None and estimate.time - self._since >= self._seconds - ROUNDING
        return TaskOutput(self._approach.goals, status=Status.SUCCESS if over else Status.RUNNING)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        self._approach.on_agents_removed(rows)

    def on_agent_replaced(self, old: int, new: int) -> None:
        self._approach.on_agent_replaced(old, new)

    def _aim(self, estimate: Estimate) -> None:
        agents = self._approach.agents
        if not agents.located(estimate):
            return
        if self._at is None:
            target = estimate.position[agents.rows]
        else:
            target = self._approach.spread(estimate, self._at, self._spacing)
        self._approach.aim(estimate, target)

    def _here(self, estimate: Estimate) -> bool:
        if self._at is None:
            return self._approach.goals is not None
        return self._approach.arrived(estimate)
