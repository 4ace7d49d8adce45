"""The agents of a step: their positions, and goals for them in whole-swarm tables."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np

from star_core import Array, Estimate, Goals, Rows, Scene
from star_core.toolkit import every, some, timeout

MAX_REST_SPEED = 0.15  # m/s: a slower agent has stopped, within the accuracy of its estimate
TIE_BREAK = 1e-6  # 1/m: cost of squared distances, which decides between equal totals
MAX_ENUMERATED = 4  # targets; so few need no scipy.optimize, which takes 0.3 s to import
CROSSES_ALONE = 4  # agents of a swarm that wait for no more than one other to cross the room
MAKES_WAY = 2.0  # times the tolerance by which an agent that has arrived may be moved aside
STUCK_TIME = 3.0  # s without `MIN_PROGRESS`, after which agents exchange their positions
MIN_PROGRESS = 0.05  # m, of all of them together
DURATION_ERROR = 1e-9  # s: rounding error of mission time, which is a sum of ticks


class StepAgents:
    """The agents of a step.

    Their tables have K rows, in the order of `rows`.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents in whole-swarm tables.

    Attributes:
        scene: The mission's scene.
        rows: (K,) rows of the agents in whole-swarm tables.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...]) -> None:
        self.scene = scene
        self.rows: Rows = np.array(rows, np.int64)
        self._arrived = np.zeros(len(rows), np.bool_)
        self._least = math.inf  # m, total distance so far, less than it by `MIN_PROGRESS`
        self._since = 0.0  # s, when that was

    def keep(self, rows: tuple[int, ...]) -> np.ndarray:
        """Remove all agents but some; return which of the K these are, (K,)."""
        kept = np.isin(self.rows, rows)
        self.rows = self.rows[kept]
        self._arrived = self._arrived[kept]
        return kept

    def replace(self, old: int, new: int) -> None:
        """Replace an agent by another."""
        self._arrived &= self.rows != old
        self._least = math.inf
        self.rows = np.where(self.rows == old, new, self.rows)

    def located(self, estimate: Estimate) -> bool:
        """Whether all of them are located."""
        return bool(estimate.valid[self.rows].all())

    def max_distance(self, estimate: Estimate, point: Array) -> float:
        """Return the greatest distance of an agent from its row of `point` (K, 3), m.

        An agent that is not located is infinitely far.
        """
        if not self.located(estimate):
            return math.inf
        away = estimate.position[self.rows] - point
        return math.sqrt(np.vecdot(away, away).max())

    def at_rest(self, estimate: Estimate) -> bool:
        """Whether all of them have stopped."""
        velocity = estimate.velocity[self.rows]
        return bool(np.vecdot(velocity, velocity).max() < MAX_REST_SPEED**2)

    def arrived(self, estimate: Estimate, point: Array, within: float) -> bool:
        """Whether all of them have stopped at their rows of `point` (K, 3), m; call it each tick.

        An agent that has arrived may then be up to `MAKES_WAY` times as far away: agents that make
        way for others, or whose estimates jump with each landmark, are hardly ever all in their
        positions at the same tick.

        Args:
            estimate: Of the tick.
            point: (K, 3) their positions, m; the same ones in every tick until `depart`.
            within: Distance at which an agent has arrived, m.
        """
        rows = self.rows
        away = estimate.position[rows] - point
        distance = np.sqrt(np.vecdot(away, away))
        distance[~estimate.valid[rows]] = np.inf
        near = distance <= within
        if some(near):
            velocity = estimate.velocity[rows]
            near &= np.vecdot(velocity, velocity) < MAX_REST_SPEED**2
        self._arrived &= distance <= MAKES_WAY * within
        self._arrived |= near
        return every(self._arrived)

    def depart(self) -> None:
        """Note that their positions change: none of them has arrived."""
        self._arrived[:] = False

    def exchanged(self, estimate: Estimate, point: Array, within: float) -> Array:
        """Return `point` (K, 3), its rows exchanged if the agents are stuck; call it each tick.

        An agent that was moved aside may be enclosed by others that have arrived. If all of them
        together come no nearer to their positions for `STUCK_TIME`, they get those with the least
        sum of squared distances, which shares a long way among agents with short ones (Turpin,
        Michael and Kumar, "CAPT: Concurrent assignment and planning of trajectories for multiple
        robots", IJRR 33(1), 2014).

        Args:
            estimate: Of the tick.
            point: (K, 3) their positions, m; those that it returned in the last tick.
            within: Distance at which an agent has arrived, m.
        """
        if len(point) == 1 or not self.located(estimate):
            return point
        position, time = estimate.position[self.rows], estimate.time
        distance = np.linalg.norm(position - point, axis=1)
        total = float(distance.sum())
        if distance.max() <= MAKES_WAY * within or total < self._least - MIN_PROGRESS:
            self._least, self._since = total, time
        if time - self._since < STUCK_TIME:
            return point
        self._least = math.inf
        order = assign(position, point, squares=True)
        if (order != np.arange(len(order))).any():
            self.depart()
        return point[order]

    def travel_distance(self, estimate: Estimate, point: Array | None) -> float:
        """Return the longest distance to `point` (K, 3), m; if unknown, the fence's diagonal."""
        fence = self.scene.world.fence
        far = math.inf if point is None else self.max_distance(estimate, point)
        return min(far, math.dist(fence.low, fence.high))

    def timeout(self, expected: float) -> float:
        """Return the timeout of a flight that takes `expected` seconds if nothing delays it, s.

        In a swarm an agent may also have to wait until another has crossed the room, however short
        its own way is; and in a large one for several, one after the other, as many as fit across
        the swarm.
        """
        fence, limits = self.scene.world.fence, self.scene.limits
        n = len(self.scene.agents)
        crossing = 0.0 if n == 1 else math.dist(fence.low, fence.high) / limits.speed
        return timeout(expected) + crossing * max(1.0, math.sqrt(n / CROSSES_ALONE))

    def goals(
        self,
        position: Array,
        yaw: Array,
        speed: float,
        velocity: Array | None = None,
        acceleration: Array | None = None,
        yaw_rate: Array | None = None,
    ) -> Goals:
        """Return goals for the whole swarm, active for these agents.

        Args:
            position: (K, 3) m.
            yaw: (K,) rad.
            speed: Speed limit on the way, m/s.
            velocity: (K, 3) feed-forward, m/s; zero if not given.
            acceleration: (K, 3) of goals along known trajectories, m/s².
            yaw_rate: (K,) likewise, rad/s.
        """
        n = len(self.scene.agents)
        positions, velocities, yaws = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n)
        active = np.zeros(n, np.bool_)
        active[self.rows] = True
        positions[self.rows] = position
        yaws[self.rows] = yaw
        if velocity is not None:
            velocities[self.rows] = velocity
        return Goals(
            positions,
            velocities,
            yaws,
            np.full(n, speed),
            active,
            self._of_all(acceleration),
            self._of_all(yaw_rate),
        )

    def _of_all(self, values: Array | None) -> Array | None:
        """Return (K, ...) values in a column of the whole swarm, NaN for the others."""
        if values is None:
            return None
        column = np.full((len(self.scene.agents), *values.shape[1:]), np.nan)
        column[self.rows] = values
        return column


