"""The verb ``search``: cover an area until targets are found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from star_core import AgentPhase, Estimate, Health, Status, TaskOutput, timeout
from star_search.field import Field
from star_search.finds import Finds
from star_search.pattern import Pattern

FLYING: Final = int(AgentPhase.FLYING)
GROUNDED: Final = "nobody flies; take off first"
ABLE: Final = (int(AgentPhase.FLYING), int(AgentPhase.LOST))


class Search:
    """Leads scouts over an area by a pattern, and finders to their targets.

    Another agent may take a scout's place in flight; one without a camera only keeps the place.

    It waits until all scouts that fly are located. It is over when the area is covered, or nothing
    is left that a scout could see, or enough targets are found, and the finders have done what they
    are to do; and it fails when all scouts stay at targets though the area is not covered.

    Args:
        field: Where to search.
        pattern: How.
        finds: What finders do.
        targets: How many targets, or which, are enough; 0 to cover the area whatever is found.
        coverage: Share of what can be seen of the area at which it is covered.
    """

    def __init__(
        self,
        field: Field,
        pattern: Pattern,
        finds: Finds,
        *,
        targets: int | Sequence[str],
        coverage: float,
    ) -> None:
        self._field = field
        self._pattern = pattern
        self._finds = finds
        self._enough = targets if isinstance(targets, int) else list(targets)
        self._coverage = coverage
        self._rows = field.rows
        self._begun = False

    def begin(self, estimate: Estimate, health: Health) -> float:
        visits = self._finds.begin(health)
        return timeout((self._start(estimate, health) or self._roughly()) + visits)

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if not self._begun and self._start(estimate, health) is None:
            return (
                TaskOutput()
                if self._able(health)
                else TaskOutput(status=Status.FAILURE, reason=GROUNDED)
            )
        scouts = tuple(row for row in self._flying(health) if estimate.valid[row])
        self._finds.see(estimate, health, self._rows)
        self._field.look(estimate, scouts)
        aims, orders = self._finds.lead(estimate, health, self._rows)
        busy = self._finds.busy(self._rows)
        free = tuple(row for row in scouts if row not in busy)
        led = self._pattern.lead(estimate, free)
        status, reason = self._judge(health, free, led=bool(led))
        return TaskOutput(self._field.goals({**led, **aims}), tuple(orders), status, reason)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        self._rows = tuple(row for row in rows if row in self._field.views)

    on_agents_added = on_agents_removed

    def on_agent_replaced(self, old: int, new: int) -> None:
        self._finds.swap(old, new)
        self.on_agents_removed(tuple(new if row == old else row for row in self._rows))

    def _judge(self, health: Health, free: tuple[int, ...], *, led: bool) -> tuple[Status, str]:
        """Say whether the search is over, and why it failed if it did.

        Args:
            health: Of all agents.
            free: Scouts that search.
            led: Whether one of them has somewhere to go.
        """
        covered = self._field.chart.covered
        if self._finds.pending(self._rows):
            return Status.RUNNING, ""
        enough = self._enough != 0 and self._finds.found(self._enough)
        if enough or covered >= self._coverage:
            return Status.SUCCESS, ""
        if led or (not free and self._able(health)):
            return Status.RUNNING, ""
        if free:
            return Status.SUCCESS, ""
        return Status.FAILURE, f"nobody is left to search; {covered:.0%} of the area was seen"

    def _start(self, estimate: Estimate, health: Health) -> float | None:
        """Plan, once all flying agents are located; return how long it should take, s."""
        scouts = self._flying(health)
        if not scouts or not all(estimate.valid[row] for row in scouts):
            return None
        self._begun = True
        return self._pattern.begin(estimate, scouts)

    def _roughly(self) -> float:
        """How long a search should take, s, of which is not known where it begins."""
        fence, field = self._field.scene.world.fence, self._field
        lanes = field.area.area / field.swath / len(self._rows)
        return (math.dist(fence.low[:2], fence.high[:2]) + lanes) / field.speed

    def _flying(self, health: Health) -> tuple[int, ...]:
        return tuple(row for row in self._rows if health.phase[row] == FLYING)

    def _able(self, health: Health) -> bool:
        """Whether an agent that is at no target flies, or may be located again."""
        busy = self._finds.busy(self._rows)
        return any(health.phase[row] in ABLE and row not in busy for row in self._rows)
