"""Lands a swarm without its mission: each agent in place, or aside if that is not free."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from star_core import Array, Mask, Scene, Setpoint, Telemetry, Transform
from star_core.toolkit import (
    AGENT_CLEARANCE,
    MAX_DRIFT,
    OBSTACLE_CLEARANCE,
    free_position,
    is_free,
)
from star_radio.transport import Radio

WAY_STEP: Final = 0.1  # m, between the positions of a way aside that are tested
SPEED: Final = 0.3  # m/s, to move aside
MAX_REST_SPEED: Final = 0.1  # m/s; of an agent that can land
ARRIVAL_TOLERANCE: Final = 0.1  # m, its greatest distance from the position to land at
SETTLING_TIME: Final = 2.0  # s that an agent may take to come to rest
LOW: Final = 0.15  # m: an agent below lands at once
MAX_REPORT_AGE: Final = 0.5  # s: an agent that is not heard for longer lands at once
MAX_WAIT: Final = 10.0  # s: after it all agents land


class Descent:
    """Landings of all agents, by their reports only.

    Agents brake first. Those with no agent and no obstacle below land. The others hover until these
    are down, then fly aside to the nearest free position with a straight way to it, one after the
    other, and land. It is over when no agent may be in the air: one whose link is lost in a
    take-off is waited for, and landed when its link returns.

    Attributes:
        over: Whether all agents are down.
    """

    def __init__(
        self,
        radio: Radio,
        scene: Scene,
        now: float,
        report: Callable[[str], object],
    ) -> None:
        self._radio, self._scene, self._report = radio, scene, report
        self._vehicles = radio.vehicles
        self._began = now
        self._waiting: set[int] = set()  # rows whose positions are not free
        self._aside: dict[int, Array] = {}  # (2,) positions to land at, m, by row
        self.over = False
        radio.cancel(range(len(self._vehicles)))

    def step(self, now: float, telemetry: Telemetry, to_map: Transform) -> Setpoint:
        """Command the landings that are possible; return setpoints, in odometry frames.

        Args:
            now: Clock, s.
            telemetry: Newest reports.
            to_map: Poses of the odometry frames in the map.
        """
        passed = now - self._began
        up = self._radio.aloft()
        self._end(passed, up)
        for row in self._radio.landings.repeat(telemetry, up):
            self._report(f"{self._scene.agents[row].name} hovers: it is commanded to land again")
        heard = telemetry.age <= MAX_REPORT_AGE
        ready = np.array([not (vehicle.lands or vehicle.stopped) for vehicle in self._vehicles])
        ready &= ~heard | np.array([vehicle.airborne for vehicle in self._vehicles])
        pending = up & ready
        position = to_map.apply(telemetry.position)
        finite = np.isfinite(position).all(axis=1)
        at_once = ~heard | ~finite
        at_once |= (telemetry.position[:, 2] < LOW) | (passed > MAX_WAIT)
        settled = np.linalg.norm(telemetry.velocity, axis=1) <= MAX_REST_SPEED
        settled |= passed > SETTLING_TIME
        velocity = np.zeros((len(up), 3))
        height = np.nan_to_num(position[:, 2])
        for row in sorted(np.flatnonzero(pending).tolist(), key=lambda row: height[row]):
            if row in self._aside:
                way = self._aside[row] - position[row, :2]
                length = float(np.linalg.norm(way))
                velocity[row, :2] = way * min(1.0, SPEED / max(length, ARRIVAL_TOLERANCE))
                free = length <= ARRIVAL_TOLERANCE
            else:
                below = finite & (~pending | (height < height[row]))
                free = self._is_free(position[row], position[below, :2])
            if at_once[row] or (free and settled[row]):
                self._radio.landings.land(row, float(telemetry.position[row, 2]))
                pending[row] = False
            elif not free and row not in self._aside:
                busy = (up & ~pending).any() or pending[list(self._aside)].any()
                self._wait(row, position, busy=bool(busy))
        yaw = np.nan_to_num(telemetry.heading)
        return Setpoint(to_map.turn_back(velocity), yaw, pending)

    def _wait(self, row: int, position: Array, *, busy: bool) -> None:
        """Let an agent wait whose position is not free, or choose where it lands."""
        name = self._scene.agents[row].name
        if row not in self._waiting:
            self._waiting.add(row)
            self._report(f"{name} waits: an agent or an obstacle is below")
        if not busy:
            self._aside[row] = self._nearest_free(row, position)
            away = math.dist(self._aside[row], position[row, :2])
            self._report(f"{name} lands {away:.2f} m aside")

    def _is_free(self, position: Array, taken: Array) -> bool:
        """Return whether an agent can land at its position, (3,) m, with others at (K, 2) m."""
        top = float(position[2])
        free = is_free(position[None, :2], self._scene.world, taken, AGENT_CLEARANCE, top)
        return bool(free[0])

    def _nearest_free(self, row: int, position: Array) -> Array:
        """Return the nearest free position, (2,) m; the agent's own if none is near."""
        start, others = position[row], np.delete(position, row, axis=0)
        taken = others[np.isfinite(others).all(axis=1), :2]
        for margin in (MAX_DRIFT, 0.0):  # how certain positions are is not known
            apart = AGENT_CLEARANCE + margin
            reaches = partial(self._reaches, start)
            nearest = free_position(start, self._scene.world, taken, apart, margin, reaches)
            if nearest is not None:
                return nearest
        start_xy: Array = start[:2].copy()
        return start_xy

    def _reaches(self, start: Array, ends: Array) -> Mask:
        """Return to which (K, 2) m an agent at (3,) m flies straight, and past no obstacle: (K,).

        It keeps `OBSTACLE_CLEARANCE`, or what it has at the start.
        """
        length = float(np.linalg.norm(ends - start[:2], axis=1).max(initial=0.0))
        share = np.linspace(0.0, 1.0, math.ceil(length / WAY_STEP) + 1)
        way = start[:2] + share[:, None, None] * (ends - start[:2])  # (S, K, 2)
        points = np.concatenate([way, np.full((*way.shape[:2], 1), start[2])], axis=2)
        free = np.ones(len(ends), np.bool_)
        for obstacle in self._scene.world.obstacles:
            away = obstacle.distances(points.reshape(-1, 3)).reshape(points.shape[:2])
            free &= (away >= np.minimum(OBSTACLE_CLEARANCE, away[0])).all(axis=0)
        return free

    def _end(self, passed: float, up: Mask) -> None:
        """Determine whether the landings are over."""
        if not (self.over or up.any()):
            self.over = True
            if fallen := self._radio.assumed_down():
                self._report(self._radio.describe(fallen))
            self._report(
                f"all agents {'are down' if fallen else 'have landed'}, after {passed:.1f} s"
            )
