"""The verb ``goto``: fly to a point, or by an offset, and stop there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from star_core import Estimate, Health, Status, TaskOutput
from star_verbs.approach import Approach


class Goto:
    """Sends agents to a point, spread around it, or each of them by an offset.

    It waits until all its agents are located, and fails if a goal is not flyable.

    Args:
        approach: The flight there.
        to: Point to fly to, map frame, m.
        by: Offset from each agent's position when the step begins, along the map's axes, m.
        spacing: Least distance between agents sent to one point, m.
    """

    def __init__(
        self,
        approach: Approach,
        *,
        to: Sequence[float] | None,
        by: Sequence[float] | None,
        spacing: float,
    ) -> None:
        self._approach = approach
        self._to = to
        self._by = by
        self._spacing = spacing

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._aim(estimate)
        return self._approach.timeout(estimate)

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if self._approach.goals is None:
            self._aim(estimate)
        if why := self._approach.fault():
            return TaskOutput(status=Status.FAILURE, reason=why)
        arrived = self._approach.arrived(estimate)
        return TaskOutput(
            self._approach.goals, status=Status.SUCCESS if arrived else Status.RUNNING
        )

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        self._approach.on_agents_removed(rows)

    def on_agent_replaced(self, old: int, new: int) -> None:
        self._approach.on_agent_replaced(old, new)

    def _aim(self, estimate: Estimate) -> None:
        agents = self._approach.agents
        if not agents.located(estimate):
            return
        if self._to is not None:
            target = self._approach.spread(estimate, self._to, self._spacing)
        else:
            target = estimate.position[agents.rows] + np.array(self._by, np.float64)
        self._approach.aim(estimate, target)
