"""The task ``formation``: forms a shape, holds it, and moves it as one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core import Array, Estimate, Health, Scene, Status, Step
from star_verbs.assignment import assign
from star_verbs.crew import Crew
from star_verbs.formation.checks import faults
from star_verbs.formation.shapes import Shape
from star_verbs.timeouts import time_out

LAG: Final = 0.15
"""Behind its place that an agent may be before the formation slows down, m."""

STOP: Final = 0.4
"""Behind its place at which the formation waits for an agent, m."""

CATCH_UP: Final = 1.5
"""Times the formation's speed is what an agent may fly to make up its lag."""

ROUNDING: Final = 1e-9
"""What mission time may lack of a whole number of ticks, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner:
    """How a formation is flown.

    Attributes:
        speed: On the way to the places, m/s.
        pace: Of the formation that moves, m/s.
        yaw: Heading of the agents, rad; None keeps each agent's own.
        within: How near to its place each agent must come, m.
        hold: How long to stay once it is formed, s.
    """

    speed: float
    pace: float
    yaw: float | None
    within: float
    hold: float


class Formation:
    """Sends each agent to a place of a shape, holds the shape, and moves it as one.

    The formation is formed when every agent is at its place and has stopped. Then it is held, and
    then its places move together: they slow down, all alike, when the agent farthest from its
    place is more than `LAG` away, and wait when it is `STOP` away or not located.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        shape: The places.
        manner: How to fly.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], shape: Shape, manner: Manner) -> None:
        self._crew = Crew(scene, rows)
        self._shape = shape
        self._manner = manner
        self._fastest = min(CATCH_UP * manner.pace, scene.limits.speed)
        # Looked at again: fewer agents than the mission was checked for form other shapes.
        self._fault = "; ".join(faults(scene, shape))
        self._move = np.array(shape.move)
        self._place: Array | None = None  # (K, 3) where each agent's place is before it moves
        self._yaw: Array = np.zeros(len(rows))
        self._formed = math.inf  # s, when
        self._flown = 0.0  # m, of the way that the formation moves
        self._time = 0.0

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._line_up(estimate)
        far = self._crew.journey(estimate, self._place)
        takes = far / self._manner.speed + self._shape.way / self._manner.pace
        return time_out(takes + self._manner.hold)

    def step(self, estimate: Estimate, health: Health) -> Step:
        if self._fault:
            return Step(status=Status.FAILURE, reason=self._fault)
        if self._place is None:
            self._line_up(estimate)
        if self._place is None:
            return Step()
        passed, self._time = estimate.time - self._time, estimate.time
        lag = self._crew.farthest(estimate, self._place + self._moved())
        there = lag <= self._manner.within and self._crew.slow(estimate)
        if there:
            self._formed = min(self._formed, estimate.time)
        held = estimate.time - self._formed >= self._manner.hold - ROUNDING
        pace = self._pace(lag) if held else 0.0
        over = held and self._flown >= self._shape.way
        self._flown = min(self._flown + pace * passed, self._shape.way)
        moving = held and self._flown < self._shape.way
        goals = self._crew.goals(
            self._place + self._moved(),
            self._yaw,
            self._fastest if held and self._shape.way else self._manner.speed,
            self._move * (pace / self._shape.way) if moving else np.zeros(3),
        )
        done = over and (there or not self._shape.way)
        return Step(goals, status=Status.SUCCESS if done else Status.RUNNING)

    def stay(self, rows: tuple[int, ...]) -> None:
        kept = self._crew.stay(rows)
        self._yaw = self._yaw[kept]
        if self._place is not None:
            self._place = self._place[kept]

    def swap(self, old: int, new: int) -> None:
        self._crew.swap(old, new)

    def _line_up(self, estimate: Estimate) -> None:
        """Give each agent the place that suits all best."""
        if self._fault or not self._crew.located(estimate):
            return
        rows, place = self._crew.rows, np.array(self._shape.place)
        self._place = place[assign(estimate.position[rows], place)]
        yaw = self._manner.yaw
        self._yaw = estimate.yaw[rows] if yaw is None else np.full(len(rows), yaw)
        self._time = estimate.time

    def _moved(self) -> Array:
        """How far the places are from where they were formed, (3,), m."""
        moved: Array = self._move * (self._flown / (self._shape.way or 1.0))
        return moved

    def _pace(self, lag: float) -> float:
        """Speed of the formation when the agent farthest from its place is `lag` away, m/s."""
        return self._manner.pace * min(max((STOP - lag) / (STOP - LAG), 0.0), 1.0)
