"""The task ``external``: agents fly to goals from another process or an installed planner."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from star_core import Estimate, Goals, Health, Scene, Status, TaskOutput
from star_external.planner import Answer, Done, Failed, Goal
from star_external.protocol import DEFAULT_TIMEOUT


@dataclass(frozen=True, slots=True)
class Hold:
    """The agents should hold their positions."""


class Source(Protocol):
    """Source of a step's goals: another process, or a planner in this one.

    Attributes:
        messages: For the log, until the step takes them.
    """

    messages: list[str]

    def poll(
        self, estimate: Estimate, health: Health, agents: Mapping[str, int]
    ) -> Iterable[Answer | Hold]:
        """Yield the answers since the last tick, in order; none follows `Done` or `Failed`.

        Args:
            estimate: Of this tick.
            health: Of this tick.
            agents: Row of each agent in the step, by name.
        """
        ...

    def close(self) -> None:
        """Release all resources."""
        ...


class External:
    """Sends agents to the goals of a source.

    An agent keeps its goal until it receives another. A replacement inherits the goal of the agent
    it replaces.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        source: Source of the goals.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], source: Source) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._source = source
        self.on_agents_added(rows)
        self._position, self._velocity = np.zeros((n, 3)), np.zeros((n, 3))
        self._yaw, self._speed = np.zeros(n), np.zeros(n)
        self._active = np.zeros(n, np.bool_)

    def begin(self, estimate: Estimate, health: Health) -> float:
        return DEFAULT_TIMEOUT

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        output = self._step(estimate, health)
        messages, self._source.messages = tuple(self._source.messages), []
        return replace(output, messages=messages) if messages else output

    def _step(self, estimate: Estimate, health: Health) -> TaskOutput:
        for answer in self._source.poll(estimate, health, self._row_of):
            match answer:
                case Done():
                    return TaskOutput(status=Status.SUCCESS)
                case Failed(why):
                    return TaskOutput(status=Status.FAILURE, reason=why)
                case Hold():
                    self._stop(estimate)
                case goals:
                    self._aim(goals, estimate)
        return TaskOutput(self._goals() if self._active.any() else None)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        self.on_agents_added(rows)
        self._active &= np.isin(np.arange(len(self._active)), rows)

    def on_agents_added(self, rows: tuple[int, ...]) -> None:
        self._row_of = {self._scene.agents[row].name: row for row in rows}

    def on_agent_replaced(self, old: int, new: int) -> None:
        self.on_agents_added(tuple(new if row == old else row for row in self._row_of.values()))
        for table in (self._position, self._velocity, self._yaw, self._speed, self._active):
            table[new] = table[old]
        self._active[old] = False

    def close(self) -> None:
        self._source.close()

    def _aim(self, goals: Mapping[str, Goal], estimate: Estimate) -> None:
        for name, goal in goals.items():
            row = self._row_of[name]
            if goal.yaw is not None:
                self._yaw[row] = goal.yaw
            elif not self._active[row]:
                self._yaw[row] = estimate.yaw[row] if estimate.valid[row] else 0.0
            self._position[row], self._velocity[row] = goal.position, goal.velocity
            self._speed[row] = goal.speed or self._scene.limits.speed
            self._active[row] = True

    def _stop(self, estimate: Estimate) -> None:
        """Make each agent's position its goal; an agent without an estimate keeps its goal."""
        self._velocity[:] = 0.0
        rows = [row for row in self._row_of.values() if estimate.valid[row]]
        self._position[rows], self._yaw[rows] = estimate.position[rows], estimate.yaw[rows]
        self._speed[rows] = self._scene.limits.speed
        self._active[rows] = True

    def _goals(self) -> Goals:
        return Goals(
            position=self._position.copy(),
            velocity=self._velocity.copy(),
            yaw=self._yaw.copy(),
            speed=self._speed.copy(),
            active=self._active.copy(),
        )
