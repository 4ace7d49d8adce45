"""The protocols that plugins implement; `plugin_support.specs` has the records that announce them.

A contract is a `Protocol`: a plugin satisfies it by its shape and inherits nothing. Every method
takes and returns whole tables of `star_core.messages`, so one call serves the whole swarm. Any
plugin may also have ``close()``, which is called once, however the mission ended.

This module imports no numpy, so that plugins can be listed and missions checked quickly.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import (
    TYPE_CHECKING,
    Protocol,
    runtime_checkable,
)

if TYPE_CHECKING:
    from star_core.messages.commands import Command
    from star_core.messages.state import Estimate, Goals, Health, Plan, Setpoint, Truth
    from star_core.messages.telemetry import Corrections, Telemetry


@runtime_checkable
class Transport(Protocol):
    """Carries telemetry from the agents, and setpoints and commands to them; owns the clock.

    A simulation whose pace can be changed during a flight is `Paced`, too.

    If its agents can fly trajectories on board it also has ``upload(trajectories)``: it is called
    once, after `connect` and before anything moves, with a tuple of every `Trajectory` that a task
    may order, if there is one. With a transport without it, such missions are not flown.

    If it can simulate failing drones it also has ``inject(faults)``: it is called before `connect`
    with every `Fault` of motors, batteries, flow sensors, gyros and rangers.

    If it lands agents by itself when the flight fails it may have ``record_in(folder)``, called
    once after `connect` if the flight is recorded, and ``note_frames(map_from_odom)``: the
    `Transform` of `Estimate.map_from_odom`, last known for each agent, before each `send`. If it
    still lands agents after `close` it may have ``await_landings()``, which returns when that is
    over: ``star run`` calls it last, and Ctrl-C interrupts it.
    """

    def connect(self) -> None:
        """Open the links.

        Raises:
            PluginError: Agents cannot be reached; the message names every one of them.
        """
        ...

    def wait(self, until: float) -> float:
        """Wait until mission time `until`, s, and return the mission time then.

        It is the only clock: a simulation steps, a radio sleeps. Mission time begins at 0.
        """
        ...

    def receive(self) -> Telemetry:
        """Return what arrived since the last call, without waiting for more."""
        ...

    def command(self, command: Command) -> None:
        """Send a command to on-board commanders; positions are in each agent's odometry frame."""
        ...

    def correct(self, corrections: Corrections) -> None:
        """Send pose corrections to the on-board estimators; never called with an empty table."""
        ...

    def send(self, setpoint: Setpoint) -> Setpoint:
        """Send the active rows; return the setpoint that was sent, after this transport's limits.

        Velocity and yaw are in each agent's odometry frame.
        """
        ...

    def truth(self) -> Truth | None:
        """Return the ground truth, if this transport has it. For recorders only."""
        ...

    def close(self) -> None:
        """Release the links. It may be called twice.

        The core has landed all agents that it could; command others to land, if possible.
        """
        ...


@runtime_checkable
class Paced(Protocol):
    """A transport that simulates at a pace, which changes nothing but the duration of the flight.

    Attributes:
        speed: Mission seconds per second of wall time; None is as fast as possible. It may be set
            at any time, by any thread.
    """

    speed: float | None


@runtime_checkable
class Localizer(Protocol):
    """Estimates the state of the swarm from its telemetry."""

    def locate(self, telemetry: Telemetry) -> Estimate:
        """Estimate the swarm's state in the map at `telemetry.time`; N rows in, N rows out."""
        ...


@runtime_checkable
class Planner(Protocol):
    """Plans setpoints towards goals, for each agent as if it were alone."""

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        """Return the next setpoint and the paths; rows without a goal are inactive."""
        ...


@runtime_checkable
class Avoider(Protocol):
    """Changes planned setpoints so that agents keep apart."""

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        """Return the setpoint nearest to `wanted` that keeps the agents apart.

        Inactive rows stay inactive, but are obstacles to the others. An active row that is returned
        inactive brakes.
        """
        ...


class Status(Enum):
    """Status of a task, a step or a mission."""

    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"


@dataclass(frozen=True, slots=True)
class TaskOutput:
    """A task's output of one tick, for its own agents only; the core merges those of all tasks.

    Attributes:
        goals: Of its agents; None keeps the previous ones.
        commands: To on-board commanders, sent once.
        status: Of the task.
        reason: Why it failed.
        messages: Lines for the log and the record, such as what the task waits for; each once.
    """

    goals: Goals | None = None
    commands: tuple[Command, ...] = ()
    status: Status = Status.RUNNING
    reason: str = ""
    messages: tuple[str, ...] = ()


@runtime_checkable
class Task(Protocol):
    """One running step of a mission: a verb, its agents and its options.

    Agents can leave a mission, and reserves can replace them. A task may have
    ``on_agents_removed(rows)``: continue with these agents; ``on_agent_replaced(old, new)``:
    another agent replaces one; and ``on_agents_added(rows)``: continue with these, some of which
    are new. Without the first two the core makes the task again; without the last, new agents wait
    for the next step.

    It may have ``continue_from(goals)``, called before `begin` with the `Goals` so far of the whole
    swarm: an agent need not be exactly where it was sent.

    A task whose agents fly trajectories on board has ``trajectories``: a tuple of those, known when
    it is made. The core sends no setpoints to an agent that flies one, until it is over or the
    agent is no longer in the step.
    """

    def begin(self, estimate: Estimate, health: Health) -> float:
        """Begin, and return the timeout of the step, s; ``timeout`` in a mission overrides it.

        Called once, before the first `step`.
        """
        ...

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        """Return the goals and commands of its agents in this tick, and the status of the task."""
        ...
