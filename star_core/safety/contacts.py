"""Collisions, which fail missions, and close approaches of agents."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from star_core.geometry.neighbours import Pairs
from star_core.messages.arrays import Array, Mask, some
from star_core.messages.events import Event, Tick
from star_core.messages.state import AIRBORNE, among
from star_core.world.scene import Scene
from star_core.world.world import CONTACT_RADIUS

HYSTERESIS: Final = 0.02  # m beyond the limit at which a close approach is over
COLLISION_DISTANCE: Final = 2 * CONTACT_RADIUS  # m between two agents
NO_TRUTH: Final = "no ground truth: separation and collisions are computed from estimated positions"


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
        self._reported_no_truth = False
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

        The first tick without ground truth is an event too.

        Args:
            tick: Of the flight.
            near: Pairs of agents within `reach`, at least, by the positions that are used.
        """
        state = tick.estimate if tick.truth is None else tick.truth
        airborne = among(tick.health.phase, *AIRBORNE)
        self._time = tick.time
        self._source = "estimate" if tick.truth is None else "ground_truth"
        self._sources[self._source] += some(airborne)
        events = []
        if tick.truth is None and not self._reported_no_truth:
            self._reported_no_truth = True
            events.append(Event(tick.time, "no_truth", NO_TRUTH))
        return [
            *events,
            *self._between_agents(near, state.position, state.velocity, airborne),
            *self._with_obstacles(state.position, state.velocity),
        ]

    def finish(self) -> list[Event]:
        """Return the close approaches that are not over when the flight ends."""
        open_ones, self._approaches = self._approaches, {}
        return [
            self._over(pair, approach)
            for pair, approach in open_ones.items()
            if not approach.collided
        ]

    def collisions(self) -> str:
        """Return the number of collisions, in words; empty if there are none."""
        count = self.agent_agent + self.agent_obstacle
        if not count:
            return ""
        by = " (estimated positions)" if self.source == "estimate" else ""
        return f"{count} collision{'s' if count > 1 else ''}{by}"

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
            if (approach := self._approaches.get(pair)) is None:
                continue
            approach.collided |= pair in touching
            if away < approach.closest:
                approach.closest, approach.time = away, self._time
                approach.distance = math.dist(position[a], position[b])
                approach.position = (position[a] + position[b]) / 2
        parted = [
            pair for pair in self._approaches if near.get(pair, np.inf) > self._limit + HYSTERESIS
        ]
        over = [(pair, self._approaches.pop(pair)) for pair in parted]
        return [self._over(pair, approach) for pair, approach in over if not approach.collided]

    def _with_obstacles(self, position: Array, velocity: Array) -> list[Event]:
        """Compare (N, 3) positions, m, with the obstacles."""
        if not self._obstacles:
            return []
        clearances = np.array(
            [obstacle.distances(position) for obstacle in self._obstacles]
        )  # (K, N)
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

    def _over(self, pair: tuple[int, int], approach: _Approach) -> Event:
        names = [self._names[row] for row in pair]
        details = {
            "agents": names,
            "time_s": approach.time,
            "position_m": approach.position.tolist(),
            "distance_m": approach.distance,
            "from": self._source,
        }
        text = (
            f"{names[0]} and {names[1]} came within {approach.distance:.2f} m of each other at "
            f"{approach.time:.2f} s, closer than limits.separation ({self._limit:g} m) and "
            f"vertical_separation ({self._vertical:g} m) permit"
            f"{self._source_note()}"
        )
        return Event(self._time, "close_approach", text, details=details)

    def _source_note(self) -> str:
        return " (estimated positions)" if self._source == "estimate" else ""


def _point(position: Array) -> str:
    return "[" + ", ".join(f"{value:.2f}" for value in position) + "]"
