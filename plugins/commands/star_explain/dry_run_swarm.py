"""The agents of a dry run: they follow their goals and commands exactly."""

from __future__ import annotations

import math

import numpy as np

from star_core import (
    AgentPhase,
    Array,
    Command,
    Estimate,
    Goals,
    Health,
    Order,
    Rows,
    Scene,
    Transform,
)

CHARGED = 4.0  # V
NO_TIME = 1e-9  # s: rounding error of a clock


class DryRunSwarm:
    """State of every agent in a dry run.

    A flying agent goes straight to its goal at the goal's speed, through obstacles, and turns
    instantly. A commanded climb or landing takes the commanded time.

    Args:
        scene: The mission's scene.

    Attributes:
        scene: The mission's scene.
        position: (N, 3) m.
        phase: (N,) `AgentPhase`.
        yaw: (N,) rad.
    """

    def __init__(self, scene: Scene) -> None:
        n = len(scene.agents)
        self.scene = scene
        self.position: Array = np.array([agent.start for agent in scene.agents], np.float64)
        self.phase: Rows = np.full(n, int(AgentPhase.GROUNDED))
        self._velocity: Array = np.zeros((n, 3))
        self.yaw: Array = np.array([agent.yaw for agent in scene.agents], np.float64)
        self._ready = np.full(n, np.inf)  # s, end of the current on-board command
        self._height = np.zeros(n)  # m, height at that time
        self._targets = len(dict.fromkeys(tag.of for tag in scene.world.targets))

    def estimate(self, time: float) -> Estimate:
        """Return the exact estimate of all agents."""
        n = len(self.phase)
        return Estimate(
            time=time,
            position=self.position.copy(),
            velocity=self._velocity.copy(),
            yaw=self.yaw.copy(),
            covariance=np.zeros((n, 3, 3)),
            valid=np.ones(n, np.bool_),
            map_from_odom=Transform(np.zeros(n), np.zeros((n, 3))),
        )

    def health(self) -> Health:
        """Return the health of all agents: charged and connected; no target found."""
        n = len(self.phase)
        unfound = np.full(self._targets, -1)
        return Health(self.phase.copy(), np.full(n, CHARGED), np.zeros(n), unfound)

    def execute(self, command: Command, time: float) -> None:
        """Begin an on-board command."""
        rows = command.agent
        if command.order is Order.STOP:
            self.phase[rows] = AgentPhase.LANDED
        elif command.order in {Order.TAKEOFF, Order.LAND}:
            climbs = command.order is Order.TAKEOFF
            self.phase[rows] = AgentPhase.TAKING_OFF if climbs else AgentPhase.LANDING
            self._height[rows] = command.position[:, 2]
            self._ready[rows] = time + command.duration
        elif command.order is Order.GOTO:
            self.position[rows] = command.position

    def move(self, goals: Goals | None, rows: tuple[int, ...], time: float) -> None:
        """Advance some agents by one tick, which ends at `time`, s."""
        for row in rows:
            if self._ready[row] <= time + NO_TIME:
                climbed = self.phase[row] == AgentPhase.TAKING_OFF
                self.phase[row] = AgentPhase.FLYING if climbed else AgentPhase.LANDED
                self.position[row, 2] = self._height[row]
                self._ready[row] = np.inf
                self._velocity[row] = 0.0
            elif goals is not None and goals.active[row] and self.phase[row] == AgentPhase.FLYING:
                self._fly(row, goals)

    def _fly(self, row: int, goals: Goals) -> None:
        way = goals.position[row] - self.position[row]
        far = math.sqrt(float(way @ way))
        speed = min(float(goals.speed[row]), self.scene.limits.speed)
        step = way * min(1.0, speed * self.scene.period / far) if far > 0 else way
        self.position[row] += step
        self._velocity[row] = step / self.scene.period
        self.yaw[row] = goals.yaw[row]
