"""What a plugin can be, and the records that announce one.

A contract is a `Protocol`: a plugin satisfies it by its shape and inherits nothing. Every method
takes and returns whole tables of `star_core.messages`, so one call serves the whole swarm. Any
plugin may also have ``close()``, which is called once, however the mission ended.

This module imports no numpy, so that plugins can be listed and missions checked quickly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import (
    TYPE_CHECKING,
    Any,
    Literal,
    NamedTuple,
    Protocol,
    runtime_checkable,
)

if TYPE_CHECKING:
    from star_core.messages.commands import Command
    from star_core.messages.state import Estimate, Goals, Health, Plan, Setpoint, Truth
    from star_core.messages.telemetry import Telemetry
    from star_core.messages.vision import Corrections


@runtime_checkable
class Transport(Protocol):
    """Carries telemetry from the agents, and setpoints and commands to them; owns the clock.

    One whose agents can fly trajectories on board has ``upload(trajectories)``: give them to every
    agent. It is called once, after `connect` and before anything moves, with a tuple of every
    `Trajectory` that a task may order; without such tasks it is not called. With a transport that
    has no such method a mission of theirs is not flown.
    """

    def connect(self) -> None:
        """Open the links.

        Raises:
            PluginError: Agents cannot be reached; the message names every one of them.
        """
        ...

    def wait(self, until: float) -> float:
        """Let time pass until mission time `until`, s, and return the mission time it is then.

        The only clock there is: a simulation steps, a radio sleeps. Mission time begins at 0.
        """
        ...

    def receive(self) -> Telemetry:
        """Return what arrived since the last call, without waiting for more."""
        ...

    def command(self, command: Command) -> None:
        """Give an order to on-board commanders; positions are in each agent's odometry frame."""
        ...

    def correct(self, corrections: Corrections) -> None:
        """Send pose corrections to the on-board estimators; never called with an empty table."""
        ...

    def send(self, setpoint: Setpoint) -> Setpoint:
        """Send the active rows, and return what was really sent after this transport's limits.

        Velocity and yaw are in each agent's odometry frame.
        """
        ...

    def truth(self) -> Truth | None:
        """Where the agents really are, if this transport can know. For recorders only."""
        ...

    def close(self) -> None:
        """Release the links. Safe to call twice.

        The core has landed everybody it could; who is still in the air is to be told to land, or is
        left to its own time-outs.
        """
        ...


@runtime_checkable
class Localizer(Protocol):
    """Turns what the agents report into where they are."""

    def locate(self, telemetry: Telemetry) -> Estimate:
        """Estimate the swarm's state in the map at `telemetry.time`; N rows in, N rows out."""
        ...


@runtime_checkable
class Planner(Protocol):
    """Turns where the agents should be into what they should fly, each as if alone."""

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        """Plan the next setpoint; rows without a goal are answered inactive."""
        ...


@runtime_checkable
class Avoider(Protocol):
    """Turns what the planner wants into what is safe to fly."""

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        """Return the setpoint nearest to `wanted` that keeps the agents apart.

        Inactive rows stay inactive; they are in the way all the same. An active row that comes back
        inactive brakes.
        """
        ...


class Status(Enum):
    """How far a task is."""

    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"


@dataclass(frozen=True, slots=True)
class TaskOutput:
    """A task's answer for one tick, for its own rows only; the core merges what runs at once.

    Attributes:
        goals: Where its agents should be; None leaves the goals they have.
        commands: Orders to on-board commanders, given once.
        status: Whether it goes on.
        reason: Why it failed.
    """

    goals: Goals | None = None
    commands: tuple[Command, ...] = ()
    status: Status = Status.RUNNING
    reason: str = ""


@runtime_checkable
class Task(Protocol):
    """One running step of a mission: a verb, its agents and its options.

    Agents can leave a mission, and reserves can replace them. A task may have
    ``on_agents_removed(rows)``: continue with these agents; ``on_agent_replaced(old, new)``:
    another agent replaces one; and ``on_agents_added(rows)``: continue with these, some of which
    are new. Without the first two the core recreates the task; without the last, new agents wait
    for the next step.

    A task that orders its agents to fly trajectories on board has ``trajectories``: a tuple of
    those, known when it is made. The core sends no setpoints to an agent that flies one, until it
    is over or the agent is no longer in the step.
    """

    def begin(self, estimate: Estimate, health: Health) -> float:
        """Start, and return how long the step may take before it counts as failed, s.

        Called once, before the first `step`. A mission's own ``timeout`` goes before the answer.
        """
        ...

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        """Say what its agents should do now, and whether the step is over."""
        ...


