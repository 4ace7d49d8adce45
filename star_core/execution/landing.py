"""Landings: each agent comes to rest first, clear of agents and obstacles below it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core.execution.goal_buffer import GoalBuffer
from star_core.geometry.obstacle_distance import distance
from star_core.messages.arrays import Array, Mask
from star_core.messages.commands import Command
from star_core.messages.state import AgentPhase, Estimate, among
from star_core.observers import Observers
from star_core.scene import Scene
from star_core.toolkit.timeouts import timeout
from star_core.vehicle_interface import VehicleInterface

PLACE: Final = 0.25
"""How far from each other two must come down, in the plane, m: they collide at 0.12 m."""

BESIDE: Final = 0.1
"""How far from an obstacle below it an agent may come down, in the plane, m."""

ASIDE: Final = 0.1
"""Additional clearance of a landing position that an agent moves aside to, m."""

RING: Final = 0.05
"""How finely places to come down at are looked for, m."""

FARTHEST: Final = 3.0
"""How far away they are looked for, m."""

SETTLED: Final = 0.1
"""What an agent that comes down is slower than, m/s; and how near to its place, m."""

GRACE: Final = 2.0
"""How long an agent may take to come to rest, s."""


@dataclass(slots=True)
class _Landing:
    """A landing that is to be ordered.

    Attributes:
        duration: How long it is to take, s; NaN is at the core's own pace.
        until: When it is ordered at the latest, s.
        spot: (2,) where to come down, m; None until the agent is at rest.
        height: At which to go there, m.
    """

    duration: float
    until: float
    spot: Array | None = None
    height: float = 0.0


class LandingManager:
    """Holds landings back until they can be commanded.

    An on-board commander lands from where it is told to, straight down, blind, and its drone keeps
    the speed it has. So an agent in flight is led to rest at first, by planner, avoider and safety
    filter, where no agent and no obstacle is below it: in place, or at the nearest free spot that
    the planner flies to. One that cannot be steered, or does not get there in time, lands where it
    is.

    Args:
        scene: The agents and the world.
        vehicles: Sends the commands.
        observers: Receive an event for each agent that lands aside.
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

    @property
    def until(self) -> float:
        """When the last landing that is held back is ordered at the latest, s; 0 if none is."""
        return max((one.until for one in self._waiting.values()), default=0.0)

    def ask(self, command: Command) -> None:
        """Have a task's order to land given in time."""
        for row, duration in zip(command.agent.tolist(), command.duration.tolist(), strict=True):
            self._waiting.setdefault(row, _Landing(duration, self._vehicles.time + GRACE))

    def bring(self, rows: Iterable[int]) -> None:
        """Land agents at the core's own pace."""
        for row in rows:
            self._waiting.setdefault(int(row), _Landing(math.nan, self._vehicles.time + GRACE))

    def step(self, estimate: Estimate, wishes: GoalBuffer) -> None:
        """Command the landings that are possible; give goals to the other agents."""
        if not self._waiting:
            return
        phases = self._vehicles.phases.of_agents()
        steered = (phases == AgentPhase.FLYING) & estimate.valid
        self._vehicles.release(self._waiting)
        ready = []
        for row in sorted(self._waiting, key=lambda row: (estimate.position[row, 2], row)):
            landing = self._waiting[row]  # lowest first: it keeps its position
            here, velocity = estimate.position[row], estimate.velocity[row]
            if not steered[row] or self._vehicles.time >= landing.until:
                ready.append(row)
                continue
            slow = float(np.linalg.norm(velocity)) <= SETTLED
            if landing.spot is None and slow:
                self._lead_aside(row, landing, estimate)
            if landing.spot is None:  # where it is: it brakes
                wishes.send(row, here, float(estimate.yaw[row]), self._scene.limits.speed)
            elif slow and math.dist(landing.spot, here[:2]) <= SETTLED:
                ready.append(row)
            else:
                goal = np.array([*landing.spot, landing.height])
                wishes.send(row, goal, float(estimate.yaw[row]), self._scene.limits.speed)
        takes = np.array([self._waiting.pop(row).duration for row in ready])
        self._vehicles.land(np.array(ready, np.int64), estimate, takes)

    def _lead_aside(self, row: int, landing: _Landing, estimate: Estimate) -> None:
        """Choose where an agent at rest comes down: here, or at the nearest free place."""
        here = estimate.position[row]
        low, high = self._scene.limits.height
        landing.height = min(max(float(here[2]), low), high)
        landing.spot = self._spot(row, here[:2], estimate, landing.height)
        way = math.dist(landing.spot, here[:2])
        if way > 0:
            landing.until = self._vehicles.time + timeout(way / self._scene.limits.speed, GRACE)

    def _spot(self, row: int, here: Array, estimate: Estimate, height: float) -> Array:
        """Return the nearest free place that an agent is led to at a height: (2,) m."""
        taken = self._taken(row, estimate)
        top = float(estimate.position[row, 2])
        if self._free(here[None], taken, top, 0.0)[0]:
            return here
        name = self._scene.agents[row].name
        for ring in np.arange(RING, FARTHEST, RING):
            angle = np.linspace(0.0, math.tau, math.ceil(math.tau * ring / RING), endpoint=False)
            places = here + ring * np.column_stack([np.cos(angle), np.sin(angle)])
            free = self._free(places, taken, top, ASIDE)
            level = np.full(np.count_nonzero(free), height)
            free[free] = ~self._refuses(np.column_stack([places[free], level]))
            if free.any():
                text = f"{name} lands {ring:.2f} m aside: its place is not free"
                self._observers.event("landing", text, name)
                spot: Array = places[np.argmax(free)]
                return spot
        self._observers.event("landing", f"{name} finds no free place to land", name)
        return here

    def _taken(self, row: int, estimate: Estimate) -> Array:
        """Where others are on the ground, come down, or are below an agent: (K, 2) m."""
        phases = self._vehicles.phases.of_agents()
        position = estimate.position
        flies = among(phases, AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LOST)
        others = ~flies | (position[:, 2] < position[row, 2])
        others[row] = False
        spots = {agent: one.spot for agent, one in self._waiting.items() if one.spot is not None}
        others[list(spots)] = False  # they come down elsewhere than where they are
        others &= np.isfinite(position).all(axis=1)
        return np.concatenate([position[others, :2], np.array(list(spots.values())).reshape(-1, 2)])

    def _free(self, places: Array, taken: Array, top: float, more: float) -> Mask:
        """Whether (K, 2) places, m, are clear of all that is below `top`, m, by so much `more`."""
        away = np.linalg.norm(places[:, None] - taken[None], axis=2)
        free: Mask = (away >= PLACE + more).all(axis=1)
        fence = self._scene.world.fence
        low, high = np.array(fence.low[:2]) + more, np.array(fence.high[:2]) - more
        if more:
            free &= ((places >= low) & (places <= high)).all(axis=1)
        for obstacle in self._scene.world.obstacles:
            foot, crest = obstacle.height
            if foot < top:
                level = np.full((len(places), 1), min(top, crest))
                free &= distance(np.hstack([places, level]), obstacle) >= BESIDE + 2 * more
        return free
