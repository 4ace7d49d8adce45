"""Lands a swarm without its mission: each agent in place, one above another after it and aside."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from star_core import Array, Mask, Scene, Setpoint, Telemetry, Transform
from star_radio.vehicle import Vehicle

CLEARANCE: Final = 0.25  # m in the plane, between two landings
EXTRA_CLEARANCE: Final = 0.1  # m, added where an agent moves aside
SEARCH_STEP: Final = 0.05  # m, between the positions that are tried
SEARCH_RADIUS: Final = 3.0  # m
SPEED: Final = 0.3  # m/s, to move aside
SETTLED: Final = 0.1  # m/s and m: an agent slower than that and this near its goal can land
SETTLING_TIME: Final = 2.0  # s that an agent may take to come to rest
LOW: Final = 0.15  # m: an agent below lands at once
MAX_REPORT_AGE: Final = 0.5  # s: an agent that is not heard for longer lands at once
MAX_WAIT: Final = 10.0  # s: after it all agents land
MIN_TIME: Final = 2.0  # s: a take-off that was commanded last may begin so late
TIMEOUT: Final = 30.0  # s: an agent that is not down by then has not reported it


class Descent:
    """Landings of all agents, by their reports only.

    Agents brake first. Those with no agent below land. The others hover until these are down, then
    fly aside to the nearest free position, one after the other, and land.

    Args:
        vehicles: The drone of each row.
        scene: The agents and the world.
        now: Clock, s.
        report: Called with lines for the log.
    """

    def __init__(
        self,
        vehicles: Sequence[Vehicle],
        scene: Scene,
        now: float,
        report: Callable[[str], object],
    ) -> None:
        self._vehicles, self._scene, self._report = vehicles, scene, report
        self._began = now
        self._waiting: set[int] = set()  # rows that are above another
        self._aside: dict[int, Array] = {}  # (2,) positions to land at, m, by row
        self.over = False

    def step(self, now: float, telemetry: Telemetry, to_map: Transform) -> Setpoint:
        """Command the landings that are possible; return setpoints, in odometry frames.

        Args:
            now: Clock, s.
            telemetry: Newest reports.
            to_map: Poses of the odometry frames in the map.
        """
        passed = now - self._began
        up = np.array([vehicle.airborne for vehicle in self._vehicles])
        pending = up & ~np.array([vehicle.lands for vehicle in self._vehicles])
        self._end(passed, up)
        position = to_map.apply(telemetry.position)
        at_once = (telemetry.age > MAX_REPORT_AGE) | ~np.isfinite(position).all(axis=1)
        at_once |= (telemetry.position[:, 2] < LOW) | (passed > MAX_WAIT)
        settled = np.linalg.norm(telemetry.velocity, axis=1) <= SETTLED
        settled |= passed > SETTLING_TIME
        velocity = np.zeros((len(up), 3))
        height = np.nan_to_num(position[:, 2])
        for row in sorted(np.flatnonzero(pending).tolist(), key=lambda row: height[row]):
            if row in self._aside:
                way = self._aside[row] - position[row, :2]
                length = float(np.linalg.norm(way))
                velocity[row, :2] = way * min(1.0, SPEED / max(length, SETTLED))
                free = length <= SETTLED
            else:
                below = ~pending | (height < height[row])
                free = _clear(position[row, :2], position[below, :2])
            if at_once[row] or (free and settled[row]):
                self._vehicles[row].land()
                pending[row] = False
            elif not free and row not in self._aside:
                busy = (up & ~pending).any() or pending[list(self._aside)].any()
                self._wait(row, position, busy=bool(busy))
        yaw = np.nan_to_num(telemetry.heading)
        return Setpoint(to_map.turn_back(velocity), yaw, pending)

    def _wait(self, row: int, position: Array, *, busy: bool) -> None:
        """Let an agent that is above another wait, or choose where it lands."""
        name = self._scene.agents[row].name
        if row not in self._waiting:
            self._waiting.add(row)
            self._report(f"{name} waits: it is above another agent")
        if not busy:
            self._aside[row] = self._nearest_free(row, position)
            away = math.dist(self._aside[row], position[row, :2])
            self._report(f"{name} lands {away:.2f} m aside")

    def _nearest_free(self, row: int, position: Array) -> Array:
        """Return the nearest free position, (2,) m; the agent's own if none is near."""
        here, world = position[row], self._scene.world
        low, high = self._scene.limits.height
        heights = float(np.clip(here[2], low, high)), low
        others = np.delete(position, row, axis=0)[:, :2]
        for radius in np.arange(SEARCH_STEP, SEARCH_RADIUS, SEARCH_STEP):
            for angle in np.arange(0.0, math.tau, SEARCH_STEP / radius):
                x, y = here[0] + radius * math.cos(angle), here[1] + radius * math.sin(angle)
                if _clear(np.array([x, y]), others, EXTRA_CLEARANCE) and not any(
                    world.fault((x, y, z)) for z in heights
                ):
                    return np.array([x, y])
        return position[row, :2].copy()

    def _end(self, passed: float, up: Mask) -> None:
        """Determine whether the landings are over."""
        if self.over or passed < MIN_TIME or (up.any() and passed < TIMEOUT):
            return
        self.over = True
        late = self._scene.named(np.flatnonzero(up))
        end = f"{late} did not report to be on the ground" if late else "all agents have landed"
        self._report(f"{end}, after {passed:.1f} s")


def _clear(position: Array, others: Array, extra: float = 0.0) -> bool:
    """Whether a position, (2,) m, is clear of others, (K, 2); unknown ones are not considered."""
    return not (np.linalg.norm(others - position, axis=1) < CLEARANCE + extra).any()
