"""Paths through a world from an agent's position to its goal, or the reason there is none."""

from __future__ import annotations

import math
import sys
from collections.abc import Generator, Iterable

import numpy as np

from star_core import Array, Fence, Mask, Scene
from star_visibility.escape import way_out
from star_visibility.line_of_sight import covered, sees
from star_visibility.network import Network, Work
from star_visibility.refusals import refusal
from star_visibility.regions import blocks, regions

SAME = 1e-9  # m; points nearer than this are equal
# m; an agent nearer than this to its goal, or horizontally to its start, has arrived
ARRIVAL_DISTANCE = 0.1
GRAZED = 0.02  # m: intrusion into the clearance at which an agent is led out


class Routes:
    """Finds paths through the world of a scene.

    A path keeps the clearances plus a margin, so that an agent that rounds a corner or deviates
    from its path a little is still clear. A position nearer to an obstacle than that is left, or
    reached, by the shortest segment.

    Goals nearer than the clearances are refused (`star_visibility.refusals`), except for: a
    tolerance of `GRAZED`, so that no goal that passed the mission's check is refused in flight;
    positions above a start, where agents take off and return to; and goals that an agent held
    before, see `allow_staying`.

    Args:
        scene: World and limits.
        clearance: Horizontal distance to keep to obstacles, m.
        vertical_clearance: Vertical distance to keep to obstacles, m.
        margin: Distance kept beyond both, m.
        narrow: Routes with a smaller clearance, if agents whose positions are uncertain keep more:
            its goals are accepted, and reached by a last segment that keeps its clearance. Paths
            turn as much farther inside the fence.

    Attributes:
        planned: Region that paths stay out of.
        kept: Region that agents stay out of: all points nearer than the clearances.
        shunned: Region that agents are led out of, slightly smaller: an avoider keeps them at the
            clearance, give or take a millimeter.
        solid: The obstacles themselves; the region that `narrow` keeps out of, if it is given.
        clearance: As above.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        clearance: float,
        vertical_clearance: float,
        margin: float,
        narrow: Routes | None = None,
    ) -> None:
        world = scene.world
        self._world = world
        self._starts = [agent.start for agent in scene.agents]
        self.clearance = clearance
        self._clearances = {"clearance": clearance, "vertical_clearance": vertical_clearance}
        # (3,) goals within the clearances at which agents were, m.
        self._stay_goals: list[Array] = []
        self._narrow = narrow
        fence = world.fence if narrow is None else shrunk(world.fence, clearance - narrow.clearance)
        low, high = scene.limits.height
        height = (max(low, world.fence.low[2]), min(high, world.fence.high[2]))
        self._height_fault = scene.height_fault
        self._low = np.array([*fence.low[:2], height[0]], np.float64)
        self._high = np.array([*fence.high[:2], height[1]], np.float64)
        avoided = blocks(world, height, clearance + margin, vertical_clearance + margin)
        self.planned = regions(avoided, height)
        self.kept = regions(blocks(world, height, clearance, vertical_clearance), height)
        grazed = (max(distance - GRAZED, 0.0) for distance in (clearance, vertical_clearance))
        self.shunned = regions(blocks(world, height, *grazed), height)
        self.solid = narrow.kept if narrow else regions(blocks(world, height, 0.0, 0.0), height)
        self._network = Network(avoided, self.planned, height, fence)
        covered(self.planned, *self._low)  # compiles it before take-off
        way_out(self.planned, self.kept, self._low, self._low, self._high)

    def allow_staying(self, position: Array, goal: Array) -> None:
        """Accept a goal within the clearances from now on if an agent is already there.

        An agent gets there without the planner: it starts or lands there, others push it there, or
        its estimate drifts. If it is sent to its current position, or straight up from the ground,
        it can hover there, and return if it is pushed away.

        Args:
            position: (3,) position of the agent when it receives the goal, m.
            goal: (3,) m.
        """
        if not covered(self.kept, *goal) or not sees(self.solid, position, goal):
            return
        on_the_ground = (
            position[2] < self._low[2] and math.dist(position[:2], goal[:2]) <= ARRIVAL_DISTANCE
        )
        stays = math.dist(position, goal) <= ARRIVAL_DISTANCE and covered(self.kept, *position)
        if (on_the_ground or stays) and not self._is_stay_goal(goal):
            self._stay_goals.append(goal.copy())

    def refusal(self, goal: Array) -> str | None:
        """Return why a goal, (3,) m, is refused, as in `refusal`; None if it is accepted."""
        if self._narrow is not None:
            return self._narrow.refusal(goal)
        if not covered(self.kept, *goal):
            return None
        granted = self._is_stay_goal(goal) or self._is_above_a_start(goal)
        if granted and not covered(self.solid, *goal):
            return None
        return refusal(self._world, _point(goal), **self._clearances, tolerance=GRAZED)

    def route(self, position: Array, goal: Array) -> Array | str:
        """Return the points of a path between two positions, or the reason there is none.

        An agent within the clearance of an obstacle is led out, unless it is at its goal or on the
        last segment to it. Positions inside an obstacle can be neither left nor reached.

        Args:
            position: (3,) position of the agent, m.
            goal: (3,) goal position, m.

        Returns:
            (K, 3) points after `position` up to and including `goal`, m; or the reason.
        """
        search = self.search(position, goal, Work(sys.maxsize))
        while True:
            try:
                next(search)
            except StopIteration as end:
                path: Array | str = end.value
                return path

    def search(
        self, position: Array, goal: Array, work: Work
    ) -> Generator[None, None, Array | str]:
        """As `route`, but yield whenever the work is used up."""
        if fault := self._fault(position, goal):
            return fault
        end = self._free(goal)
        if self._flies_in(position, goal, end):
            return goal[None]
        start = self._free(position)
        for leads, free in ((f"out from {_show(position)}", start), (f"to {_show(goal)}", end)):
            if not np.isfinite(free).all():
                return f"no path leads {leads}, too near to obstacles all around"
        way = yield from self._network.path(start, end, work)
        if way is None:
            return f"no path leads from {_show(position)} to {_show(goal)}"
        return _joined([position, *way, goal])

    def too_high_or_low(self, position: Array, goal: Array) -> Mask:
        """Return whether goals, (N, 3) m, are outside the flight heights: (N,).

        An agent that is at its goal may stay: the core returns it to the flight heights.
        """
        out = (goal[:, 2] < self._low[2] - SAME) | (goal[:, 2] > self._high[2] + SAME)
        answer: Mask = out & (((goal - position) ** 2).sum(axis=1) > ARRIVAL_DISTANCE**2)
        return answer

    def _fault(self, position: Array, goal: Array) -> str | None:
        """Return why no path can be searched; None if one can."""
        if self.too_high_or_low(position[None], goal[None])[0]:
            return f"cannot fly to {_show(goal)}: {self._height_fault(float(goal[2]))}"
        if reason := self.refusal(goal):
            return f"{_show(goal)} {reason}"
        if covered(self.solid, *position):
            nearest = min(
                self._world.obstacles, key=lambda obstacle: obstacle.gaps(_point(position))
            )
            return f"{_show(position)} is inside obstacle {nearest.name!r}"
        return None

    def _is_stay_goal(self, goal: Array) -> bool:
        return any(math.dist(other, goal) <= ARRIVAL_DISTANCE for other in self._stay_goals)

    def _is_above_a_start(self, goal: Array) -> bool:
        """Whether agents that take off straight up climb to a goal, or close to it."""
        return any(
            math.dist(start[:2], goal[:2]) <= ARRIVAL_DISTANCE
            and self._world.overhead(start, float(goal[2])) is None
            for start in self._starts
        )

    def _flies_in(self, position: Array, goal: Array, end: Array) -> bool:
        """Whether an agent flies straight to a goal that paths reach via `end`, (3,) m.

        It does if nothing is in between and it is at the goal, or as near to it as `end` is; also
        along an obstacle to which it and the goal are only a little too near.
        """
        near = covered(self.kept, *goal)
        if not sees(self.solid if near else self.kept, position, goal):
            return False
        away, reach = math.dist(position, goal), math.dist(end, goal)
        if away <= ARRIVAL_DISTANCE or away <= reach:
            return True
        if near:
            return covered(self.planned, *position) and sees(self.shunned, position, goal)
        return math.isnan(reach)  # enclosed, where only the margin is missing

    def _free(self, point: Array) -> Array:
        """Return the nearest position that paths can use, (3,) m; NaN if there is none."""
        if not covered(self.planned, *point):
            return point
        passable = self.solid if covered(self.kept, *point) else self.kept
        return way_out(self.planned, passable, point, self._low, self._high)


def shrunk(fence: Fence, margin: float) -> Fence:
    """Return a fence whose sides are moved in by a margin, m, as far as half of it remains.

    >>> shrunk(Fence((-1, -1, 0), (1, 1, 2)), 0.25).low
    (-0.75, -0.75, 0)
    """
    (x, y, low), (far_x, far_y, high) = fence.low, fence.high
    dx, dy = (min(margin, (end - begin) / 4) for begin, end in ((x, far_x), (y, far_y)))
    return Fence((x + dx, y + dy, low), (far_x - dx, far_y - dy, high))


def _joined(points: Iterable[Array]) -> Array:
    """Points of a path without its first, each once: (K, 3) m."""
    first, *others = points
    way = [first]
    for point in others:
        if math.dist(way[-1], point) > SAME:
            way.append(point)
    return np.array(way[1:] or others[-1:])


def _point(position: Array) -> tuple[float, float, float]:
    x, y, z = position.tolist()
    return x, y, z


def _show(point: Array) -> str:
    return "[" + ", ".join(f"{value:g}" for value in point) + "]"
