"""Detects collisions and close approaches while a flight goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from star_core.geometry.neighbours import least, pairs
from star_core.geometry.obstacle_distance import distance
from star_core.messages.arrays import Array, Mask
from star_core.messages.events import Tick
from star_core.messages.state import AIRBORNE, among
from star_core.scene import Scene
from star_core.world import CONTACT_RADIUS

HYSTERESIS: Final = 0.02
"""A close approach is over once two agents are this much farther apart than the limit, m."""


@dataclass(frozen=True, slots=True)
class Incident:
    """A collision, or two agents that came closer than the mission's ``limits.separation``.

    Attributes:
        kind: ``collision`` or ``close_approach``; the kind of the event.
        text: What happened, for logs.
        details: What happened, for programs: ``agents``, ``obstacle`` (of a collision with one),
            ``time_s``, ``position_m`` (of two agents, the middle between them), ``distance_m`` (of
            a close approach), ``relative_speed_m_s`` (where velocities are known), ``from``
            (`Contacts.source`).
    """

    kind: str
    text: str
    details: Mapping[str, Any]


@dataclass(slots=True)
class _Approach:
    """A close approach that is not over.

    Attributes:
        distance: The shortest so far, m.
        time: When that was, s.
        position: (3,) the middle between the two then, m.
        collided: Whether the two collided meanwhile.
    """

    distance: float = np.inf
    time: float = 0.0
    position: Array = field(default_factory=lambda: np.zeros(3))
    collided: bool = False


class Contacts:
    """Follows the distances between agents and to obstacles, tick by tick.

    Distances are between ground-truth positions at ticks that have them, otherwise between
    estimated positions. Two agents collide when their centers are nearer than twice
    `CONTACT_RADIUS`; an agent collides with an obstacle nearer than `CONTACT_RADIUS`. A contact
    that lasts is one collision.

    Args:
        scene: Agents, obstacles and ``limits.separation``.

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
        self._touching: set[tuple[int, int]] = set()
        self._hitting = np.zeros(len(self._names), np.bool_)
        self._approaches: dict[tuple[int, int], _Approach] = {}
        self._sources = {"ground_truth": 0, "estimate": 0}  # ticks with an agent in the air
        self._source = "estimate"  # of the tick
        self.agent_agent = 0
        self.agent_obstacle = 0
        self.separation = np.inf
        self.clearance = np.inf

    @property
    def source(self) -> str:
        """What distances were computed from in flight: ``ground_truth``, ``estimate``, ``mixed``.

        Before the first take-off it is what the newest tick has.
        """
        used = [name for name, ticks in self._sources.items() if ticks]
        return "mixed" if len(used) > 1 else used[0] if used else self._source

    def update(self, tick: Tick) -> list[Incident]:
        """Return the collisions that begin at a tick, and the close approaches that are over."""
        known = tick.estimate if tick.truth is None else tick.truth
        airborne = among(tick.health.phase, *AIRBORNE)
        self._source = "estimate" if tick.truth is None else "ground_truth"
        self._sources[self._source] += int(airborne.any())
        return [
            *self._between_agents(known.position, known.velocity, airborne, tick.time),
            *self._with_obstacles(known.position, known.velocity, tick.time),
        ]

    def finish(self) -> list[Incident]:
        """Return the close approaches that are not over when the flight ends."""
        open_ones, self._approaches = self._approaches, {}
        return [self._over(pair, one) for pair, one in open_ones.items() if not one.collided]

    def _between_agents(
        self, position: Array, velocity: Array, airborne: Mask, time: float
    ) -> list[Incident]:
        """Compare (N, 3) positions, m, of agents with (N, 3) velocities, m/s.

        After the first tick only pairs are looked at that may be a new closest approach.
        """
        touch = 2 * CONTACT_RADIUS
        if self.separation == np.inf:
            self.separation = least(position)
        first, second = pairs(position, max(self.separation, touch, self._limit + HYSTERESIS))
        if not len(first):
            self._touching.clear()
            return self.finish()
        offset = position[first] - position[second]
        apart = np.sqrt(np.vecdot(offset, offset))
        self.separation = min(self.separation, float(apart.min(initial=np.inf)))
        incidents = []
        rows = zip(first.tolist(), second.tolist(), strict=True)
        near = dict(zip(rows, apart.tolist(), strict=True))
        touching = {pair for pair, away in near.items() if away < touch}
        for pair in sorted(touching - self._touching):
            self.agent_agent += 1
            a, b = pair
            middle, relative = (position[a] + position[b]) / 2, velocity[a] - velocity[b]
            names = [self._names[a], self._names[b]]
            incidents.append(self._collision(names, None, middle, relative, time))
        self._touching = touching
        return incidents + self._approached(near, touching, position, airborne, time)

    def _approached(
        self,
        near: Mapping[tuple[int, int], float],
        touching: set[tuple[int, int]],
        position: Array,
        airborne: Mask,
        time: float,
    ) -> list[Incident]:
        """Follow the pairs that are closer than the limit; return those that no longer are."""
        for pair, away in near.items():
            a, b = pair
            if away < self._limit and (airborne[a] or airborne[b]):
                self._approaches.setdefault(pair, _Approach())
            if (one := self._approaches.get(pair)) is None:
                continue
            one.collided |= pair in touching
            if away < one.distance:
                one.distance, one.time = away, time
                one.position = (position[a] + position[b]) / 2
        parted = [
            pair for pair in self._approaches if near.get(pair, np.inf) > self._limit + HYSTERESIS
        ]
        over = [(pair, self._approaches.pop(pair)) for pair in parted]
        return [self._over(pair, one) for pair, one in over if not one.collided]

    def _with_obstacles(self, position: Array, velocity: Array, time: float) -> list[Incident]:
        """Compare (N, 3) positions, m, with the obstacles."""
        if not self._obstacles:
            return []
        clearances = np.array([distance(position, one) for one in self._obstacles])  # (K, N)
        clearances[~np.isfinite(clearances)] = np.inf  # an unknown position touches nothing
        clearance = clearances.min(axis=0)
        hitting = clearance < CONTACT_RADIUS
        incidents = []
        for row in np.flatnonzero(hitting & ~self._hitting).tolist():
            obstacle = self._obstacles[int(clearances[:, row].argmin())].name
            names = [self._names[row]]
            incidents.append(self._collision(names, obstacle, position[row], velocity[row], time))
        self.agent_obstacle += len(incidents)
        self._hitting = hitting
        self.clearance = min(self.clearance, float(clearance.min()))
        return incidents

    def _collision(
        self,
        names: list[str],
        obstacle: str | None,
        position: Array,
        velocity: Array,
        time: float,
    ) -> Incident:
        speed = float(np.linalg.norm(velocity))
        details: dict[str, Any] = {
            "agents": names,
            **({} if obstacle is None else {"obstacle": obstacle}),
            "time_s": time,
            "position_m": position.tolist(),
            **({"relative_speed_m_s": speed} if np.isfinite(speed) else {}),
            "from": self._source,
        }
        what = " and ".join(names) if obstacle is None else f"{names[0]} and obstacle {obstacle!r}"
        fast = f", relative speed {speed:.2f} m/s" if np.isfinite(speed) else ""
        text = f"{what} collided at {_point(position)}{fast}{self._doubt()}"
        return Incident("collision", text, details)

    def _over(self, pair: tuple[int, int], one: _Approach) -> Incident:
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
            f"{one.time:.2f} s, closer than limits.separation ({self._limit:g} m){self._doubt()}"
        )
        return Incident("close_approach", text, details)

    def _doubt(self) -> str:
        return " (estimated positions)" if self._source == "estimate" else ""


def _point(position: Array) -> str:
    return "[" + ", ".join(f"{value:.2f}" for value in position) + "]"