class Problem(NamedTuple):
    """A mistake in a file that its schema cannot detect.

    Attributes:
        path: Keys and indices from the plugin's options to the value; empty for the whole.
        message: What is wrong and what was expected.
        code: Identifies the kind of mistake, see `star_core.error_codes`.
    """

    path: tuple[str | int, ...]
    message: str
    code: str = "invalid-option"


class StepGoal(NamedTuple):
    """A position that a step sends an agent to, as far as it is known before the flight.

    Attributes:
        path: Keys and indices from the task's options to the value that it follows from.
        position: In the map, m.
        label: What it is, for messages, as ``"position 2 of 3"``; empty if there is only one.
    """

    path: tuple[str | int, ...]
    position: tuple[float, float, float]
    label: str = ""


NO_OPTIONS: Mapping[str, Any] = {"type": "object", "properties": {}}


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """What every plugin is announced with.

    Attributes:
        name: What a mission writes, or the command line. Lower case, unique within its kind.
        summary: One line, for ``star plugins``, ``star --help`` and editors.
        make: Makes the plugin. Import what is heavy in here.
    """

    name: str
    summary: str
    make: Callable[..., Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSpec(Spec):
    """What a plugin is announced with that a mission names, and gives options.

    Attributes:
        make: ``make(scene, **options)`` returns the plugin.
        options: JSON Schema of those options: an object with ``properties``. Options that are not
            listed are refused.
        check: ``check(scene, **options)`` yields what is wrong that a schema cannot see. It runs in
            ``star check``: import nothing heavy.
    """

    options: Mapping[str, Any] = field(default_factory=lambda: NO_OPTIONS)
    check: Callable[..., Iterable[Problem]] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TransportSpec(MissionSpec):
    """Announces a transport.

    Attributes:
        realtime: Whether mission time goes on by itself, as on hardware. Every plugin reads it in
            `Scene.realtime`.
    """

    make: Callable[..., Transport]
    realtime: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizerSpec(MissionSpec):
    """Announces a localizer."""

    make: Callable[..., Localizer]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerSpec(MissionSpec):
    """Announces a planner.

    Attributes:
        check_goals: ``check_goals(scene, goals, **options)`` yields a `Problem` for every goal that
            the planner would not fly to, out of a list of (x, y, z) in the map, m. The problem's
            path is the goal's index, ``(i,)``; its message is why, and is read after
            "goal [x, y, z]". It runs in ``star check``: import nothing heavy. In flight the planner
            should decide by the same function.
    """

    make: Callable[..., Planner]
    check_goals: Callable[..., Iterable[Problem]] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class AvoiderSpec(MissionSpec):
    """Announces an avoider."""

    make: Callable[..., Avoider]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exclusive:
    """A resource outside of STAR that a task holds while it exists, such as a port.

    Two steps at once cannot hold the same. ``star explain`` rehearses no step that holds one.

    Attributes:
        options: Names of the options that identify the resource.
        unless: Name of the option with which a step holds nothing; None if every step does.
        timeout: Duration after which a step that waits for the resource fails, s.
    """

    options: tuple[str, ...]
    unless: str | None = None
    timeout: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskSpec(MissionSpec):
    """Announces a task: a verb of the mission language.

    Attributes:
        make: ``make(scene, rows, **options)`` with the rows (a tuple) of the agents it is for.
        check: ``check(scene, rows, **options)``.
        goals: ``goals(scene, rows, **options)`` yields a `StepGoal` for each position that it sends
            agents to by way of the planner; of a line, positions no more than 0.05 m apart. It is
            called if `check` found no problem. Import nothing heavy.
        before: Where its agents have to be when it begins; None if that does not matter.
        after: Where they are when it has succeeded; None if that is not known.
        exclusive: What it holds outside of STAR, if anything.
    """

    make: Callable[..., Task]
    goals: Callable[..., Iterable[StepGoal]] | None = None
    before: Literal["ground", "air"] | None = None
    after: Literal["ground", "air", "same"] | None = None
    exclusive: Exclusive | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandSpec(Spec):
    """Announces a command.

    Attributes:
        make: ``make(arguments)`` runs it with the rest of the command line and returns its exit
            status.
        group: The heading that ``star --help`` lists it under.
    """

    make: Callable[[list[str]], int]
    group: str = "Other"


SPECS: Mapping[str, type[Spec]] = {
    "transport": TransportSpec,
    "localizer": LocalizerSpec,
    "planner": PlannerSpec,
    "avoider": AvoiderSpec,
    "task": TaskSpec,
    "command": CommandSpec,
}
