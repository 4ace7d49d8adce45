"""A swarm of points that flies one task: planner, commanders and phases, without a core."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from star_core import (
    AgentPhase,
    Array,
    Command,
    Estimate,
    Goals,
    Health,
    Mask,
    Order,
    Scene,
    Status,
    Task,
    TaskOutput,
)
from star_core.testing import PointMasses
from star_core.toolkit import fill_defaults
from star_straight import star_planners
from star_verbs.specs import SPECS

SPEC = {spec.name: spec for spec in SPECS}
(STRAIGHT,) = star_planners()


def all_located(_time: float) -> Mask:
    return np.ones(1, np.bool_)


@dataclass
class Flown:
    """What became of a task."""

    limit: float
    status: Status = Status.RUNNING
    reason: str = ""
    time: float = 0.0
    commands: list[Command] = field(default_factory=list)
    goals: list[Goals | None] = field(default_factory=list)
    position: list[Array] = field(default_factory=list)
    yaw: list[Array] = field(default_factory=list)

    @property
    def track(self) -> Array:
        """(T, N, 3) where the agents were."""
        return np.array(self.position)

    @property
    def end(self) -> Array:
        return self.position[-1]


def estimate_of(swarm: PointMasses, located: Mask) -> Estimate:
    """Return the estimate; NaN for agents that are not located."""
    whole = swarm.estimate()
    valid = located & np.ones(len(swarm.phase), np.bool_)
    gone = np.where(valid, 0.0, np.nan)
    return replace(
        whole,
        position=whole.position + gone[:, None],
        velocity=whole.velocity + gone[:, None],
        yaw=whole.yaw + gone,
        valid=valid,
    )


def fly(
    task: Task,
    scene: Scene,
    start: Any,
    *,
    phase: AgentPhase = AgentPhase.FLYING,
    located: Callable[[float], Mask] = all_located,
    stuck: Callable[[float], Mask] = lambda _time: np.zeros(1, np.bool_),
    longest: float = 120.0,
) -> Any:
    """Fly a task until it is over, or for `longest` seconds; return what became of it, `Flown`.

    Trajectories are not flown on board: planners lead agents along them.
    """
    planner = STRAIGHT.make(scene, **fill_defaults({}, STRAIGHT.options))
    swarm = PointMasses(start, phase=phase)
    flown = Flown(limit=task.begin(estimate_of(swarm, located(0.0)), swarm.health()))
    goals = Goals.none(len(scene.agents))
    for tick in range(round(longest / scene.period)):
        flown.time = tick * scene.period
        now = estimate_of(swarm, located(flown.time))
        flown.position.append(swarm.position.copy())
        flown.yaw.append(swarm.yaw.copy())
        step = task.step(now, swarm.health())
        goals = step.goals or goals
        flown.goals.append(step.goals)
        flown.commands += step.commands
        flown.status, flown.reason = step.status, step.reason
        if step.status is not Status.RUNNING:
            break
        for command in step.commands:
            if command.order is not Order.FOLLOW:
                swarm.command(command)
        planned = planner.plan(now, goals).setpoint
        led = planned.active & swarm.steered() & ~stuck(flown.time)
        swarm.send(replace(planned, active=led))
        swarm.wait((tick + 1) * scene.period)
    return flown


def make(verb: str, scene: Scene, rows: tuple[int, ...], **options: Any) -> Any:
    """Make a verb's task as the core does."""
    spec = SPEC[verb]
    return spec.make(scene, rows, **fill_defaults(options, spec.options))


def problems(
    verb: str, scene: Scene, rows: tuple[int, ...], **options: Any
) -> list[tuple[tuple[str | int, ...], str]]:
    """Return what a verb's check finds."""
    spec = SPEC[verb]
    assert spec.check is not None
    faults = spec.check(scene, rows, **fill_defaults(options, spec.options))
    return [(problem.path, problem.message) for problem in faults]


class Changing:
    """A task that is notified of a change at a time, s."""

    def __init__(self, task: Task, when: float, method: str, *about: Any) -> None:
        self._task = task
        self._when = when
        self._change: tuple[str, tuple[Any, ...]] | None = (method, about)

    def begin(self, estimate: Estimate, health: Health) -> float:
        return self._task.begin(estimate, health)

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if self._change and estimate.time >= self._when:
            method, about = self._change
            getattr(self._task, method)(*about)
            self._change = None
        return self._task.step(estimate, health)
