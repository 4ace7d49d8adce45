"""The current paths of the agents, and the points along them that agents steer to."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Paths, Rows
from star_core.toolkit import compiled, subroutine
from star_visibility.line_of_sight import covered, sees
from star_visibility.regions import Regions

SHARP = 1e-6  # rad; a smaller angle is not a turn


class TrackedPaths:
    """Paths of a whole swarm.

    Args:
        n: Number of agents.
        look_ahead: Length over which a corner is rounded, m.
        acceleration: Greatest acceleration in turns, m/s².

    Attributes:
        path: (N, M, 3) points of each path, without its start, m.
        count: (N,) their numbers; 0 for none.
        leg: (N,) index of the point that the agent flies to.
        rest: (N, M) remaining length of the path beyond each point, m.
        pace: (N, M) speed limit there, m/s.
        start: (N, 3) position of the agent when its path was last requested, m; NaN if never.
        goal: (N, 3) goal for which it was requested, m; NaN if never.
        fault: Why there is no path, by row.
    """

    def __init__(self, n: int, *, look_ahead: float, acceleration: float) -> None:
        self._look_ahead = look_ahead
        self._acceleration = acceleration
        self.path: Array = np.zeros((n, 8, 3))
        self.count: Rows = np.zeros(n, np.int64)
        self.leg: Rows = np.zeros(n, np.int64)
        self.rest: Array = np.zeros((n, 8))
        self.pace: Array = np.zeros((n, 8))
        self.start: Array = np.full((n, 3), np.nan)
        self.goal: Array = np.full((n, 3), np.nan)
        self.fault: dict[int, str] = {}

    def forget(self, rows: Mask) -> None:
        """Clear the paths of some agents."""
        self.count[rows] = 0
        self.start[rows] = self.goal[rows] = np.nan
        for row in [row for row in self.fault if rows[row]]:
            del self.fault[row]

    def put(self, row: int, start: Array, goal: Array, result: Array | str) -> None:
        """Store the result of a search for an agent: (K, 3) points, m, or why there is no path."""
        self.start[row], self.goal[row] = start, goal
        self.leg[row] = self.count[row] = 0
        self.fault.pop(row, None)
        if isinstance(result, str):
            self.fault[row] = result
            return
        k = len(result)
        while k > self.path.shape[1]:
            self.path = np.concatenate([self.path, np.zeros_like(self.path)], axis=1)
            self.rest = np.concatenate([self.rest, np.zeros_like(self.rest)], axis=1)
            self.pace = np.concatenate([self.pace, np.zeros_like(self.pace)], axis=1)
        stretch = np.diff(np.vstack([start, result]), axis=0)
        length = np.sqrt((stretch**2).sum(axis=1))
        self.count[row] = k
        self.path[row, :k] = result
        self.rest[row, :k] = length.sum() - np.cumsum(length)
        self.pace[row, :k] = self._paces(stretch, length)

    def aim(self, rows: Mask, goal: Array) -> None:
        """Move the ends of some paths to `goal` (N, 3), m, which is close to them."""
        self.path[rows, self.count[rows] - 1] = goal[rows]

    def left(self, position: Array) -> tuple[Array, Array]:
        """Return (N,) the remaining length of each path, m, and (N,) its speed limit, m/s.

        The speed limit is such that the agent, braking as it does at a goal, is slow enough at the
        next corner.
        """
        every = np.arange(len(position))
        corner = self.path[every, self.leg]
        away = np.sqrt(((corner - position) ** 2).sum(axis=1))
        pace = self.pace[every, self.leg]
        return away + self.rest[every, self.leg], np.sqrt(pace**2 + 2 * self._acceleration * away)

    def paths(self, position: Array, direct: Mask, goal: Array, on: Mask) -> Paths:
        """Return the remaining paths: straight to the goal if `direct`, the path if `on`."""
        n, m = self.count.shape[0], self.path.shape[1]
        point = np.concatenate([position[:, None], self.path], axis=1)
        index = np.arange(1, m + 1)
        shown = np.zeros((n, m + 1), np.bool_)
        shown[:, 0] = direct | on
        shown[:, 1:] = on[:, None] & (index > self.leg[:, None]) & (index <= self.count[:, None])
        point[direct, 1], shown[direct, 1] = goal[direct], True
        return Paths(agent=np.nonzero(shown)[0], point=point[shown])

    def _paces(self, stretch: Array, length: Array) -> Array:
        """(K,) speed limit at each point.

        A path that turns by an angle within `look_ahead` is rounded to an arc of that length, which
        requires the acceleration v² angle / length. The agent brakes in time for slower points.
        """
        k = len(length)
        along = stretch / np.maximum(length, SHARP)[:, None]
        turn = np.arccos(np.clip((along[1:] * along[:-1]).sum(axis=1), -1.0, 1.0))  # (K - 1,)
        at = np.cumsum(length)
        pace = np.full(k, math.inf)
        pace[-1] = 0.0
        for i in range(k - 2, -1, -1):
            angle = float(turn[i:][at[i:-1] <= at[i] + self._look_ahead].sum())
            arc = math.sqrt(self._acceleration * self._look_ahead / max(angle, SHARP))
            pace[i] = min(arc, math.sqrt(pace[i + 1] ** 2 + 2 * self._acceleration * length[i + 1]))
        return pace


MAX_TRIES = 5  # lookahead points tried, each nearer to the next corner than the one before
ASTRAY = 0.1  # m farther from the exit point than before: the agent was pushed away
ENTERED = 0.05  # m from the beginning of the last segment: the agent is on that segment


@compiled
def steer(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    planned: Regions,
    kept: Regions,
    shunned: Regions,
    solid: Regions,
    position: Array,
    rows: Rows,
    start: Array,
    path: Array,
    count: Rows,
    leg: Rows,
    look_ahead: float,
) -> tuple[Array, Mask]:
    """Return each agent's lookahead point, and whether it lost sight of its path; advance its leg.

    It is the point of the path `look_ahead` ahead along the path, or nearer if that point
    is not visible: so the line to it is free, and its direction changes evenly as the agent comes
    to a corner. An agent inside the avoided region flies to the first point of a path that begins
    there, which leads out. It has lost its path if it has none, is past that point, or is pushed
    away from it. An agent that only enters the edge of the kept region may continue, also without
    sight of the first point of a path that begins there. An agent past a corner may thus use the
    distance by which paths exceed the kept region. A goal within the kept region is reached by the
    last segment of its path, which only obstacles block.

    Args:
        planned: Region that paths stay out of: agents that see past a corner without it skip it.
        kept: Region that lines must not cross.
        shunned: The same for lines that begin inside the first: most of it.
        solid: Obstacles.
        position: (N, 3) positions of the agents, m.
        rows: Rows to process.
        start: (N, 3) positions from which their paths were planned, m.
        path: (N, M, 3) remaining points when the path was planned, m.
        count: (N,) their numbers.
        leg: (N,) index of the point that each agent flies to; updated.
        look_ahead: Distance of that point along the path, m.

    Returns:
        (N, 3) points, m, 0 in other rows; and (N,) True where the next point of the path is hidden.
    """
    target = np.zeros(position.shape)
    lost = np.zeros(len(position), np.bool_)
    for i in rows:
        at, last, region = position[i], count[i] - 1, kept
        goal = path[i, last]
        if covered(kept, goal[0], goal[1], goal[2]) and _enters(
            solid, start[i], path[i], leg[i], last, at
        ):
            leg[i] = last
            _put(target, i, goal)
            continue
        grazes = covered(kept, at[0], at[1], at[2])
        if grazes:
            region = shunned
        if grazes and covered(shunned, at[0], at[1], at[2]):
            _put(target, i, path[i, leg[i]])
            lost[i] = leg[i] > 0 or not _leads_out(region, start[i], path[i, 0], at)
            continue
        while leg[i] < last and (
            sees(planned, at, path[i, leg[i] + 1]) or _is_past(region, at, path[i], leg[i])
        ):
            leg[i] += 1
        corner = path[i, leg[i]]
        if not sees(region, at, corner):
            _put(target, i, corner)
            lost[i] = leg[i] > 0 or not grazes or not _leads_out(kept, start[i], corner, at)
            continue
        _put(target, i, corner)
        room = look_ahead - _apart(at, corner)
        if room <= 0.0 or leg[i] == last:
            continue
        for k in range(MAX_TRIES):
            point = _along(path[i], leg[i], last, room * (MAX_TRIES - k) / MAX_TRIES)
            if sees(region, at, point):
                _put(target, i, point)
                break
    return target, lost


@subroutine
def _put(table: Array, row: int, point: Array) -> None:
    """Write a point into a table, element by element, which compiles seconds faster."""
    for k in range(3):
        table[row, k] = point[k]


@subroutine
def _leads_out(region: Regions, start: Array, out: Array, at: Array) -> bool:
    """Whether a path's first point is the exit from the region, and still is from `at`."""
    begins_within = covered(region, start[0], start[1], start[2])
    return begins_within and _apart(at, out) <= _apart(start, out) + ASTRAY


