"""Conflicts between agents: collisions and close approaches, waits and deadlocks."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from star_core.geometry.neighbours import Pairs
from star_core.messages.arrays import Array, Mask, some
from star_core.messages.events import Event, Tick
from star_core.messages.state import AIRBORNE, AgentPhase, Paths, among
from star_core.scene import Scene
from star_core.world.world import CONTACT_RADIUS

HYSTERESIS: Final = 0.02  # m beyond the limit at which a close approach is over
COLLISION_DISTANCE: Final = 2 * CONTACT_RADIUS  # m between two agents
MAX_WAIT: Final = 5.0  # s without progress
MIN_PROGRESS: Final = 0.05  # m closer to the goal than before, or than `RECENT` s ago
SAMPLE_PERIOD: Final = 0.25  # s
RECENT: Final = 1.0  # s; an agent that got closer since then is moving
ARRIVED: Final = 0.3  # m; no deadlock this close to the goal, where agents queue for a tight spot
WAITING_DISTANCE: Final = 1.5
"""Distance within which an agent can wait for another, m: two that meet at 0.5 m/s need it
to react, to brake and to let one pass. An unrelated agent that progresses moves away, after which
the deadlock is counted."""


@dataclass(slots=True)
class _Approach:
    """A close approach that is not over.

    Attributes:
        closest: Shortest flattened distance so far, m.
        distance: Distance at that time, m.
        time: Of that distance, s.
        position: (3,) middle between the two then, m.
        collided: Whether the two have collided since it began.
    """

    closest: float = np.inf
    distance: float = np.inf
    time: float = 0.0
    position: Array = field(default_factory=lambda: np.zeros(3))
    collided: bool = False


class Contacts:
    """Follows the distances between agents and to obstacles, tick by tick.

    Distances are between ground-truth positions at ticks that have them, otherwise between
    estimated positions. Two agents collide when their centers are nearer than twice
    `CONTACT_RADIUS`; an agent collides with an obstacle nearer than `CONTACT_RADIUS`. A contact
    that lasts is one collision. Close approaches are inside of the ellipsoid of the separations:
    flattened distances, whose heights are multiplied by the ratio of its semi-axes, are below
    ``limits.separation``. All other distances are plain ones.

    Args:
        scene: Agents, obstacles and separations.

    Attributes:
        agent_agent: Number of collisions between two agents.
        agent_obstacle: Number of collisions of an agent with an obstacle.
        separation: Smallest distance between two agents so far, m; infinite if there are no two.
        clearance: Smallest distance of an agent to an obstacle so far, m; infinite if there are
            none.
    """

    def __init__(self, scene: Scene) -> None:
        self._names = scene.names
        self._obstacles = scene.world.obstacles
        self._limit = scene.limits.separation
        self._vertical = scene.limits.vertical_separation
        self._flat = np.array([1.0, 1.0, self._limit / self._vertical])
        self._touching: set[tuple[int, int]] = set()
        self._hitting = np.zeros(len(self._names), np.bool_)
        self._approaches: dict[tuple[int, int], _Approach] = {}
        self._sources = {"ground_truth": 0, "estimate": 0}  # ticks with an agent in the air
        self._source = "estimate"  # of the tick
        self._time = 0.0  # s, of the tick
        self.agent_agent = 0
        self.agent_obstacle = 0
        self.separation = np.inf
        self.clearance = np.inf

    @property
    def reach(self) -> float:
        """Distance within which two agents may be in conflict or at their closest so far, m."""
        widest = max(self._limit, self._vertical) if self._limit > 0.0 else 0.0
        return max(self.separation, COLLISION_DISTANCE, widest + HYSTERESIS)

    @property
    def source(self) -> str:
        """What distances were computed from in flight: ``ground_truth``, ``estimate``, ``mixed``.

        Before the first take-off it is what the newest tick has.
        """
        used = [name for name, ticks in self._sources.items() if ticks]
        return "mixed" if len(used) > 1 else used[0] if used else self._source

    def update(self, tick: Tick, near: Pairs) -> list[Event]:
        """Return the collisions that begin at a tick, and the close approaches that are over.

        Args:
            tick: Of the flight.
            near: Pairs of agents within `reach`, at least, by the positions that are used.
        """
        known = tick.estimate if tick.truth is None else tick.truth
        airborne = among(tick.health.phase, *AIRBORNE)
        self._time = tick.time
        self._source = "estimate" if tick.truth is None else "ground_truth"
        self._sources[self._source] += some(airborne)
        return [
            *self._between_agents(near, known.position, known.velocity, airborne),
            *self._with_obstacles(known.position, known.velocity),
        ]

    def finish(self) -> list[Event]:
        """Return the close approaches that are not over when the flight ends."""
        open_ones, self._approaches = self._approaches, {}
        return [self._over(pair, one) for pair, one in open_ones.items() if not one.collided]

    def _between_agents(
        self, near: Pairs, position: Array, velocity: Array, airborne: Mask
    ) -> list[Event]:
        """Compare (N, 3) positions, m, of agents with (N, 3) velocities, m/s."""
        self.separation = min(self.separation, min(near.distance.tolist(), default=np.inf))
        near = near.within(self.reach)
        if not len(near.first):
            self._touching.clear()
            return self.finish()
        offset = self._flat * (position[near.first] - position[near.second])
        flattened = np.sqrt(np.vecdot(offset, offset))
        close = (flattened <= self._limit + HYSTERESIS) | (near.distance < COLLISION_DISTANCE)
        near, flattened = near.where(close), flattened[close]
        if not len(near.first):
            self._touching.clear()
            return self.finish()
        events = []
        rows = [*zip(near.first.tolist(), near.second.tolist(), strict=True)]
        distances = dict(zip(rows, near.distance.tolist(), strict=True))
        touching = {pair for pair, away in distances.items() if away < COLLISION_DISTANCE}
        for pair in sorted(touching - self._touching):
            self.agent_agent += 1
            a, b = pair
            middle, relative = (position[a] + position[b]) / 2, velocity[a] - velocity[b]
            names = [self._names[a], self._names[b]]
            events.append(self._collision(names, None, middle, relative))
        self._touching = touching
        inside = dict(zip(rows, flattened.tolist(), strict=True))
        return events + self._approached(inside, touching, position, airborne)

    def _approached(
        self,
        near: Mapping[tuple[int, int], float],
        touching: set[tuple[int, int]],
        position: Array,
        airborne: Mask,
    ) -> list[Event]:
        """Follow the pairs within the ellipsoid; return those that have left it."""
        for pair, away in near.items():
            a, b = pair
            if away < self._limit and (airborne[a] or airborne[b]):
                self._approaches.setdefault(pair, _Approach())
            if (one := self._approaches.get(pair)) is None:
                continue
            one.collided |= pair in touching
            if away < one.closest:
                one.closest, one.time = away, self._time
                one.distance = math.dist(position[a], position[b])
                one.position = (position[a] + position[b]) / 2
        parted = [
            pair for pair in self._approaches if near.get(pair, np.inf) > self._limit + HYSTERESIS
        ]
        over = [(pair, self._approaches.pop(pair)) for pair in parted]
        return [self._over(pair, one) for pair, one in over if not one.collided]

    def _with_obstacles(self, position: Array, velocity: Array) -> list[Event]:
        """Compare (N, 3) positions, m, with the obstacles."""
        if not self._obstacles:
            return []
        clearances = np.array([one.distances(position) for one in self._obstacles])  # (K, N)
        clearances[~np.isfinite(clearances)] = np.inf  # an unknown position touches nothing
        clearance = clearances.min(axis=0)
        hitting = clearance < CONTACT_RADIUS
        events = []
        for row in np.flatnonzero(hitting & ~self._hitting).tolist():
            obstacle = self._obstacles[int(clearances[:, row].argmin())].name
            names = [self._names[row]]
            events.append(self._collision(names, obstacle, position[row], velocity[row]))
        self.agent_obstacle += len(events)
        self._hitting = hitting
        self.clearance = min(self.clearance, float(clearance.min()))
        return events

    def _collision(
        self, names: list[str], obstacle: str | None, position: Array, velocity: Array
    ) -> Event:
        speed = float(np.linalg.norm(velocity))
        details: dict[str, Any] = {
            "agents": names,
            **({} if obstacle is None else {"obstacle": obstacle}),
            "time_s": self._time,
            "position_m": position.tolist(),
            **({"relative_speed_m_s": speed} if np.isfinite(speed) else {}),
            "from": self._source,
        }
        what = " and ".join(names) if obstacle is None else f"{names[0]} and obstacle {obstacle!r}"
        fast = f", relative speed {speed:.2f} m/s" if np.isfinite(speed) else ""
        text = f"{what} collided at {_point(position)}{fast}{self._source_note()}"
        return Event(self._time, "collision", text, details=details)

    def _over(self, pair: tuple[int, int], one: _Approach) -> Event:
        names = [self._names[row] for row in pair]
        details = {
            "agents": names,
            "time_s": one.time,
            "position_m": one.position.tolist(),
            "distance_m": one.distance,
            "from": self._source,
        }
        text = (
            f"{names[0]} and {names[1]} came within {one.distance:.2f} m of each other at "
            f"{one.time:.2f} s, closer than limits.separation ({self._limit:g} m) and "
            f"vertical_separation ({self._vertical:g} m) permit"
            f"{self._source_note()}"
        )
        return Event(self._time, "close_approach", text, details=details)

    def _source_note(self) -> str:
        return " (estimated positions)" if self._source == "estimate" else ""


def _point(position: Array) -> str:
    return "[" + ", ".join(f"{value:.2f}" for value in position) + "]"


class Deadlocks:
    """Counts agents that make no progress: all as waits, and some of them as deadlocks.

    An agent waits if it has not arrived and got no closer to its goal for `MAX_WAIT`, measured
    along the rest of its planned path. Agents whose goals move are not considered.

    It waits for the agents ahead of it, within `WAITING_DISTANCE`, and transitively for those that
    these wait for. While any of them has progressed within `MAX_WAIT`, or is moving to its goal,
    the wait can end: a queue, or an agent that gave way and comes back. Otherwise it is a deadlock:
    no active agent can be reached in the wait-for graph. An agent that stands still with no agent
    ahead, or only with agents that have arrived, is in a deadlock too; so is one that moves back
    and forth, at its next turn.

    Args:
        agents: Number of agents.

    Attributes:
        waits: Number of waits; one ends when the agent progresses.
        count: Number of waits that became deadlocks.
    """

    def __init__(self, agents: int) -> None:
        self.waits = 0
        self.count = 0
        self._goal = np.full((agents, 3), np.nan)
        self._best = np.full(agents, np.inf)  # m, least remaining distance so far
        self._recent: deque[Array] = deque(maxlen=round(RECENT / SAMPLE_PERIOD))  # m, remaining
        self._since = np.zeros(agents)  # s, of the last progress
        self._waits = np.zeros(agents, np.bool_)  # has been counted
        self._deadlocked = np.zeros(agents, np.bool_)  # has been counted
        self._due = -np.inf  # s, time of the next sample

    def add(self, tick: Tick, near: Pairs) -> None:
        """Count the waits and deadlocks that begin at a tick.

        Args:
            tick: Of the flight.
            near: Pairs of agents within `WAITING_DISTANCE`, at least, by estimated positions.
        """
        if tick.time < self._due:
            return
        self._due = tick.time + SAMPLE_PERIOD
        goals = tick.goals
        flies = goals.active & (tick.health.phase == int(AgentPhase.FLYING))
        goal = np.where(flies[:, None], goals.position, np.nan)
        new = ~(goal == self._goal).all(axis=1)
        self._goal = goal
        remaining = remaining_distance(tick.estimate.position, goals.position, tick.plan.paths)
        better = new | ~(remaining > self._best - MIN_PROGRESS)
        self._best = np.where(better, remaining, self._best)
        self._since = np.where(better, tick.time, self._since)
        patient = tick.time - self._since <= MAX_WAIT
        progressing = (
            flies & (patient | (remaining < self._recent[0] - MIN_PROGRESS))
            if self._recent
            else flies
        )
        self._recent.append(remaining)
        stuck = flies & ~patient & (remaining > ARRIVED)
        self.waits += int((stuck & ~self._waits).sum())
        self._waits = (self._waits | stuck) & ~better
        if stuck.any():
            wanted = tick.plan.setpoint.velocity
            near = near.within(WAITING_DISTANCE)
            stuck &= ~waiting(near, tick.estimate.position, wanted, progressing)
        self.count += int((stuck & ~self._deadlocked).sum())
        self._deadlocked = (self._deadlocked | stuck) & ~better


def waiting(near: Pairs, position: Array, wanted: Array, progressing: Mask) -> Mask:
    """Return (N,) which agents progress, or wait (transitively) for one that does.

    Args:
        near: Pairs of agents that can wait for each other.
        position: (N, 3) of the agents, m.
        wanted: (N, 3) planned velocities, m/s.
        progressing: (N,) which agents progress.

    Example:
        >>> queue = np.array([[0.0, 0, 0], [0.5, 0, 0], [1, 0, 0]])
        >>> near = Pairs.of(queue, WAITING_DISTANCE)
        >>> waiting(near, queue, np.array([[1.0, 0, 0]] * 3), np.array([False, False, True]))
        array([ True,  True,  True])
        >>> waiting(near, queue, np.array([[1.0, 0, 0]] * 3), np.array([True, False, False]))
        array([ True, False, False])
    """
    first, second = near.first, near.second
    waits, ahead = np.concatenate([first, second]), np.concatenate([second, first])
    towards = np.vecdot(position[ahead] - position[waits], wanted[waits]) > 0
    waits, ahead = waits[towards], ahead[towards]
    answer = progressing.copy()
    while (more := answer[ahead] & ~answer[waits]).any():
        answer[waits[more]] = True
    return answer


def remaining_distance(position: Array, goal: Array, paths: Paths) -> Array:
    """Return the distances to goals along planned paths, or straight where none is planned.

    Args:
        position: (N, 3) of the agents, m.
        goal: (N, 3) of the agents, m.
        paths: The points of each agent's path, in order.

    Returns:
        (N,) m.

    Example:
        >>> corner = Paths(np.array([0, 0]), np.array([[3.0, 0, 0], [3, 4, 0]]))
        >>> remaining_distance(np.zeros((2, 3)), np.array([[3.0, 4, 0], [0, 2, 0]]), corner)
        array([7., 2.])
    """
    distance: Array = np.linalg.norm(goal - position, axis=1)
    rows = paths.agent
    if not len(rows):
        return distance
    before = np.roll(paths.point, 1, axis=0)
    first = np.roll(rows, 1) != rows
    first[0] = True
    before[first] = position[rows[first]]
    along = np.zeros(len(distance))
    np.add.at(along, rows, np.linalg.norm(paths.point - before, axis=1))
    distance[rows] = along[rows]
    return distance
