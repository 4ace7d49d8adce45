"""The verb ``search``: cover an area until targets are found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from star_core import AgentPhase, Estimate, Health, Status, TaskOutput
from star_core.toolkit import timeout
from star_search.pattern import Pattern
from star_search.search_space import SearchSpace
from star_search.target_visits import TargetVisits

FLYING: Final = int(AgentPhase.FLYING)
ABLE: Final = (int(AgentPhase.FLYING), int(AgentPhase.LOST))


class Search:
    """Sends scouts over an area by a pattern, and finders to their targets.

    Another agent may replace a scout in flight; one without a camera does not search.

    It waits until all scouts that fly are located. It is over when the area is covered, or no scout
    can see anything more, or enough targets are found, and the visits of finders are over. It fails
    when all scouts stay at targets though the area is not covered.

    Args:
        space: Where to search.
        pattern: Pattern of the search.
        visits: Visits of finders to targets.
        targets: Number or names of targets that end the search; 0 to cover the area in any case.
        coverage: Share of the visible area at which it is covered.
    """

    def __init__(
        self,
        space: SearchSpace,
        pattern: Pattern,
        visits: TargetVisits,
        *,
        targets: int | Sequence[str],
        coverage: float,
    ) -> None:
        self._space = space
        self._pattern = pattern
        self._visits = visits
        self._targets = targets if isinstance(targets, int) else list(targets)
        self._coverage = coverage
        self._rows = space.rows
        self._begun = False

    def begin(self, estimate: Estimate, health: Health) -> float:
        visits = self._visits.begin(health)
        return timeout((self._start(estimate, health) or self._rough_duration()) + visits)

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if not self._begun and self._start(estimate, health) is None:
            return (
                TaskOutput()
                if self._able(health)
                else TaskOutput(status=Status.FAILURE, reason="no agent flies; take off first")
            )
        scouts = tuple(row for row in self._flying(health) if estimate.valid[row])
        self._visits.update(estimate, health, self._rows)
        self._space.observe(estimate, scouts)
        visiting, commands = self._visits.step(estimate, health, self._rows)
        visitors = self._visits.visitors(self._rows)
        free = tuple(row for row in scouts if row not in visitors)
        searching = self._pattern.waypoints(estimate, free)
        status, reason = self._status(health, free, searching=bool(searching))
        goals = self._space.goals({**searching, **visiting})
        return TaskOutput(goals, tuple(commands), status, reason)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        self._rows = tuple(row for row in rows if row in self._space.views)

    on_agents_added = on_agents_removed

    def on_agent_replaced(self, old: int, new: int) -> None:
        self._visits.replace(old, new)
        self.on_agents_removed(tuple(new if row == old else row for row in self._rows))

    def _status(
        self, health: Health, free: tuple[int, ...], *, searching: bool
    ) -> tuple[Status, str]:
        """Return the status of the search, and why it failed.

        Args:
            health: Of all agents.
            free: Scouts that search.
            searching: Whether one of them has a waypoint.
        """
        covered = self._space.coverage.fraction
        if self._visits.pending(self._rows):
            return Status.RUNNING, ""
        enough = self._targets != 0 and self._visits.has_found(self._targets)
        if enough or covered >= self._coverage:
            return Status.SUCCESS, ""
        if searching or (not free and self._able(health)):
            return Status.RUNNING, ""
        if free:
            return Status.SUCCESS, ""
        return Status.FAILURE, f"no agent remains to search; {covered:.0%} of the area was seen"

    def _start(self, estimate: Estimate, health: Health) -> float | None:
        """Plan once all flying agents are located; return the expected duration, s."""
        scouts = self._flying(health)
        if not scouts or not all(estimate.valid[row] for row in scouts):
            return None
        self._begun = True
        return self._pattern.begin(estimate, scouts)

    def _rough_duration(self) -> float:
        """Expected duration of a search from unknown positions, s."""
        fence, space = self._space.scene.world.fence, self._space
        lanes = space.area.area / space.lane_spacing / len(self._rows)
        return (math.dist(fence.low[:2], fence.high[:2]) + lanes) / space.speed

    def _flying(self, health: Health) -> tuple[int, ...]:
        return tuple(row for row in self._rows if health.phase[row] == FLYING)

    def _able(self, health: Health) -> bool:
        """Whether an agent that visits no target flies, or may be located again."""
        visitors = self._visits.visitors(self._rows)
        return any(health.phase[row] in ABLE and row not in visitors for row in self._rows)
