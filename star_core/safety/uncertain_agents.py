"""Agents whose positions are too uncertain for the room that they have: brake, return, land."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from enum import IntEnum
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows, some
from star_core.messages.position_margin import position_margin
from star_core.messages.state import Estimate, Goals
from star_core.safety.walls import nearest_wall, walls
from star_core.scene import Scene
from star_core.world.world import CONTACT_RADIUS

NEEDED: Final = 0.5
"""Share of `Limits.uncertainty_margin` that an agent needs as room: by default one standard
deviation. Within the whole margin it still reaches goals, slowly."""

FENCE_TOLERANCE: Final = 0.2
"""Distance by which an agent may leave the fence, m: it is no wall."""

MIN_ROOM: Final = 0.05  # m; an agent that needs less room is never too near
ENOUGH: Final = 0.8  # share of the room that an agent may need when it flies on
CORRECTED: Final = 0.9  # times the standard deviation of the tick before: a landmark corrected it
LOCATED: Final = 0.5  # times the standard deviation for which it returned: it is located again
BRAKE_TIME: Final = 3.0  # s, in which an agent waits for a correction, before and after its return
NEAR: Final = 0.2  # m: an agent so near to where it was located has returned
MAX_RETURNS: Final = 3  # of an agent in one flight: then it lands


class Stage(IntEnum):
    """What an agent does about its uncertainty."""

    FLIES = 0
    BRAKES = 1
    RETURNS = 2


class UncertainAgents:
    """Redirects agents whose uncertainty leaves no room to obstacles or fence.

    An agent that needs more room than it has brakes. If no correction makes its position more
    certain within `BRAKE_TIME`, it returns to the position at which a correction arrived last; an
    agent that never had one, does not get one there, or has returned `MAX_RETURNS` times, lands. A
    correction is a sudden decrease of the covariance, whatever the localizer.

    Args:
        scene: World, limits and names.
        report: Receives the text of an event and the agent's name.
    """

    def __init__(self, scene: Scene, report: Callable[[str, str], None]) -> None:
        n = len(scene.agents)
        self._scene, self._report = scene, report
        self._deviations = scene.limits.uncertainty_margin
        self._fence = np.array([scene.world.fence.low[:2], scene.world.fence.high[:2]])
        self._walls = walls(scene.world.obstacles)
        self._std = np.zeros(n)  # m, of the tick before
        self._corrected_at = np.full((n, 2), np.nan)  # m
        self._stage = np.zeros(n, np.int64)
        self._until = np.full(n, np.inf)  # s, end of the stage at the latest
        self._goal = np.zeros((n, 3))  # m, of agents that brake or return
        self._limit = np.zeros(n)  # m, standard deviation below which an agent has returned
        self._returns = np.zeros(n, np.int64)
        nearest_wall(np.zeros((1, 3)), np.zeros(1, np.int64), self._walls)  # before the flight

    @property
    def redirected(self) -> Mask:
        """Agents that brake or return, whatever their goals: (N,)."""
        redirected: Mask = self._stage > 0  # `Stage.FLIES`
        return redirected

    def redirect(
        self, estimate: Estimate, steered: Mask, goals: Goals
    ) -> tuple[Goals, list[tuple[int, str]]]:
        """Return the goals, changed for uncertain agents; and which agents must land, and why.

        Args:
            estimate: Of the agents' positions.
            steered: (N,) agents that setpoints fly and that do not land.
            goals: The tasks'.
        """
        if self._deviations == 0.0:
            return goals, []
        std = position_margin(estimate.covariance, 1.0, math.inf)
        corrected = steered & (std < CORRECTED * self._std)
        if some(corrected):
            self._corrected_at[corrected] = estimate.position[corrected, :2]
        self._std = std
        self._stage *= steered  # the others fly
        needed = np.where(steered, NEEDED * self._deviations * std, 0.0)
        rows: Rows = ((needed > MIN_ROOM) | (self._stage > 0)).nonzero()[0]
        if not len(rows):
            return goals, []
        fence, wall, piece = self._room(estimate.position, rows)
        room = np.minimum(fence, wall)
        lands = []
        for row in rows[(needed > room)[rows] | self.redirected[rows]].tolist():
            distance, what = fence[row] - FENCE_TOLERANCE, "the fence"
            if wall[row] < fence[row]:
                obstacle = self._scene.world.obstacles[self._walls.obstacle[piece[row]]]
                distance, what = wall[row] + CONTACT_RADIUS, f"obstacle {obstacle.name!r}"
            reason = f"uncertain by {std[row]:.2f} m and {max(0.0, distance):.2f} m from {what}"
            if text := self._advance(row, estimate, needed[row], room[row], reason):
                lands.append((row, text))
        return self._redirected(goals), lands

    def _advance(
        self, row: int, estimate: Estimate, needed: float, room: float, reason: str
    ) -> str | None:
        """Change what an agent does; return why it must land, if so."""
        name, time = self._scene.agents[row].name, estimate.time
        if self._stage[row] == Stage.FLIES:
            self._stage[row], self._until[row] = Stage.BRAKES, time + BRAKE_TIME
            self._goal[row] = estimate.position[row]
            self._report(f"{name} is {reason}: it brakes", name)
            return None
        if self._stage[row] == Stage.BRAKES:
            if needed <= ENOUGH * room:
                self._stage[row] = Stage.FLIES
            elif time >= self._until[row]:
                if self._returns[row] >= MAX_RETURNS or np.isnan(self._corrected_at[row]).any():
                    self._stage[row] = Stage.FLIES
                    return reason
                self._begin_return(row, estimate)
                self._report(f"{name} is {reason}: it returns to where it was located last", name)
            return None
        if self._std[row] <= self._limit[row]:
            self._stage[row] = Stage.FLIES
            self._report(f"{name} is located again, to {self._std[row]:.2f} m: it flies on", name)
        elif time >= self._until[row]:
            self._stage[row] = Stage.FLIES
            return f"{reason}, and not located again"
        return None

    def _begin_return(self, row: int, estimate: Estimate) -> None:
        self._stage[row] = Stage.RETURNS
        self._returns[row] += 1
        self._limit[row] = LOCATED * self._std[row]
        self._goal[row, :2] = self._corrected_at[row]
        away = math.dist(self._goal[row, :2], estimate.position[row, :2])
        duration = 2 * max(0.0, away - NEAR) / self._scene.limits.speed + BRAKE_TIME
        self._until[row] = estimate.time + duration

    def _redirected(self, goals: Goals) -> Goals:
        """Return goals with those of the agents that brake or return."""
        away = self.redirected
        if not some(away):
            return goals
        return replace(
            goals,
            position=np.where(away[:, None], self._goal, goals.position),
            velocity=np.where(away[:, None], 0.0, goals.velocity),
            speed=np.where(away, self._scene.limits.speed, goals.speed),
            active=goals.active | away,
        )

    def _room(self, position: Array, rows: Rows) -> tuple[Array, Array, Rows]:
        """Return (N,) room to the fence and to the nearest obstacle, m, and (N,) its piece."""
        here = position[:, :2]
        low, high = self._fence
        fence = np.minimum(here - low, high - here).min(axis=1) + FENCE_TOLERANCE
        distance, piece = nearest_wall(np.ascontiguousarray(position), rows, self._walls)
        return fence, distance - CONTACT_RADIUS, piece
