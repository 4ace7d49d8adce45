"""The steps of a mission without the rest of a flight."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from star_core.contracts import Status, Task
from star_core.execution.assignments import Assignments
from star_core.execution.executor import StepExecutor
from star_core.execution.instructions import Instructions
from star_core.execution.reserves import ReserveManager
from star_core.execution.step_run import TaskPool, TickContext
from star_core.messages.state import Estimate, Goals, Health
from star_core.mission import Action, Mission
from star_core.observers import Observers
from star_core.plugin_support.compute_time import ComputeTime
from star_core.plugin_support.guard import Strikes
from star_core.plugin_support.registry import Registry
from star_core.safety.rules import Rules
from star_core.targets import Targets

MakeTask: TypeAlias = Callable[[Action, tuple[int, ...], Callable[[], Task]], Task]
"""Returns the task of a step for some rows; calls the last argument for the task of a flight."""


class MissionSteps:
    """Runs the steps of a mission by the executor of flights, with any estimates.

    Args:
        mission: Its steps.
        registry: Of their verbs.
        make: Makes the task of each step; that of a flight by default.

    Attributes:
        goals: Of the last tick.

    Raises:
        PluginError: A task cannot be made.
    """

    def __init__(
        self,
        mission: Mission,
        registry: Registry,
        make: MakeTask = lambda _action, _rows, make_task: make_task(),
    ) -> None:
        compute_time = ComputeTime(mission.scene.period, realtime=True)
        assignments = Assignments(len(mission.scene.agents), mission.reserve_rows)
        observers = self._observers = Observers({}, compute_time)
        tasks = _Tasks(mission, registry, compute_time, make)
        self._executor = StepExecutor(mission, tasks, assignments, observers, Strikes(limit=1))
        self.goals = Goals.none(len(mission.scene.agents))
        self._targets = Targets(mission.scene)
        self._rules, self._assignments = Rules(mission.scene, mission.safety), assignments
        self._reserves = (
            ReserveManager(
                mission.scene, assignments, self._rules, mission.reserve, lambda _text, _agent: None
            )
            if mission.reserve
            else None
        )

    def step(self, estimate: Estimate, health: Health) -> tuple[Status, Instructions]:
        """Run one tick, at the time of the estimate; return the mission's status, and what to do.

        As in a flight, targets are found by the sightings of the estimates, and agents that violate
        a safety rule leave the mission.

        Raises:
            PluginError: A task raises, or breaks its contract.
        """
        self._observers.begin_tick(estimate.time)
        self._targets.add(estimate.sightings, estimate.time)
        health = Health.made(health.phase, health.battery, health.age, self._targets.finder)
        excluded = [
            violator.row for violator in self._rules.violators(estimate.time, estimate, health)
        ]
        self._assignments.vacate(excluded)
        tick = TickContext(estimate.time, estimate, health, {}, {}, {}, self.goals)
        status, instructions = self._executor.step(tick)
        if self._reserves is not None:
            self._reserves.step(tick, instructions)
        self.goals = instructions.goals.finish()
        instructions.leave |= {*excluded}
        return status, instructions

    def close(self) -> list[str]:
        """Close every task; return their errors."""
        return self._executor.close()


class _Tasks(TaskPool):
    """The tasks of the steps, made by another function.

    Args:
        mission: Its steps.
        registry: Where verbs are found.
        compute_time: Measures each task.
        make: Makes the tasks.
    """

    def __init__(
        self, mission: Mission, registry: Registry, compute_time: ComputeTime, make: MakeTask
    ) -> None:
        self._make_task = make
        super().__init__(mission, registry, compute_time)

    def make(self, action: Action, rows: tuple[int, ...]) -> Task:
        return self._make_task(action, rows, lambda: super(_Tasks, self).make(action, rows))
