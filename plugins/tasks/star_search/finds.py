"""What the finder of a target does: search on, land at it, stay over it, or mark it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core import AgentPhase, Array, Command, Estimate, Health, Order, timeout
from star_search.field import Field
from star_search.pattern import Aim
from star_search.timing import NEAR

SLOW: Final = 0.15  # m/s: an agent that is slower has stopped, as far as its estimate can tell
LAND_SPEED: Final = 0.2  # m/s, as the verb `land` descends
APART: Final = 0.6  # m between two agents that stay at targets, as where verbs spread agents
DOWN: Final = (int(AgentPhase.LANDED), int(AgentPhase.GROUNDED))


@dataclass(slots=True)
class Visit:
    """A finder's visit to its target.

    Attributes:
        target: Row of the target.
        place: (2,) where it stays, map frame, m.
        until: When it stays where it is, though it is not there, s; None until it sets out.
        there: Since when it is there, s; None before.
        over: Whether it has done what it was to do; it may still stay.
    """

    target: int
    place: Array
    until: float | None = None
    there: float | None = None
    over: bool = False


class Finds:
    """Keeps where targets seem to be, and takes their finders to them.

    A finder is taken to one target; which it finds on its way it has found, no more. With ``mark``
    it is free again afterwards. A target found before the search began is assigned to no agent.

    Args:
        field: Where to search.
        then: ``continue``, ``land``, ``hover`` or ``mark``.
        mark_for: How long to stay over a target to mark it, s.
    """

    def __init__(self, field: Field, *, then: str, mark_for: float) -> None:
        self._field = field
        self._then = then
        self._mark_for = mark_for
        tags = field.scene.world.targets
        self.names = tuple(dict.fromkeys(tag.of for tag in tags))
        self._of = {tag.id: self.names.index(tag.of) for tag in tags}
        self._sum = np.zeros((len(self.names), 2))  # m, weighed by the inverse of the variance
        self._weight = np.zeros(len(self.names))
        self._known = np.zeros(len(self.names), np.bool_)
        self._visits: dict[int, Visit] = {}
        self._taken: list[Array] = []  # (2,) where agents landed or stay, m

    def begin(self, health: Health) -> float:
        """Take in what was found before; return how long visits may take in all, s."""
        self._known = health.finder >= 0
        if self._then == "continue":
            return 0.0
        fence = self._field.scene.world.fence
        across = math.dist(fence.low[:2], fence.high[:2]) / self._field.speed
        each = {"mark": self._mark_for + across, "land": self._field.height / LAND_SPEED}
        return across + each.get(self._then, 0.0) * max(1, int((~self._known).sum()))

    def see(self, estimate: Estimate, health: Health, rows: tuple[int, ...]) -> None:
        """Process sightings, and send each finder to its target."""
        sightings = estimate.sightings
        for k, tag in enumerate(sightings.tag.tolist()):
            target = self._of.get(tag)
            spread = float(np.trace(sightings.covariance[k]))
            if target is not None and 0 < spread < math.inf:
                self._sum[target] += sightings.position[k, :2] / spread
                self._weight[target] += 1 / spread
        new = (health.finder >= 0) & ~self._known
        self._known |= new
        for target in np.flatnonzero(new).tolist():
            row = int(health.finder[target])
            if self._then != "continue" and row in rows and row not in self._visits:
                self._visits[row] = self._visit(target, estimate, row)

    def swap(self, old: int, new: int) -> None:
        """Let another agent make the visit that one was on, from its beginning."""
        visit = self._visits.pop(old, None)
        if visit is not None:
            visit.until, visit.there = None, None
            self._visits[new] = visit

    def found(self, wanted: int | list[str]) -> bool:
        """Whether so many targets, or these, are found."""
        if isinstance(wanted, int):
            return int(self._known.sum()) >= wanted
        return all(self._known[self.names.index(name)] for name in wanted)

    def busy(self, rows: tuple[int, ...]) -> tuple[int, ...]:
        """Return the agents that visit a target now, or stay at one for good."""
        return tuple(row for row in rows if row in self._visits)

    def pending(self, rows: tuple[int, ...]) -> bool:
        """Whether one of these agents has not yet done what finders do."""
        return any(not self._visits[row].over for row in self.busy(rows))

    def lead(
        self, estimate: Estimate, health: Health, rows: tuple[int, ...]
    ) -> tuple[dict[int, Aim], list[Command]]:
        """Return where the finders should go, and what to order."""
        aims: dict[int, Aim] = {}
        orders: list[Command] = []
        for row in self.busy(rows):
            visit = self._visits[row]
            if not visit.over and self._then == "land" and visit.there is not None:
                visit.over = int(health.phase[row]) in DOWN
                continue
            if visit.over and self._then == "land":
                continue
            if estimate.valid[row]:
                if visit.until is None:
                    visit.until = self._deadline(visit.place, estimate, row)
                aims[row] = self._fly(visit, estimate, row)
                if visit.there is None and self._arrived(visit, estimate, row):
                    visit.there = estimate.time
                    orders += [self._landing(estimate, row)] if self._then == "land" else []
            self._settle(row, visit, estimate.time)
        return aims, orders

    def _settle(self, row: int, visit: Visit, time: float) -> None:
        """End a visit that is over."""
        if visit.there is None or self._then == "land":
            return
        if self._then == "hover":
            visit.over = True
        elif time - visit.there >= self._mark_for:
            del self._visits[row]

    def _visit(self, target: int, estimate: Estimate, row: int) -> Visit:
        """Return a visit to where a target seems to be, or the place nearest to that."""
        here = estimate.position[row]
        weight = self._weight[target]
        seems = self._sum[target] / weight if weight > 0 else here[:2]
        place = np.array(self._field.nearest(seems, here, self._taken, APART))
        if self._then != "mark":
            self._taken.append(place)
        return Visit(target, place)

    def _deadline(self, place: Array, estimate: Estimate, row: int) -> float:
        way = math.dist(estimate.position[row, :2], place)
        return estimate.time + timeout(way / self._field.speed)

    def _fly(self, visit: Visit, estimate: Estimate, row: int) -> Aim:
        x, y = visit.place.tolist()
        dx, dy = visit.place - estimate.position[row, :2]
        near = math.hypot(dx, dy) <= NEAR
        yaw = float(estimate.yaw[row]) if near else math.atan2(dy, dx)
        return Aim(x, y, yaw)

    def _arrived(self, visit: Visit, estimate: Estimate, row: int) -> bool:
        far = math.dist(estimate.position[row, :2], visit.place)
        speed = float(np.linalg.norm(estimate.velocity[row]))
        late = visit.until is not None and estimate.time > visit.until
        return (far <= NEAR and speed < SLOW) or late

    def _landing(self, estimate: Estimate, row: int) -> Command:
        floor = estimate.position[row].copy()
        duration = max(1.0, floor[2] / LAND_SPEED)
        floor[2] = 0.0
        return Command(
            Order.LAND,
            np.array([row]),
            floor[None],
            estimate.yaw[[row]],
            np.array([duration]),
        )
