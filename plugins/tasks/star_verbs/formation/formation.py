"""The task ``formation``: forms a shape, holds it, and moves it as a whole."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from star_core import Array, Estimate, Health, Scene, Status, TaskOutput
from star_core.toolkit import shortlist
from star_verbs.formation.shapes import position_faults, shape
from star_verbs.step_agents import DURATION_ERROR, StepAgents, assign, lag_factor

SLOW_LAG: Final = 0.15  # m: position error of an agent from which on the formation slows down
STOP_LAG: Final = 0.4  # m: position error of an agent at which the formation waits
CATCH_UP: Final = 1.5  # times the formation's speed: the speed limit of an agent that lags behind


class Formation:
    """Sends each agent to a position of a shape, holds the shape, and moves it as a whole.

    The formation is formed when every agent is at its position and has stopped; agents that do not
    get there exchange their positions. Then it is held, and then its positions move together: they
    slow down when the agent farthest from its position is more than `SLOW_LAG` away, and stop when
    it is `STOP_LAG` away or not located.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        options: Options of the verb.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], options: Mapping[str, Any]) -> None:
        limit = scene.limits.speed
        self._agents = StepAgents(scene, rows)
        self._shape = shape(len(rows), options)
        self._options = options
        self._speed = min(options.get("speed", limit), limit)  # m/s, on the way to the positions
        self._move_speed = min(options.get("move", {}).get("speed", limit), limit)  # m/s
        self._max_speed = min(CATCH_UP * self._move_speed, limit)
        # Checked again: fewer agents than at the mission's check form other shapes.
        self._fault = shortlist(position_faults(scene, self._shape), "; ")
        self._move = np.array(self._shape.move)
        self._position: Array | None = None  # (K, 3) assigned positions before the move
        self._yaw: Array = np.zeros(len(rows))
        self._formed = math.inf  # s, time at which it is formed
        self._flown = 0.0  # m, distance that the formation has moved
        self._time = 0.0

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._assign(estimate)
        travel = self._agents.travel_distance(estimate, self._position)
        takes = travel / self._speed + self._shape.move_distance / self._move_speed
        return self._agents.timeout(takes + self._options["for"])

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if self._fault:
            return TaskOutput(status=Status.FAILURE, reason=self._fault)
        if self._position is None:
            self._assign(estimate)
        if self._position is None:
            return TaskOutput()
        within = self._options["within"]
        if math.isinf(self._formed):
            self._position = self._agents.exchanged(estimate, self._position, within)
        elapsed, self._time = estimate.time - self._time, estimate.time
        position = self._position + self._moved()
        lag = self._agents.max_distance(estimate, position)
        arrived = self._agents.arrived(estimate, position, within)
        if arrived:
            self._formed = min(self._formed, estimate.time)
        formed = estimate.time - self._formed >= self._options["for"] - DURATION_ERROR
        pace = self._move_speed * lag_factor(lag, SLOW_LAG, STOP_LAG) if formed else 0.0
        over = formed and self._flown >= self._shape.move_distance
        self._flown = min(self._flown + pace * elapsed, self._shape.move_distance)
        moving = formed and self._flown < self._shape.move_distance
        if moving:
            self._agents.depart()
        goals = self._agents.goals(
            self._position + self._moved(),
            self._yaw,
            self._max_speed if formed and self._shape.move_distance else self._speed,
            self._move * (pace / self._shape.move_distance) if moving else np.zeros(3),
        )
        done = over and (arrived or not self._shape.move_distance)
        return TaskOutput(goals, status=Status.SUCCESS if done else Status.RUNNING)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        kept = self._agents.keep(rows)
        self._yaw = self._yaw[kept]
        if self._position is not None:
            self._position = self._position[kept]

    def on_agent_replaced(self, old: int, new: int) -> None:
        self._agents.replace(old, new)

    def _assign(self, estimate: Estimate) -> None:
        """Assign each agent a position so that the total distance is minimal."""
        if self._fault or not self._agents.located(estimate):
            return
        rows, position = self._agents.rows, np.array(self._shape.position)
        self._position = position[assign(estimate.position[rows], position)]
        yaw = self._options.get("yaw_deg")
        self._yaw = estimate.yaw[rows] if yaw is None else np.full(len(rows), math.radians(yaw))
        self._time = estimate.time

    def _moved(self) -> Array:
        """Displacement of the positions since they were formed, (3,), m."""
        moved: Array = self._move * (self._flown / (self._shape.move_distance or 1.0))
        return moved