@subroutine
def _enters(region: Regions, start: Array, path: Array, leg: int, last: int, at: Array) -> bool:
    """Whether an agent is on the last segment of its path, or at its beginning."""
    if leg < last - 1:
        return False
    goal = path[last]
    stretch = _apart(path[last - 1] if last > 0 else start, goal)
    most = stretch + (ASTRAY if leg == last else ENTERED)
    return _apart(at, goal) <= most and sees(region, at, goal)


@subroutine
def _is_past(region: Regions, at: Array, path: Array, leg: int) -> bool:
    """Whether an agent has rounded a corner, close to it or as far off as others pushed it."""
    corner, following = path[leg], path[leg + 1]
    past = 0.0
    for k in range(3):
        past += (at[k] - corner[k]) * (following[k] - corner[k])
    if past < -1e-9:  # noqa: PLR2004 -- m²: it is at the corner
        return False
    return sees(region, at, following)


@subroutine
def _along(path: Array, leg: int, last: int, distance: float) -> Array:
    """Return the point of a path at a distance beyond one of its corners."""
    while leg < last:
        stretch = _apart(path[leg], path[leg + 1])
        if stretch >= distance:
            point = np.empty(3)
            for k in range(3):
                point[k] = path[leg, k] + (path[leg + 1, k] - path[leg, k]) * distance / stretch
            return point
        distance -= stretch
        leg += 1
    end: Array = path[last].copy()
    return end


@subroutine
def _apart(a: Array, b: Array) -> float:
    """Return the distance between two points, m."""
    return math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
