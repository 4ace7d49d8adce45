"""Clearances that grow for agents whose positions are uncertain."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from typing import Final, TypeAlias

import numpy as np

from star_core import Array, Estimate, Mask, Rows, Scene
from star_core.toolkit import MAX_MARGIN_RATIO, position_margin
from star_visibility.network import Work
from star_visibility.routes import Routes

LEVELS: Final = 4
"""Clearances beside the smallest, evenly spaced up to `MAX_MARGIN_RATIO` times more than that."""

RISE: Final = 0.6  # of a step: a margin so far beyond its level raises it
FALL: Final = 0.5  # of a step below its level lowers it
HOLD_TIME: Final = 3.0  # s, for which the margin must be so low: at most landmarks it grows again
MAX_DETOUR: Final = 1.5  # times the length of the shortest path: a longer one is not taken
EXTRA_DETOUR: Final = 0.5  # m, beyond that
RETRY_TIME: Final = 2.0  # s, after which a path with more clearance is searched again

WidePath: TypeAlias = tuple[Array | str, int]
"""(K, 3) points of a path, m, or the reason there is none; and its level of clearance."""


class Clearances:
    """Routes with several clearances, and which of them each agent needs and flies.

    The clearance grows by the margin for an agent's uncertain position, `position_margin`, in
    steps. A step is taken when the margin is a good part of a step beyond the present one, and
    undone when it has been below for a while: a covariance that shrinks at each landmark and grows
    in between does not change the path each time. If there is no path with the wanted clearance, or
    only by a long detour, it is the one with the greatest clearance that is not.

    Args:
        scene: World and limits.
        clearance: Horizontal distance to obstacles with an exact position, m.
        vertical_clearance: Vertical distance to obstacles, m.
        margin: Distance kept beyond both, m.

    Attributes:
        routes: With each clearance; the first is the smallest.
    """

    def __init__(
        self, scene: Scene, *, clearance: float, vertical_clearance: float, margin: float
    ) -> None:
        self._clearance = clearance
        self._deviations = scene.limits.uncertainty_margin
        self._step = MAX_MARGIN_RATIO * clearance / LEVELS  # m
        grows = self._deviations > 0 and clearance > 0 and bool(scene.world.obstacles)
        narrow = Routes(
            scene, clearance=clearance, vertical_clearance=vertical_clearance, margin=margin
        )
        self.routes = [narrow]
        for level in range(1, LEVELS + 1 if grows else 1):
            wider = Routes(
                scene,
                clearance=clearance + level * self._step,
                vertical_clearance=vertical_clearance,
                margin=margin,
                narrow=narrow,
            )
            self.routes.append(wider)
        n = len(scene.agents)
        self._target_level: Rows = np.zeros(n, np.int64)  # levels
        self._needed_at = np.full(n, -np.inf)  # s
        self._searched_level = np.zeros(n, np.int64)  # target when the present path was searched
        self._flown_level = np.zeros(n, np.int64)
        self._search_time = np.zeros(n)  # s

    def choose(self, estimate: Estimate) -> None:
        """Choose the level that each agent needs, by the covariance of its position."""
        if len(self.routes) == 1:
            return
        margin = position_margin(estimate.covariance, self._deviations, self._clearance)
        share = margin / self._step
        rises = share > self._target_level + RISE
        self._needed_at[share >= self._target_level - FALL] = estimate.time
        falls = estimate.time - self._needed_at > HOLD_TIME
        level = np.clip(np.ceil(share - RISE), 0, LEVELS).astype(np.int64)
        self._target_level = np.where(rises | falls, level, self._target_level)

    def by_target_level(self, rows: Mask) -> Iterator[tuple[Routes, Mask]]:
        """Yield routes and which of some rows, (N,), need their clearance."""
        yield from self._split(self._target_level, rows)

    def by_flown_level(self, rows: Mask) -> Iterator[tuple[Routes, Mask]]:
        """Yield routes and which of some rows, (N,), have a path with their clearance."""
        yield from self._split(self._flown_level, rows)

    def outdated(self, time: float) -> Mask:
        """Return which paths have another clearance than agents need at a time, s: (N,)."""
        missed = self._flown_level != self._target_level
        retried = missed & (time - self._search_time > RETRY_TIME)
        outdated: Mask = (self._searched_level != self._target_level) | retried
        return outdated

    def fly(self, row: int, level: int, time: float) -> None:
        """Note the level of an agent's new path."""
        self._flown_level[row], self._search_time[row] = level, time
        self._searched_level[row] = self._target_level[row]

    def search(
        self, row: int, position: Array, goal: Array, work: Work
    ) -> Generator[None, None, WidePath]:
        """Return the path of an agent, as `Routes.search`, and its level.

        Args:
            row: Of the agent.
            position: (3,) its position, m.
            goal: (3,) m.
            work: Budget; yields whenever it is used up.
        """
        target_level = int(self._target_level[row])
        shortest = yield from self.routes[0].search(position, goal, work)
        if isinstance(shortest, str):
            return shortest, 0
        limit = MAX_DETOUR * _length(position, shortest) + EXTRA_DETOUR
        for level in range(target_level, 0, -1):
            way = yield from self.routes[level].search(position, goal, work)
            if not isinstance(way, str) and _length(position, way) <= limit:
                return way, level
        return shortest, 0

    def _split(self, levels: Rows, rows: Mask) -> Iterator[tuple[Routes, Mask]]:
        if len(self.routes) == 1 or not levels.any():
            yield self.routes[0], rows
            return
        for level, routes in enumerate(self.routes):
            some = rows & (levels == level)
            if some.any():
                yield routes, some


def _length(position: Array, way: Array) -> float:
    """Return the length of a path from a position, m."""
    points = [position.tolist(), *way.tolist()]
    return sum(map(math.dist, points[:-1], points[1:]))
