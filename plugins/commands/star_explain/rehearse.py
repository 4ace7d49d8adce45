"""Rehearses a mission: the executor of flights runs its steps, with agents that are points."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from operator import attrgetter
from typing import Final

import numpy as np

from star_core import (
    AgentPhase,
    Array,
    Command,
    Health,
    Mission,
    Order,
    PluginError,
    Registry,
    Setpoint,
    Status,
    Task,
    TransportSpec,
)
from star_core.testing import MissionSteps, PointMasses
from star_core.toolkit import Action, Node, Rehearsal, freeze, min_landing_time
from star_explain.rehearsed_task import RehearsedTask
from star_explain.sighting import Lookout
from star_explain.steering import Steering

TICK: Final = 0.1  # s
SPEED_SHARE: Final = 0.87
"""Share of the velocity of a setpoint that a drone flies: drag and errors of the estimate leave
those in the default world of `sim` between 0.8 and 1.1 times 0.5 m/s."""
IN_FLIGHT: Final = (AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LANDING)
FLIES: Final = np.array([phase in IN_FLIGHT for phase in AgentPhase])  # by phase
LANDED_DELAY: Final = 2.1  # s, after the end of a landing; the firmware reports flying for 2 s
SETTLING_TIME: Final = 0.9  # s, after the end of a climb, at rest vertically; in the default world
MAX_DURATION: Final = 1800.0  # s, after which further rounds of steps are left out


def rehearse(mission: Mission, registry: Registry) -> Rehearsal:
    """Return a rehearsal of a mission.

    Steps whose tasks hold resources exclusively are left out, and so are further rounds of a step
    after `MAX_DURATION`: the durations of both are unknown.
    """
    # With `realtime` set, no plugin may wait for anything.
    scene = replace(mission.scene, realtime=True, period=TICK)
    actions: dict[int, Action] = {}

    def without_timeout(node: Node) -> Node:
        if not isinstance(node, Action):
            return node
        copy = replace(node, timeout=None)
        actions[id(copy)] = node
        return copy

    tasks = _Tasks(registry, actions)
    rehearsed = replace(mission.with_steps(without_timeout), scene=scene)
    runner = MissionSteps(rehearsed, registry, tasks.make)
    try:
        return _run(rehearsed, registry, runner, tasks)
    finally:
        runner.close()


class _Tasks:
    """The tasks of a rehearsal.

    Args:
        registry: Of their verbs.
        actions: The steps of the mission, by the `id` of those that are rehearsed.

    Attributes:
        made: Tasks, in the order in which they were made.
        late: Whether further rounds are left out from now on.
    """

    def __init__(self, registry: Registry, actions: Mapping[int, Action]) -> None:
        self._registry = registry
        self._actions = actions
        self.made: list[RehearsedTask] = []
        self.late = False

    def make(self, action: Action, rows: tuple[int, ...], make: Callable[[], Task]) -> Task:
        """Make the task of a step for some rows."""
        exclusive = self._registry.find("task", action.verb).offer.exclusive
        rehearsed = not self.late and (exclusive is None or exclusive.unless in action.written)
        limit = None if exclusive is None else exclusive.timeout
        task = RehearsedTask(self._actions[id(action)], rows, make if rehearsed else None, limit)
        self.made.append(task)
        return task


def _run(mission: Mission, registry: Registry, runner: MissionSteps, tasks: _Tasks) -> Rehearsal:
    """Run the steps until they are over."""
    scene, limits = mission.scene, mission.scene.limits
    transport = mission.plugins["transport"]
    spec: TransportSpec = registry.find("transport", transport.use).offer
    exact = spec.exact_control is not None and spec.exact_control(**transport.options)
    swarm = PointMasses(
        np.array([agent.start for agent in scene.agents]),
        np.array([agent.yaw for agent in scene.agents]),
        acceleration=limits.acceleration,
        settling={Order.TAKEOFF: 0.0 if exact else SETTLING_TIME, Order.LAND: LANDED_DELAY},
    )
    lookout, flown = Lookout(scene), np.zeros(len(scene.agents))
    steering = Steering(mission, registry)
    moments: list[tuple[float, Array, Array, Array, Array]] = []
    tick, status = 0, Status.RUNNING
    while True:
        tasks.late = swarm.time > MAX_DURATION
        try:
            estimate = swarm.estimate()
            if lookout.watches:
                flies = swarm.phase == AgentPhase.FLYING
                sightings = lookout.look(swarm.time, swarm.position, swarm.yaw, flies)
                estimate = replace(estimate, sightings=sightings)
            health = swarm.health()
            if spec.hover_voltage is not None:
                airborne = FLIES.take(swarm.phase)
                flown += TICK * airborne
                voltage = spec.hover_voltage(flown, **transport.options)
                battery = np.where(airborne, voltage, health.battery)
                health = Health.made(health.phase, battery, health.age, health.finder)
            status, instructions = runner.step(estimate, health)
        except PluginError as error:
            for task in tasks.made:
                task.fail(str(error))
            break
        for task in tasks.made:
            if task.running and (task.ended < swarm.time or status is Status.SUCCESS):
                task.end_by_condition()
        goals = runner.goals
        goal = np.where(goals.active[:, None], goals.position, np.nan)
        moment = (swarm.time, swarm.position.copy(), goal, swarm.yaw.copy(), swarm.phase.copy())
        moments.append(moment)
        if status is not Status.RUNNING:
            break
        swarm.release(instructions.free)
        for command in (*instructions.commands, *_landings(instructions.leave, swarm)):
            swarm.command(_as_sent(command, swarm.position))
        steered = swarm.steered()
        velocity = steering.velocity(estimate, goals, steered)
        velocity *= 1.0 if exact else SPEED_SHARE
        yaw = steering.heading(estimate, goals)
        swarm.send(Setpoint(velocity, yaw, goals.active & steered))
        tick += 1
        swarm.wait(tick * TICK)
    begun = sorted((task for task in tasks.made if task.begun >= 0.0), key=attrgetter("begun"))
    time, *tables = map(np.array, zip(*moments, strict=True))
    freeze(time, *tables)
    return Rehearsal(tuple(task.result() for task in begun), time, *tables)


def _landings(leave: Collection[int], swarm: PointMasses) -> Iterator[Command]:
    """Yield the landing of agents that leave the mission, from where they are."""
    rows = np.array([row for row in sorted(leave) if swarm.phase[row] == AgentPhase.FLYING], int)
    if len(rows):
        position = swarm.position[rows]
        duration = min_landing_time(np.maximum(position[:, 2], 0.0))
        yield Command(Order.LAND, rows, position * (1.0, 1.0, 0.0), swarm.yaw[rows], duration)


def _as_sent(command: Command, position: Array) -> Command:
    """Return a command as the core sends it: landings take a least time.

    Args:
        command: Of a task.
        position: (N, 3) of the agents, m.
    """
    if command.order is not Order.LAND:
        return command
    least = min_landing_time(np.maximum(position[command.agent, 2], 0.0))
    return replace(command, duration=np.maximum(command.duration, least))
