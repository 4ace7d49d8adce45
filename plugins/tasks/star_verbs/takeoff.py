"""The verbs ``takeoff`` and ``join``: climb straight up and hover there."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import AgentPhase, Command, Estimate, Goals, Health, Order, Scene, Status, TaskOutput
from star_core.toolkit import shortlist, timeout
from star_verbs.step_agents import StepAgents, import_assignment

MIN_DURATION: Final = 1.0  # s
MAX_HEIGHT_ERROR: Final = 0.15  # m: at which an agent has taken off
AIRBORNE: Final = (AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LANDING)
UP: Final = (*AIRBORNE, AgentPhase.LOST)
CLEARANCE: Final = 0.5  # m: least horizontal distance of flying agents from one that joins


class Takeoff:
    """Commands a climb by the on-board commanders, and a goal above each agent's position.

    It waits until all its agents are located, and fails at once if one is airborne already.

    The arguments beside scene and rows are the verb's options.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], *, height: float, speed: float) -> None:
        import_assignment(len(scene.agents))
        self._agents = StepAgents(scene, rows)
        self._height = height
        self._speed = min(speed, scene.limits.speed)
        self._goals: Goals | None = None

    def begin(self, estimate: Estimate, health: Health) -> float:
        lowest = min(agent.start[2] for agent in self._agents.scene.agents)
        return timeout(max(MIN_DURATION, (self._height - lowest) / self._speed))

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        rows, scene = self._agents.rows, self._agents.scene
        phase = health.phase[rows]
        if self._goals is None:
            flying = rows[np.isin(phase, AIRBORNE)]
            if len(flying):
                names = scene.named(flying.tolist())
                return TaskOutput(status=Status.FAILURE, reason=f"already in the air: {names}")
            if not self._agents.located(estimate):
                return TaskOutput()
            return self._climb(estimate)
        error = abs(estimate.position[rows, 2] - self._height)
        done = (
            bool((phase == AgentPhase.FLYING).all())
            and self._agents.located(estimate)
            and float(error.max()) <= MAX_HEIGHT_ERROR
        )
        return TaskOutput(self._goals, status=Status.SUCCESS if done else Status.RUNNING)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        self._agents.keep(rows)
        if self._goals is not None:
            kept = self._agents.rows
            top, yaw = self._goals.position[kept], self._goals.yaw[kept]
            self._goals = self._agents.goals(top, yaw, self._speed)

    def _climb(self, estimate: Estimate) -> TaskOutput:
        rows = self._agents.rows
        top = estimate.position[rows]
        climb = np.maximum(self._height - top[:, 2], 0.0)
        top[:, 2] = self._height
        yaw = estimate.yaw[rows]
        self._goals = self._agents.goals(top, yaw, self._speed)
        duration = np.maximum(climb / self._speed, MIN_DURATION)
        return TaskOutput(self._goals, (Command(Order.TAKEOFF, rows, top, yaw, duration),))


class Join(Takeoff):
    """A take-off of agents that are ready: connected, charged, and with no agent above them.

    The arguments beside scene and rows are the verb's options.
    """

    def __init__(
        self, scene: Scene, rows: tuple[int, ...], *, height: float, speed: float, battery: float
    ) -> None:
        super().__init__(scene, rows, height=height, speed=speed)
        self._battery = battery

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if self._goals is None and (fault := self._fault(estimate, health)):
            return TaskOutput(status=Status.FAILURE, reason=fault)
        return super().step(estimate, health)

    def _fault(self, estimate: Estimate, health: Health) -> str:
        """Return which agents cannot take off, and why; empty if all can."""
        scene, faults = self._agents.scene, []
        for row in self._agents.rows.tolist():
            name = scene.agents[row].name
            voltage = float(health.battery[row])
            if math.isnan(voltage) or voltage < self._battery:
                faults.append(
                    f"the battery of {name} is at {voltage:.2f} V, {self._battery:g} V needed"
                )
            offset = estimate.position - estimate.position[row]
            above = np.isin(health.phase, UP) & (offset[:, 2] > 0.0)
            above &= np.hypot(*offset[:, :2].T) < CLEARANCE
            if above.any():
                faults.append(f"{scene.named(np.flatnonzero(above).tolist())} is above {name}")
        return shortlist(faults, "; ")