def assign(position: Array, target: Array, *, squares: bool = False) -> Rows:
    """Return the target of each agent, so that the total distance flown is minimal.

    Straight paths of minimal total length do not cross: uncrossing two paths shortens them, by the
    triangle inequality. Of assignments with equal totals, the one with the smallest sum of squares
    is taken, so that agents in a row do not overtake each other.

    Args:
        position: (K, 3) positions of the agents, m.
        target: (P, 3) available positions, one agent each, m; at least K of them.
        squares: Whether the sum of the squared distances is minimal instead.

    Returns:
        (K,) row in `target` for each row in `position`.

    Example:
        >>> assign(np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([[1.1, 0, 0], [0.1, 0, 0]]))
        array([1, 0])
    """
    offset = position[:, None] - target[None, :]  # (K, P, 3)
    distance = np.sqrt((offset**2).sum(axis=2))
    cost = distance**2 if squares else distance + TIE_BREAK * distance**2
    rows = np.arange(len(cost))
    if len(target) <= MAX_ENUMERATED:
        orders = [np.array(order, np.intp) for order in permutations(range(len(target)), len(cost))]
        return min(orders, key=lambda order: float(cost[rows, order].sum()))
    from scipy.optimize import linear_sum_assignment

    target_of: Rows = linear_sum_assignment(cost)[1]
    return target_of


def import_assignment(agents: int) -> None:
    """Import what `assign` needs for so many agents; call it while they are on the ground."""
    if agents > MAX_ENUMERATED:
        import scipy.optimize  # noqa: F401


def lag_factor(lag: float, slow: float, stop: float) -> float:
    """Return the share of its pace at which a moving goal goes on when an agent lags behind it.

    Args:
        lag: Distance of the agent farthest behind, m.
        slow: Lag from which on the goal slows down, m.
        stop: Lag at which it stops, m.

    Example:
        >>> lag_factor(0.2, 0.3, 0.6), lag_factor(0.45, 0.25, 0.65), lag_factor(math.inf, 0.3, 0.6)
        (1.0, 0.5, 0.0)
    """
    return min(max((stop - lag) / (stop - slow), 0.0), 1.0)
