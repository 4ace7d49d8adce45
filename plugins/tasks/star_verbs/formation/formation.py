"""The task ``formation``: forms a shape, holds it, and moves it as a whole."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core import Array, Estimate, Health, Scene, Status, TaskOutput, timeout
from star_verbs.assignment import assign
from star_verbs.formation.checks import faults
from star_verbs.formation.shapes import Shape
from star_verbs.step_agents import StepAgents

LAG: Final = 0.15
"""Position error of an agent from which on the formation slows down, m."""

STOP: Final = 0.4
"""Position error of an agent at which the formation waits, m."""

CATCH_UP: Final = 1.5
"""Speed limit of an agent that lags behind, as a multiple of the formation's speed."""

ROUNDING: Final = 1e-9
"""Rounding error of mission time, which is a sum of ticks, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner:
    """Motion parameters of a formation.

    Attributes:
        speed: Speed on the way to the positions, m/s.
        pace: Speed of the moving formation, m/s.
        yaw: Heading of the agents, rad; None keeps each agent's own.
        within: Distance to its position that each agent must reach, m.
        hold: Time to hold the formation once it is formed, s.
    """

    speed: float
    pace: float
    yaw: float | None
    within: float
    hold: float


class Formation:
    """Sends each agent to a position of a shape, holds the shape, and moves it as a whole.

    The formation is formed when every agent is at its position and has stopped. Then it is held,
    and then its positions move together: they slow down when the agent farthest from its position
    is more than `LAG` away, and stop when it is `STOP` away or not located.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        shape: The positions.
        manner: Motion parameters.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], shape: Shape, manner: Manner) -> None:
        self._agents = StepAgents(scene, rows)
        self._shape = shape
        self._manner = manner
        self._fastest = min(CATCH_UP * manner.pace, scene.limits.speed)
        # Checked again: fewer agents than at the mission's check form other shapes.
        self._fault = "; ".join(faults(scene, shape))
        self._move = np.array(shape.move)
        self._place: Array | None = None  # (K, 3) each agent's position before the formation moves
        self._yaw: Array = np.zeros(len(rows))
        self._formed = math.inf  # s, time at which it is formed
        self._flown = 0.0  # m, distance that the formation has moved
        self._time = 0.0

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._line_up(estimate)
        far = self._agents.journey(estimate, self._place)
        takes = far / self._manner.speed + self._shape.way / self._manner.pace
        return timeout(takes + self._manner.hold)

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if self._fault:
            return TaskOutput(status=Status.FAILURE, reason=self._fault)
        if self._place is None:
            self._line_up(estimate)
        if self._place is None:
            return TaskOutput()
        passed, self._time = estimate.time - self._time, estimate.time
        lag = self._agents.farthest(estimate, self._place + self._moved())
        there = lag <= self._manner.within and self._agents.slow(estimate)
        if there:
            self._formed = min(self._formed, estimate.time)
        held = estimate.time - self._formed >= self._manner.hold - ROUNDING
        pace = self._pace(lag) if held else 0.0
        over = held and self._flown >= self._shape.way
        self._flown = min(self._flown + pace * passed, self._shape.way)
        moving = held and self._flown < self._shape.way
        goals = self._agents.goals(
            self._place + self._moved(),
            self._yaw,
            self._fastest if held and self._shape.way else self._manner.speed,
            self._move * (pace / self._shape.way) if moving else np.zeros(3),
        )
        done = over and (there or not self._shape.way)
        return TaskOutput(goals, status=Status.SUCCESS if done else Status.RUNNING)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        kept = self._agents.keep(rows)
        self._yaw = self._yaw[kept]
        if self._place is not None:
            self._place = self._place[kept]

    def on_agent_replaced(self, old: int, new: int) -> None:
        self._agents.replace(old, new)

    def _line_up(self, estimate: Estimate) -> None:
        """Assign each agent a position so that the total distance is minimal."""
        if self._fault or not self._agents.located(estimate):
            return
        rows, place = self._agents.rows, np.array(self._shape.place)
        self._place = place[assign(estimate.position[rows], place)]
        yaw = self._manner.yaw
        self._yaw = estimate.yaw[rows] if yaw is None else np.full(len(rows), yaw)
        self._time = estimate.time

    def _moved(self) -> Array:
        """Displacement of the positions since they were formed, (3,), m."""
        moved: Array = self._move * (self._flown / (self._shape.way or 1.0))
        return moved

    def _pace(self, lag: float) -> float:
        """Speed of the formation when the agent farthest from its position is `lag` away, m/s."""
        return self._manner.pace * min(max((STOP - lag) / (STOP - LAG), 0.0), 1.0)
