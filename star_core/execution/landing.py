"""Landings: each agent comes to rest first, clear of agents and obstacles below it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core.execution.instructions import GoalDraft
from star_core.geometry.free_position import AGENT_CLEARANCE, MAX_DRIFT, free_position
from star_core.messages.arrays import Array, Mask, Rows, some
from star_core.messages.commands import Command, Order
from star_core.messages.position_margin import MAX_MARGIN_RATIO, position_margin
from star_core.messages.state import AgentPhase, Estimate, among
from star_core.messages.telemetry import Supervisor, Telemetry
from star_core.observers import Observers
from star_core.safety.agents_in_the_way import MAX_REPORT_AGE
from star_core.toolkit.landing_time import min_landing_time
from star_core.toolkit.timeouts import timeout
from star_core.vehicle_interface import VehicleInterface
from star_core.world.scene import Scene

TRAVEL_POINTS: Final = 11  # possible positions of an agent that is not heard, 0.1 m apart or less
MAX_REST_SPEED: Final = 0.1  # m/s; of an agent that can land
ARRIVAL_TOLERANCE: Final = 0.1  # m, its greatest distance from the position to land at
SETTLING_TIME: Final = 2.0  # s that an agent may take to come to rest

LAND_SPEED: Final = 0.3  # m/s, when the core itself lands
CONTROLLER_LAG: Final = 0.5  # s, by which the firmware's default controller follows a plan late
LAG_ALLOWANCE: Final = 2 * CONTROLLER_LAG  # s, for a landing: its plan ends with the motors off
LAND_DEPTH: Final = 0.15  # m below the floor, at which it ends: drones hover up to 0.12 m too high
CLIMB_LAND_DEPTH: Final = 0.25  # m: after a climb that is broken off drones follow a plan higher
CLIMB_LAND_TIME: Final = 4.0  # s, of such a landing, and
CLIMB_LAND_TIME_PER_HEIGHT: Final = 2.5  # s/m

REPLY_TIME: Final = 0.7  # s; a report made so long after a command shows whether it was received
MAX_REPEATS: Final = 3  # of a landing; an agent that then hovers still, or reports so, has failed
LANDED_HEIGHT: Final = 0.1  # m; an agent estimated below has landed, whatever it reports
MAX_FLYING_TIME: Final = 3.0  # s that a drone reports to fly after a landing: 2 s by its firmware

HOVERS: Final = int(Supervisor.FLYING | Supervisor.COMMANDER_FINISHED)


@dataclass(slots=True)
class _Landing:
    """A landing that has yet to be commanded.

    Attributes:
        duration: Of the descent, s; NaN is at the core's own pace.
        until: Time at which it is commanded at the latest, s.
        position: (2,) to land at, m; None until the agent is at rest.
        height: Of the flight to it, m.
        descends: Whether setpoints lead it down.
    """

    duration: float
    until: float
    position: Array | None = None
    height: float = 0.0
    descends: bool = False


class LandingManager:
    """Holds landings back until they can be commanded.

    An on-board commander lands straight down from the position it is given, blind, and its drone
    keeps the speed it has. So a flying agent is first led to rest, by planner, avoider and safety
    filter, at a position with no agent and no obstacle below: its own, or the nearest free one that
    the planner flies to. The margin for its uncertain position is kept to obstacles and fence, if
    there is such a position. An agent whose flow sensor sees no motion would drift in a landing:
    setpoints lead it down to the floor. Another that cannot be steered, or does not arrive in time,
    lands from its position.

    Args:
        refuses: Returns which positions, (K, 3) m, the planner would not fly to: (K,).
    """

    def __init__(
        self,
        scene: Scene,
        vehicles: VehicleInterface,
        observers: Observers,
        refuses: Callable[[Array], Mask],
    ) -> None:
        self._scene = scene
        self._refuses = refuses
        self._vehicles = vehicles
        self._observers = observers
        self._waiting: dict[int, _Landing] = {}
        n = len(scene.agents)
        self._commanded_at = np.zeros(n)  # s, of each agent's last landing
        self._ends_at = np.zeros(n)  # s, planned
        self._repeats = np.zeros(n, np.int64)
        self._hovers_since = np.full(n, np.inf)  # s, by the reports made after that end

    @property
    def until(self) -> float:
        """Time by which all landings will have been commanded, s; 0 if none is held back."""
        return max((landing.until for landing in self._waiting.values()), default=0.0)

    @property
    def rows(self) -> list[int]:
        """Agents whose landings are held back."""
        return list(self._waiting)

    def request(self, command: Command) -> None:
        """Land agents as a task commands."""
        for row, duration in zip(command.agent.tolist(), command.duration.tolist(), strict=True):
            self._add(row, duration)

    def land(self, rows: Iterable[int]) -> None:
        """Land agents at the core's own pace."""
        for row in rows:
            self._add(int(row), math.nan)

    def land_now(self, rows: Rows, estimate: Estimate, durations: Array | float = math.nan) -> None:
        """Command agents to land from their positions, if they are in the air.

        Args:
            rows: (K,) the agents.
            estimate: Of their positions.
            durations: (K,) of the descents, s; NaN is at the core's own pace. No descent is so
                short that its drone would hit the floor fast.
        """
        phases = self._vehicles.phases.of_agents()[rows]
        up = among(phases, AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LOST)
        for row in rows.tolist():
            self._waiting.pop(row, None)
        self._repeats[rows[up]] = 0
        self._command(rows[up], estimate, np.broadcast_to(durations, up.shape)[up])

    def unheard(self, age: Array) -> Mask:
        """Return which agents are not heard after the planned end of their landings: (N,).

        Args:
            age: (N,) time since each agent was last heard, s.
        """
        landing = self._vehicles.phases.among(AgentPhase.LANDING)
        if not some(landing):
            return landing
        unheard: Mask = landing & (age > MAX_REPORT_AGE) & (self._vehicles.time > self._ends_at)
        return unheard

    def repeat_missed(self, telemetry: Telemetry, estimate: Estimate) -> None:
        """Command landings again of agents that report to hover instead: they did not receive it.

        Nor did an agent on the ground with its motors on: its commander brought it down by itself.

        A drone that lands reports so until it is down, and to fly for a while after that.

        Args:
            telemetry: Of the tick.
            estimate: Of the agents' positions.
        """
        landing = self._vehicles.phases.among(AgentPhase.LANDING)
        if not some(landing):
            return
        landing = landing & (self._repeats < MAX_REPEATS)
        reported = telemetry.time - telemetry.age
        hovers = landing & (telemetry.age <= MAX_REPORT_AGE) & (telemetry.state & HOVERS == HOVERS)
        not_begun = hovers & (reported >= self._commanded_at + REPLY_TIME)
        not_begun &= reported <= self._ends_at - REPLY_TIME
        low = estimate.position[:, 2] < LANDED_HEIGHT
        active = telemetry.state & int(Supervisor.COMMANDER_ACTIVE) != 0  # its motors are on
        hovers &= (reported > self._ends_at) & (active | ~low)
        self._hovers_since = np.where(hovers, np.fmin(self._hovers_since, reported), np.inf)
        missed = not_begun | (reported - self._hovers_since > MAX_FLYING_TIME)
        self._repeats[missed] += 1
        for row in np.flatnonzero(missed).tolist():
            name = self._scene.agents[row].name
            does = "stands with its motors on" if low[row] else "hovers"
            text = f"{name} {does} instead of landing; it is commanded to land again"
            self._observers.event("landing", text, name)
        self._command(np.flatnonzero(missed), estimate)

    def _command(self, rows: Rows, estimate: Estimate, durations: Array | float = math.nan) -> None:
        """Command (K,) agents to land, in (K,) s; NaN is at the core's own pace."""
        if not len(rows):
            return
        position = estimate.position[rows].copy()
        unknown = ~np.isfinite(position[:, 2])
        position[unknown, 2] = self._scene.limits.height[1]
        position[:, 2] = np.minimum(position[:, 2], self._scene.world.fence.high[2])
        position = np.nan_to_num(position)
        # a commander's plan begins where the previous one is, which a climbing agent trails
        rise = CONTROLLER_LAG * np.maximum(0.0, np.nan_to_num(estimate.velocity[rows, 2]))
        height = np.maximum(0.0, position[:, 2]) + rise
        climbs = self._vehicles.phases.of_agents()[rows] == AgentPhase.TAKING_OFF
        height = np.where(climbs, np.maximum(height, self._vehicles.climb_top[rows]), height)
        own_pace = height / LAND_SPEED + LAG_ALLOWANCE
        duration = np.where(np.isnan(durations), own_pace, durations)
        least = min_landing_time(height)
        least[climbs] = CLIMB_LAND_TIME + CLIMB_LAND_TIME_PER_HEIGHT * height[climbs]
        duration = np.maximum(duration, least)
        position[:, 2] = np.where(climbs, -CLIMB_LAND_DEPTH, -LAND_DEPTH)
        yaw = np.nan_to_num(estimate.yaw[rows])
        self._vehicles.send_command(Command(Order.LAND, rows, position, yaw, duration), estimate)
        self._commanded_at[rows] = self._vehicles.time
        self._ends_at[rows] = self._vehicles.time + duration
        self._hovers_since[rows] = np.inf

    def step(self, estimate: Estimate, goals: GoalDraft) -> None:
        """Command the landings that are possible; set the goals of the others."""
        if not self._waiting:
            self._vehicles.descend(())
            return
        phases = self._vehicles.phases.of_agents()
        drifts, descending = self._vehicles.drifts(), []
        steered = (phases == AgentPhase.FLYING) & estimate.valid
        self._vehicles.release(self._waiting)
        ready = []
        for row in sorted(self._waiting, key=lambda row: (estimate.position[row, 2], row)):
            landing = self._waiting[row]  # lowest first: it keeps its position
            position, velocity = estimate.position[row], estimate.velocity[row]
            if drifts[row] and not landing.descends:
                landing.descends = True
                landing.until = (
                    self._vehicles.time + max(0.0, position[2]) / LAND_SPEED + SETTLING_TIME
                )
            if drifts[row] and self._vehicles.time < landing.until:
                descending.append(row)
                continue
            if not steered[row] or self._vehicles.time >= landing.until:
                ready.append(row)
                continue
            slow = float(np.linalg.norm(velocity)) <= MAX_REST_SPEED
            if landing.position is None and slow:
                self._choose_position(row, landing, estimate)
            if landing.position is None:  # brake
                goals.set(row, position, float(estimate.yaw[row]), self._scene.limits.speed)
            elif slow and math.dist(landing.position, position[:2]) <= ARRIVAL_TOLERANCE:
                ready.append(row)
            else:
                goal = np.array([*landing.position, landing.height])
                goals.set(row, goal, float(estimate.yaw[row]), self._scene.limits.speed)
        self._vehicles.descend(descending)
        durations = np.array([self._waiting[row].duration for row in ready])
        self.land_now(np.array(ready, np.int64), estimate, durations)

    def _add(self, row: int, duration: float) -> None:
        self._waiting.setdefault(row, _Landing(duration, self._vehicles.time + SETTLING_TIME))

    def _choose_position(self, row: int, landing: _Landing, estimate: Estimate) -> None:
        """Set where an agent at rest lands: at its position, or the nearest free one."""
        position = estimate.position[row]
        low, high = self._scene.limits.height
        landing.height = min(max(float(position[2]), low), high)
        landing.position = self._nearest_free(row, estimate, landing.height)
        way = math.dist(landing.position, position[:2])
        if way > 0:
            duration = timeout(way / self._scene.limits.speed, SETTLING_TIME)
            landing.until = self._vehicles.time + duration

    def _nearest_free(self, row: int, estimate: Estimate, height: float) -> Array:
        """Return the nearest free position that an agent can fly to at a height: (2,) m."""
        start, world = estimate.position[row], self._scene.world
        taken, apart = self._taken(row, estimate)
        name = self._scene.agents[row].name
        drift = float(self._drift(estimate)[row])

        def accepts(candidates: Array) -> Mask:
            level = np.full(len(candidates), height)
            return ~self._refuses(np.column_stack([candidates, level]))

        for margin in (drift, 0.0) if drift else (0.0,):  # rather nearer to a wall than nowhere
            nearest = free_position(start, world, taken, apart, margin, accepts)
            if nearest is None:
                continue
            if away := math.dist(nearest, start[:2]):
                text = f"{name} lands {away:.2f} m aside: its position is not free"
                self._observers.event("landing", text, name)
            return nearest
        self._observers.event("landing", f"{name} finds no free position to land at", name)
        point: Array = start[:2]
        return point

    def _taken(self, row: int, estimate: Estimate) -> tuple[Array, Array]:
        """Return what agents on the ground or below an agent, and their landings, take.

        Agents that are not heard or not located take all of their possible positions. The distance
        grows by `Limits.uncertainty_margin` standard deviations of both positions.

        Returns:
            (K, 2) positions, m, and (K,) distances to keep from them, m.
        """
        phases = self._vehicles.phases.of_agents()
        position = estimate.position
        flies = among(phases, AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LOST)
        lowest = position[:, 2] + np.minimum(estimate.possible_travel[:, 2], 0.0)
        others = ~flies | (lowest < position[row, 2])
        others[row] = False
        chosen = {
            agent: landing.position
            for agent, landing in self._waiting.items()
            if landing.position is not None
        }
        others[list(chosen)] = False  # they land elsewhere
        others &= np.isfinite(position).all(axis=1)
        shares = np.linspace(0.0, 1.0, TRAVEL_POINTS) if estimate.possible_travel.any() else [0.0]
        travel = estimate.possible_travel[others, :2]
        landings = np.array(list(chosen.values())).reshape(-1, 2)
        drift = np.where(estimate.valid, self._drift(estimate), MAX_DRIFT)
        apart = AGENT_CLEARANCE + np.minimum(np.hypot(drift, drift[row]), MAX_DRIFT)
        return (
            np.concatenate([*(position[others, :2] + s * travel for s in shares), landings]),
            np.concatenate([np.tile(apart[others], len(shares)), apart[list(chosen)]]),
        )

    def _drift(self, estimate: Estimate) -> Array:
        """Return the margins for uncertain positions, at most `MAX_DRIFT`: (N,) m."""
        deviations = self._scene.limits.uncertainty_margin
        return position_margin(estimate.covariance, deviations, MAX_DRIFT / MAX_MARGIN_RATIO)
