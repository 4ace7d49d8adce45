"""Paths through a world from wherever an agent is to wherever it is sent, or why there is none."""

from __future__ import annotations

import math
import sys
from collections.abc import Generator, Iterable, Iterator

import numpy as np
import shapely

from star_core import Array, Mask, Scene, footprint
from star_visibility.escape import way_out
from star_visibility.network import Network, Work
from star_visibility.sight import covered, sees
from star_visibility.walls import blocks, walls

SAME = 1e-9  # m; points nearer than this are one
THERE = 0.1  # m; an agent nearer than this to its goal is there, and may stay
GRAZED = 0.02  # m: so much nearer than the clearance an agent may fly before it is led out


class Routes:
    """Finds paths through the world of a scene.

    A path keeps to the clearances and a margin more, so that an agent that rounds a corner or is a
    little off its path is still clear. A place that is nearer to an obstacle than that is left, or
    come to, by the shortest way.

    Args:
        scene: World and limits.
        clearance: Distance to keep beside obstacles, m.
        vertical_clearance: Distance to keep above and below obstacles, m.
        margin: What paths keep beyond both, m.

    Attributes:
        planned: What paths stay out of.
        kept: What agents stay out of: all that is nearer than the clearances.
        shunned: What they are led out of, a little less: an avoider holds them at the clearance, by
            a millimetre on this side or on that.
    """

    def __init__(
        self, scene: Scene, *, clearance: float, vertical_clearance: float, margin: float
    ) -> None:
        world = scene.world
        self._world = world
        self._clearance = clearance
        self._vertical_clearance = vertical_clearance
        low, high = scene.limits.height
        height = (max(low, world.fence.low[2]), min(high, world.fence.high[2]))
        self._height_fault = scene.height_fault
        self._low = np.array([*world.fence.low[:2], height[0]], np.float64)
        self._high = np.array([*world.fence.high[:2], height[1]], np.float64)
        avoided = blocks(world, height, clearance + margin, vertical_clearance + margin)
        self.planned = walls(avoided, height)
        self.kept = walls(blocks(world, height, clearance, vertical_clearance), height)
        grazed = (max(one - GRAZED, 0.0) for one in (clearance, vertical_clearance))
        self.shunned = walls(blocks(world, height, *grazed), height)
        self._solid = walls(blocks(world, height, 0.0, 0.0), height)
        self._network = Network(avoided, self.planned, height, world.fence)
        covered(self.planned, *self._low)  # compiled before anybody flies
        way_out(self.planned, self.kept, self._low, self._low, self._high)

    def route(self, here: Array, goal: Array) -> Array | str:
        """Return the points of a path from one place to another, or say why there is none.

        An agent within the clearance of an obstacle is led out, unless it is there already and is
        to stay. No place inside an obstacle can be left, and none within the clearance be come to.

        Args:
            here: (3,) where the agent is, m.
            goal: (3,) where it is to be, m.

        Returns:
            (K, 3) points after `here` up to and with `goal`, m; or the reason in words.
        """
        search = self.search(here, goal, Work(sys.maxsize))
        while True:
            try:
                next(search)
            except StopIteration as end:
                found: Array | str = end.value
                return found

    def search(self, here: Array, goal: Array, work: Work) -> Generator[None, None, Array | str]:
        """Do as `route` does, but yield whenever the work is used up."""
        if math.dist(here, goal) <= THERE and self._may_stay(here, goal):
            return goal[None]
        if self.too_high_or_low(here[None], goal[None])[0]:
            return f"nobody flies to {_show(goal)}: {self._height_fault(float(goal[2]))}"
        start = self._left(here)
        if isinstance(start, str):
            return start
        end = self._come_to(goal)
        if isinstance(end, str):
            return end
        way = yield from self._network.path(start, end, work)
        if way is None:
            return f"no way leads from {_show(here)} to {_show(goal)}"
        return _joined([here, *way, goal])

    def too_high_or_low(self, here: Array, goal: Array) -> Mask:
        """Return whether goals, (N, 3) m, are outside the heights to fly at: (N,).

        An agent that is at its goal may stay: the core brings it back to the heights.
        """
        out = (goal[:, 2] < self._low[2] - SAME) | (goal[:, 2] > self._high[2] + SAME)
        answer: Mask = out & (((goal - here) ** 2).sum(axis=1) > THERE**2)
        return answer

    def _may_stay(self, here: Array, goal: Array) -> bool:
        """Whether an agent at its goal is within the clearance of an obstacle, but in none."""
        near = covered(self.kept, *here) and not covered(self._solid, *here)
        return near and sees(self._solid, here, goal)

    def _left(self, here: Array) -> Array | str:
        """Where paths from `here` begin, or why none do."""
        if not covered(self.planned, *here):
            return here
        if covered(self._solid, *here):
            return f"{_show(here)} is {self._place(here)}"
        passable = self._solid if covered(self.kept, *here) else self.kept
        out = way_out(self.planned, passable, here, self._low, self._high)
        if not np.isfinite(out).all():
            return f"no way leads out from {_show(here)}, {self._place(here)}"
        return out

    def _come_to(self, goal: Array) -> Array | str:
        """Where paths to `goal` end, or why none do."""
        if not covered(self.planned, *goal):
            return goal
        if covered(self.kept, *goal):
            return f"{_show(goal)} is {self._place(goal)}"
        out = way_out(self.planned, self.kept, goal, self._low, self._high)
        if not np.isfinite(out).all():
            return f"no way leads to {_show(goal)}, too near to obstacles all around"
        return out

    def _place(self, point: Array) -> str:
        x, y, z = point.tolist()
        for obstacle in self._world.obstacles:
            if obstacle.contains((x, y, z)):
                return f"inside obstacle {obstacle.name!r}"
        beside, _, name = min(self._gaps(x, y, z))
        which, kept = (
            ("", self._clearance) if beside > 0 else ("vertical ", self._vertical_clearance)
        )
        return f"within the {which}clearance of {kept:g} m of obstacle {name!r}"

    def _gaps(self, x: float, y: float, z: float) -> Iterator[tuple[float, float, str]]:
        """How far a point is beside and above or below obstacles that are near in height, m."""
        for obstacle in self._world.obstacles:
            foot, top = obstacle.height
            above = max(foot - z, z - top, 0.0)
            if above <= self._vertical_clearance:
                ground = footprint([obstacle], -math.inf, math.inf)
                yield float(ground.distance(shapely.Point(x, y))), above, obstacle.name


def _joined(points: Iterable[Array]) -> Array:
    """Points of a path without its first, each once: (K, 3) m."""
    first, *others = points
    way = [first]
    for point in others:
        if math.dist(way[-1], point) > SAME:
            way.append(point)
    return np.array(way[1:] or others[-1:])


def _show(point: Array) -> str:
    return "[" + ", ".join(f"{value:g}" for value in point) + "]"
