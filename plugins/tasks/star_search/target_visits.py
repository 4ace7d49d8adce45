"""What agents do that find a target: continue to search, land at it, hover over it, or mark it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core import AgentPhase, Array, Command, Estimate, Health, Order
from star_core.toolkit import timeout
from star_search.pattern import TOLERANCE, Waypoint
from star_search.search_space import SearchSpace

MAX_REST_SPEED: Final = 0.15  # m/s: a slower agent has stopped, within its estimate's accuracy
LANDING_SPEED: Final = 0.2  # m/s, the default of the verb `land`
STAY_SPACING: Final = 0.6  # m between agents that stay at targets, the default of other verbs
ON_GROUND: Final = (int(AgentPhase.LANDED), int(AgentPhase.GROUNDED))


@dataclass(slots=True)
class Visit:
    """A finder's visit to its target.

    Attributes:
        position: (2,) where it stays, map frame, m.
        deadline: Time at which it stays where it is, s; None before it departs.
        arrival: Time of its arrival, s; None before.
        over: Whether it has done what it was to do; it may still stay.
    """

    position: Array
    deadline: float | None = None
    arrival: float | None = None
    over: bool = False


class TargetVisits:
    """Estimates positions of targets, and sends their finders to them.

    A finder visits one target; others that it sees on its way count as found, no more. With
    ``mark`` it is free again afterwards. A target found before the search began is not visited.

    Args:
        space: Where to search.
        on_found: ``continue``, ``land``, ``hover`` or ``mark``.
        mark_duration: Time to hover over a target to mark it, s.
    """

    def __init__(self, space: SearchSpace, *, on_found: str, mark_duration: float) -> None:
        self._space = space
        self._on_found = on_found
        self._mark_duration = mark_duration
        tags = space.scene.world.targets
        self.names = tuple(dict.fromkeys(tag.of for tag in tags))
        self._of = {tag.id: self.names.index(tag.of) for tag in tags}
        self._sum = np.zeros((len(self.names), 2))  # m, weighted by the inverse of the variance
        self._weight = np.zeros(len(self.names))
        self._has_finder = np.zeros(len(self.names), np.bool_)
        self._visits: dict[int, Visit] = {}
        self._taken: list[Array] = []  # (2,) positions where agents landed or stay, m

    def begin(self, health: Health) -> float:
        """Note which targets are known already; return how long all visits may take, s."""
        self._has_finder = health.finder >= 0
        if self._on_found == "continue":
            return 0.0
        fence = self._space.scene.world.fence
        across = math.dist(fence.low[:2], fence.high[:2]) / self._space.speed
        each = {"mark": self._mark_duration + across, "land": self._space.height / LANDING_SPEED}
        return across + each.get(self._on_found, 0.0) * max(1, int((~self._has_finder).sum()))

    def update(self, estimate: Estimate, health: Health, rows: tuple[int, ...]) -> None:
        """Process sightings, and send each new finder to its target."""
        sightings = estimate.sightings
        for k, tag in enumerate(sightings.tag.tolist()):
            target = self._of.get(tag)
            variance = float(np.trace(sightings.covariance[k]))
            if target is not None and 0 < variance < math.inf:
                self._sum[target] += sightings.position[k, :2] / variance
                self._weight[target] += 1 / variance
        new = (health.finder >= 0) & ~self._has_finder
        self._has_finder |= new
        for target in np.flatnonzero(new).tolist():
            row = int(health.finder[target])
            if self._on_found != "continue" and row in rows and row not in self._visits:
                self._visits[row] = self._visit(target, estimate.position[row])

    def replace(self, old: int, new: int) -> None:
        """Let another agent make the visit of one, from its beginning."""
        visit = self._visits.pop(old, None)
        if visit is not None:
            visit.deadline, visit.arrival = None, None
            self._visits[new] = visit

    def has_found(self, targets: int | list[str]) -> bool:
        """Whether so many targets, or these, are found."""
        if isinstance(targets, int):
            return int(self._has_finder.sum()) >= targets
        return all(self._has_finder[self.names.index(name)] for name in targets)

    def visitors(self, rows: tuple[int, ...]) -> tuple[int, ...]:
        """Return which of these agents visit a target, or stay at one for good."""
        return tuple(row for row in rows if row in self._visits)

    def pending(self, rows: tuple[int, ...]) -> bool:
        """Whether a visit of one of these agents is not over."""
        return any(not self._visits[row].over for row in self.visitors(rows))

    def step(
        self, estimate: Estimate, health: Health, rows: tuple[int, ...]
    ) -> tuple[dict[int, Waypoint], list[Command]]:
        """Return waypoints and commands of the visitors."""
        lands = self._on_found == "land"
        waypoints: dict[int, Waypoint] = {}
        commands: list[Command] = []
        for row in self.visitors(rows):
            visit = self._visits[row]
            if lands and (visit.over or visit.arrival is not None):
                visit.over = visit.over or int(health.phase[row]) in ON_GROUND
                continue
            if estimate.valid[row]:
                if visit.deadline is None:
                    distance = math.dist(estimate.position[row, :2], visit.position)
                    visit.deadline = estimate.time + timeout(distance / self._space.speed)
                waypoints[row] = self._waypoint(visit, estimate, row)
                if visit.arrival is None and self._arrived(visit, estimate, row):
                    visit.arrival = estimate.time
                    commands += [self._landing(estimate, row)] if lands else []
            if visit.arrival is None or lands:
                continue
            if self._on_found == "hover":
                visit.over = True
            elif estimate.time - visit.arrival >= self._mark_duration:
                del self._visits[row]
        return waypoints, commands

    def _visit(self, target: int, agent_position: Array) -> Visit:
        """Return a visit to the estimated position of a target, or the nearest free one."""
        weight = self._weight[target]
        estimated = self._sum[target] / weight if weight > 0 else agent_position[:2]
        position = self._space.nearest_free(estimated, agent_position, self._taken, STAY_SPACING)
        if self._on_found != "mark":
            self._taken.append(position)
        return Visit(position)

    def _waypoint(self, visit: Visit, estimate: Estimate, row: int) -> Waypoint:
        x, y = visit.position.tolist()
        dx, dy = visit.position - estimate.position[row, :2]
        near = math.hypot(dx, dy) <= TOLERANCE
        return Waypoint(x, y, float(estimate.yaw[row]) if near else math.atan2(dy, dx))

    def _arrived(self, visit: Visit, estimate: Estimate, row: int) -> bool:
        distance = math.dist(estimate.position[row, :2], visit.position)
        speed = float(np.linalg.norm(estimate.velocity[row]))
        late = visit.deadline is not None and estimate.time > visit.deadline
        return (distance <= TOLERANCE and speed < MAX_REST_SPEED) or late

    def _landing(self, estimate: Estimate, row: int) -> Command:
        floor = estimate.position[[row]]
        duration = np.maximum(floor[:, 2] / LANDING_SPEED, 1.0)
        floor[:, 2] = 0.0
        return Command(Order.LAND, np.array([row]), floor, estimate.yaw[[row]], duration)
