"""The check of tasks: agents that are points do what a task commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from star_core.contracts import Status, Task
from star_core.errors import ContractError
from star_core.execution.instructions import GoalDraft, Instructions
from star_core.messages.arrays import Mask
from star_core.messages.state import AgentPhase, Estimate, Goals, Setpoint
from star_core.plugin_support.guard import require_methods
from star_core.plugin_support.outputs import checked_timeout
from star_core.testing.calls import (
    SIZES,
    Times,
    agents_of,
    called_alike,
    close_all,
    labeled,
    reported,
    require_same,
)
from star_core.testing.inputs import scene
from star_core.testing.point_masses import PointMasses, straight_velocity
from star_core.world.scene import Scene

TASK_TIME: Final = 4.0  # s, for which a task is called if it is not over before
HEIGHT: Final = 0.8  # m, of agents that fly when it begins

UNLOCATED: Final = range(5, 8)  # ticks of a task in which its first agent is not located
CHANGES: Final[Mapping[int, tuple[str, Callable[[tuple[int, ...]], tuple[int, ...]]]]] = {
    20: ("on_agents_removed", lambda rows: rows[1:]),
    30: ("on_agent_replaced", lambda rows: (*rows[:-1], 1)),
    40: ("on_agents_added", lambda rows: (*rows, 0)),
}
"""Changes of a task's agents, by the tick: its method, and its rows after it."""


def check_task(
    make: Callable[[Scene, tuple[int, ...]], Task],
    scene: Callable[[int], Scene] = scene,
    phase: AgentPhase = AgentPhase.FLYING,
) -> Times:
    """Check that a task has goals and commands for its own agents only, all of them finite.

    Every second agent is its own. They fly exactly to its goals, and do what it commands. The first
    is not located for a while; later one leaves, one is replaced, and one is added, if the task has
    the methods for that.

    Args:
        make: Makes the task for some rows of a scene.
        scene: As of all checks.
        phase: Of the agents when it begins: GROUNDED for a verb that takes off.

    Raises:
        ContractError: It does not.
    """
    means = {}
    for n in SIZES:
        room, rows = scene(n), tuple(range(0, n, 2))
        tasks = [make(room, rows) for _ in range(2)]
        require_methods(tasks[0], Task)
        starts = np.array([agent.start for agent in room.agents])
        starts[:, 2] = 0.0 if phase is AgentPhase.GROUNDED else HEIGHT
        swarm = PointMasses(starts, phase=phase)
        instructions = Instructions(GoalDraft(Goals.none(n)))
        trajectories = getattr(tasks[0], "trajectories", ())
        took, status = [0.0], Status.RUNNING
        for tick in range(int(TASK_TIME / room.period)):
            if status is not Status.RUNNING:
                break
            lost = (np.arange(n) == 0) & (tick in UNLOCATED)
            inputs = _without(lost, swarm.estimate()), swarm.health()
            with labeled(f"task of {agents_of(n)}, tick {tick}"):
                if not tick:
                    require_same(*(checked_timeout(task.begin(*inputs)) for task in tasks))
                rows = _changed(tasks, rows, tick) if n > 1 else rows
                output, elapsed = called_alike(tasks, "step", inputs)
                took.append(elapsed)
                members = np.isin(np.arange(n), rows)
                status = instructions.add(output, members, trajectories).status
                if status is Status.FAILURE and not output.reason:
                    raise ContractError("failed without TaskOutput.reason, which users are shown")
                for command in output.commands:
                    swarm.command(command)
                target = instructions.goals.goals()
                velocity = straight_velocity(swarm.position, target, room.period)
                swarm.send(Setpoint(velocity, target.yaw, target.active & swarm.steered()))
                swarm.wait(swarm.time + room.period)
        close_all(tasks)
        means[n] = float(np.mean(took[2:] or took))
    return reported(tasks[0], means)


def _changed(tasks: Sequence[Task], rows: tuple[int, ...], tick: int) -> tuple[int, ...]:
    """Change the agents of a task if it has a method for the change of a tick; return the rows."""
    if tick not in CHANGES:
        return rows
    method, change = CHANGES[tick]
    after = change(rows)
    if not after or len(set(after)) < len(after) or not hasattr(tasks[0], method):
        return rows
    for task in tasks:
        getattr(task, method)(*((rows[-1], 1) if method == "on_agent_replaced" else (after,)))
    return after


def _without(lost: Mask, estimate: Estimate) -> Estimate:
    """Return an estimate in which some agents are not located."""
    gone = np.where(lost, np.nan, 0.0)
    return replace(estimate, position=estimate.position + gone[:, None], valid=~lost)
