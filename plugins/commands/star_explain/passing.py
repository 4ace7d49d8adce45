"""Evasion: agents of a rehearsal pass each other at the distance that they keep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from star_core import Array, Goals, Mask, Mission
from star_core.toolkit import MAX_MARGIN_RATIO, some
from star_explain.separation import kept_distance

HORIZON: Final = 2.0  # s, before which agents begin to give way
MAX_AGENTS: Final = 30  # agents: pairs of more take long, and are not considered
ARRIVAL_TOLERANCE: Final = 0.1  # m, distance from a goal at which an agent has arrived
MIN_PROGRESS: Final = 0.02  # m
PATIENCE: Final = 3.0  # s without `MIN_PROGRESS`; then an agent flies straight to its goal
PASSING_SHARE: Final = 1 / 4
"""Share of the margins for uncertain positions that agents keep at least when they pass each other,
since margins yield: four agents by `flow` that change sides at once pass at 0.64 to 0.71 m, where
the separation and all of the margins are 1.2 m, two at 0.8 to 0.9 m, and two pairs in lanes 1 m
apart at 0.57 m."""
TINY: Final = 1e-9  # m/s or m


class Passing:
    """Makes agents give way to each other in the plane, so that both share the detour.

    Each agent of a pair takes half of the least change of their relative velocity that keeps their
    distance for `HORIZON`, as with optimal reciprocal collision avoidance (van den Berg et al.,
    2011), but the changes by several neighbors are added. It costs about the time that avoiders
    cost, without importing one.

    Args:
        mission: With its separation and avoider. Agents do not give way if the avoider has no
            radius.
        std: Returns the standard deviations of the positions, (N,) m, for whose margins agents pass
            each other farther apart.
    """

    def __init__(self, mission: Mission, std: Callable[[], Array]) -> None:
        n, limits = len(mission.scene.agents), mission.scene.limits
        self._deviations = limits.uncertainty_margin
        self._std = std
        self._distance = kept_distance(mission)
        self._vertical = limits.vertical_separation
        self._avoids = "radius" in mission.plugins["avoider"].options and 1 < n <= MAX_AGENTS
        self._pairs = np.triu_indices(n if self._avoids else 0, 1)
        self._goal = np.full((n, 3), np.nan)  # m, of the last call
        self._nearest = np.full(n, np.inf)  # m from it so far
        self._since = np.zeros(n)  # s, last progress

    def velocity(
        self, time: float, position: Array, goals: Goals, steered: Mask, velocity: Array
    ) -> Array:
        """Return the (N, 3) velocities with which agents pass each other, m/s.

        Args:
            time: s.
            position: (N, 3) m.
            goals: Of the agents.
            steered: (N,) agents that fly to their goals.
            velocity: (N, 3) that leads them there, m/s.
        """
        if not self._avoids:
            return velocity
        gives_way = steered & goals.active & self._patient(time, position, goals)
        if not some(gives_way):
            return velocity
        first, second = self._pairs
        offset = position[second] - position[first]
        relative = velocity[first, :2] - velocity[second, :2]
        apart = np.hypot(offset[:, 0], offset[:, 1])
        greatest = PASSING_SHARE * MAX_MARGIN_RATIO * self._distance if self._deviations else 0.0
        reach = self._distance + greatest + HORIZON * np.hypot(relative[:, 0], relative[:, 1])
        near = (apart < reach) & (np.abs(offset[:, 2]) < self._vertical) & (apart > TINY)
        near &= gives_way[first] & gives_way[second]
        if not some(near):
            return velocity
        first, second, offset = first[near], second[near], offset[near, :2]
        distance = np.full(len(first), self._distance)
        if self._deviations:
            std = self._std()
            margin = PASSING_SHARE * self._deviations * (std[first] + std[second])
            distance += np.minimum(margin, greatest)
        ends = goals.position[second, :2] - goals.position[first, :2]
        kept = np.minimum(distance, np.hypot(ends[:, 0], ends[:, 1]) - ARRIVAL_TOLERANCE)
        kept = np.clip(kept, 0.0, (1 - TINY) * apart[near])
        change = least_change(offset, relative[near], kept) / 2
        passing = velocity.copy()
        np.add.at(passing[:, :2], first, change)
        np.add.at(passing[:, :2], second, -change)
        speed = np.maximum(np.sqrt(np.vecdot(passing, passing)), TINY)
        passing *= np.minimum(1.0, goals.speed / speed)[:, None]
        return np.where(steered[:, None], passing, velocity)

    def _patient(self, time: float, position: Array, goals: Goals) -> Mask:
        """Return which agents give way: not those that have come no nearer to their goals, (N,)."""
        away = goals.position - position
        distance = np.sqrt(np.vecdot(away, away))
        begins = (goals.position != self._goal).any(axis=1)
        self._goal = goals.position
        nearer = begins | (distance < self._nearest - MIN_PROGRESS)
        self._nearest = np.where(nearer, distance, self._nearest)
        self._since = np.where(nearer | (distance < ARRIVAL_TOLERANCE), time, self._since)
        return time - self._since < PATIENCE


def least_change(offset: Array, relative: Array, kept: Array) -> Array:
    """Return the least changes of relative velocities that keep distances for `HORIZON`.

    Args:
        offset: (M, 2) from one agent to the other, m; longer than `kept`.
        relative: (M, 2) velocity of the one to the other, m/s.
        kept: (M,) distances to keep, m.

    Returns:
        (M, 2) m/s; zero where the distances are kept.

    Example:
        >>> least_change(np.array([[2.0, 0]]), np.array([[1.5, 0]]), np.array([1.0])).round(3)
        array([[-0.375, -0.65 ]])
        >>> least_change(np.array([[2.0, 0]]), np.array([[-1.5, 0]]), np.array([1.0]))
        array([[-0.,  0.]])
    """
    square = np.vecdot(offset, offset)
    from_cutoff = relative - offset / HORIZON  # the cutoff is a circle with radius kept / HORIZON
    length = np.maximum(np.sqrt(np.vecdot(from_cutoff, from_cutoff)), TINY)
    along = np.vecdot(from_cutoff, offset)
    before = (along < 0.0) & (along**2 > (kept * length) ** 2)  # the circle is nearest
    to_circle = (np.maximum(kept / HORIZON - length, 0.0) / length)[:, None] * from_cutoff
    leg = np.sqrt(square - kept**2)
    x, y = offset.T
    side = np.where(x * from_cutoff[:, 1] - y * from_cutoff[:, 0] > 0.0, 1.0, -1.0)
    tangent = np.stack([x * leg - side * y * kept, side * x * kept + y * leg]) / square
    to_leg = np.vecdot(relative, tangent.T)[:, None] * tangent.T - relative
    cross = np.abs(x * relative[:, 1] - y * relative[:, 0])
    speed = np.sqrt(np.vecdot(relative, relative))
    closes = (np.vecdot(offset, relative) > 0.0) & (cross < kept * speed)
    change: Array = np.where(before[:, None], to_circle, np.where(closes[:, None], to_leg, 0.0))
    return change
