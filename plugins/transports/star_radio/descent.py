"""Lands a swarm without its mission: each agent in place, one above another after it and aside."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from star_core import Array, Mask, Scene, Setpoint, Telemetry, Transform
from star_radio.transport import Radio

CLEARANCE: Final = 0.25  # m in the plane, between two landings
EXTRA_CLEARANCE: Final = 0.1  # m, added where an agent moves aside
SEARCH_STEP: Final = 0.05  # m, between the positions that are tried
SEARCH_RADIUS: Final = 3.0  # m
SPEED: Final = 0.3  # m/s, to move aside
MAX_REST_SPEED: Final = 0.1  # m/s; of an agent that can land
ARRIVAL_TOLERANCE: Final = 0.1  # m, its greatest distance from the position to land at
SETTLING_TIME: Final = 2.0  # s that an agent may take to come to rest
LOW: Final = 0.15  # m: an agent below lands at once
MAX_REPORT_AGE: Final = 0.5  # s: an agent that is not heard for longer lands at once
MAX_WAIT: Final = 10.0  # s: after it all agents land
MIN_TIME: Final = 2.0  # s: a take-off that was commanded last may begin so late


class Descent:
    """Landings of all agents, by their reports only.

    Agents brake first. Those with no agent below land. The others hover until these are down, then
    fly aside to the nearest free position, one after the other, and land. It is over when no agent
    may be in the air: one whose link is lost in a take-off is waited for, and landed when its link
    returns.

    Args:
        radio: The links to the agents.
        scene: The agents and the world.
        now: Clock, s.
        report: Called with lines for the log.

    Attributes:
        over: Whether all agents are down.
        begins: Whether a take-off that was commanded last may yet begin.
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
        self._waiting: set[int] = set()  # rows that are above another
        self._aside: dict[int, Array] = {}  # (2,) positions to land at, m, by row
        self.over = False
        self.begins = True

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
        ready = np.array([not (one.lands or one.stopped) for one in self._vehicles])
        ready &= ~heard | np.array([vehicle.airborne for vehicle in self._vehicles])
        pending = up & ready
        position = to_map.apply(telemetry.position)
        at_once = ~heard | ~np.isfinite(position).all(axis=1)
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
                below = ~pending | (height < height[row])
                free = _clear(position[row, :2], position[below, :2])
            if at_once[row] or (free and settled[row]):
                self._radio.landings.land(row, float(telemetry.position[row, 2]))
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
        self.begins = passed < MIN_TIME
        if not (self.over or self.begins or up.any()):
            self.over = True
            if fallen := self._radio.assumed_down():
                self._report(self._radio.describe(fallen))
            self._report(
                f"all agents {'are down' if fallen else 'have landed'}, after {passed:.1f} s"
            )


def _clear(position: Array, others: Array, extra: float = 0.0) -> bool:
    """Whether a position, (2,) m, is clear of others, (K, 2); unknown ones are not considered."""
    return not (np.linalg.norm(others - position, axis=1) < CLEARANCE + extra).any()
