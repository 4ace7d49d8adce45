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
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from star_core.messages.commands import Command, Trajectory
    from star_core.messages.faults import Fault
    from star_core.messages.rotations import Transform
    from star_core.messages.state import Estimate, Goals, Health, Plan, Setpoint, Truth
    from star_core.messages.telemetry import Corrections, Telemetry


@runtime_checkable
class Transport(Protocol):
    """Carries telemetry from the agents, and setpoints and commands to them; owns the clock.

    It may have methods of `Paced`, `Uploads`, `SetsParameters`, `InjectsFaults`, `Records`,
    `NotesFrames` and `AwaitsLandings`, too.
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
class Uploads(Protocol):
    """A transport whose agents fly trajectories on board; with another, such missions do not."""

    def upload(self, trajectories: tuple[Trajectory, ...]) -> None:
        """Upload every trajectory that a task may order: called once, after `connect`, if any."""
        ...


@runtime_checkable
class SetsParameters(Protocol):
    """A transport whose agents have firmware with parameters, such as the colors of lights."""

    def set_parameters(self, rows: Sequence[int], values: Mapping[str, float]) -> None:
        """Set parameters of some agents, by ``group.name``, without waiting for it.

        An agent that lacks a parameter, or cannot have the value, is logged.
        """
        ...


@runtime_checkable
class InjectsFaults(Protocol):
    """A transport that simulates failing drones."""

    def inject(self, faults: Sequence[Fault]) -> None:
        """Prepare faults of motors, batteries and sensors: called before `connect`."""
        ...


@runtime_checkable
class Records(Protocol):
    """A transport that writes files of its own."""

    def record_in(self, folder: Path) -> None:
        """Write them into a folder: called once after `connect`, if the flight is recorded."""
        ...


@runtime_checkable
class NotesFrames(Protocol):
    """A transport that lands agents by itself when the flight fails."""

    def note_frames(self, map_from_odom: Transform) -> None:
        """Note `Estimate.map_from_odom`, last known for each agent: called before each `send`."""
        ...


@runtime_checkable
class AwaitsLandings(Protocol):
    """A transport that still lands agents after `close`."""

    def await_landings(self) -> None:
        """Return when that is over: ``star run`` calls it last, and Ctrl-C interrupts it."""
        ...


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
    """Changes planned setpoints so that agents keep apart.

    It may have the method of `NotesGoals`, too.
    """

    def avoid(self, estimate: Estimate, planned: Setpoint) -> Setpoint:
        """Return the setpoint nearest to `planned` that keeps the agents apart.

        Inactive rows stay inactive, but are obstacles to the others. An active row that is returned
        inactive brakes.
        """
        ...


@runtime_checkable
class NotesGoals(Protocol):
    """An avoider that considers where agents fly."""

    def note_goals(self, goals: Goals) -> None:
        """Note the goals of the whole swarm: called before each `Avoider.avoid`."""
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
        parameters: Of its agents' firmware to set, by ``group.name``, sent once.
    """

    goals: Goals | None = None
    commands: tuple[Command, ...] = ()
    status: Status = Status.RUNNING
    reason: str = ""
    messages: tuple[str, ...] = ()
    parameters: Mapping[str, float] | None = None


@runtime_checkable
class Task(Protocol):
    """One running step of a mission: a verb, its agents and its options.

    Agents can leave a mission, and reserves can replace them: a task may have the methods of
    `RemovesAgents`, `ReplacesAgents` and `AddsAgents`. Without the first two the core makes the
    task again; without the last, new agents wait for the next step. It may have that of
    `ContinuesFrom`, too.

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


@runtime_checkable
class RemovesAgents(Protocol):
    """A task that goes on with fewer agents."""

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        """Continue with these agents."""
        ...


@runtime_checkable
class ReplacesAgents(Protocol):
    """A task that goes on with another agent."""

    def on_agent_replaced(self, old: int, new: int) -> None:
        """Continue with another agent in the place of one."""
        ...


@runtime_checkable
class AddsAgents(Protocol):
    """A task that goes on with more agents."""

    def on_agents_added(self, rows: tuple[int, ...]) -> None:
        """Continue with these agents, some of which are new."""
        ...


@runtime_checkable
class ContinuesFrom(Protocol):
    """A task that begins at the goals of the steps before: agents need not be exactly at them."""

    def continue_from(self, goals: Goals) -> None:
        """Note the goals of the whole swarm so far: called before `Task.begin`."""
        ...
