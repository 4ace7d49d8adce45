"""What a plugin can be, and the record that announces one.

A contract is a `Protocol`: a plugin satisfies it by its shape and inherits nothing. Every method
takes and returns whole tables of `star_core.swarm` and `star_core.telemetry`, so one call serves
the whole swarm. Any part may also have ``close()``, which is called once, however the mission
ended.

This module imports no numpy, so that plugins can be listed and missions checked quickly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import (
    TYPE_CHECKING,
    Any,
    Generic,
    Literal,
    NamedTuple,
    Protocol,
    TypeVar,
    runtime_checkable,
)

if TYPE_CHECKING:
    from star_core.orders import Command
    from star_core.sight import Corrections
    from star_core.swarm import Estimate, Goals, Health, Plan, Setpoint, Truth
    from star_core.telemetry import Telemetry


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
        """Tell on-board estimators where their agents are; called only if somebody is meant."""
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
class Step:
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

    Agents can leave a mission, and others can take their places. A task may have ``stay(rows)``: go
    on with these of its agents; ``swap(old, new)``: another agent takes one's part; and
    ``join(rows)``: go on with these, some of which are new. One without `stay` or `swap` is made
    and begun anew instead; without `join`, who is new waits for the next step.

    A task that orders its agents to fly trajectories on board has ``trajectories``: a tuple of
    those, known when it is made. The core steers nobody who flies one, until it is over or the
    agent is in its step no more.
    """

    def begin(self, estimate: Estimate, health: Health) -> float:
        """Start, and return how long the step may take before it counts as failed, s.

        Called once, before the first `step`. A mission's own ``timeout`` goes before the answer.
        """
        ...

    def step(self, estimate: Estimate, health: Health) -> Step:
        """Say what its agents should do now, and whether the step is over."""
        ...


class Problem(NamedTuple):
    """What a schema cannot see and a plugin's own check found.

    Attributes:
        path: Keys and indices from the plugin's options to the value; empty for the whole.
        message: What is wrong and what was expected.
    """

    path: tuple[str | int, ...]
    message: str


Part_co = TypeVar("Part_co", covariant=True)

NO_OPTIONS: Mapping[str, Any] = {"type": "object", "properties": {}}


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer(Generic[Part_co]):
    """One plugin, as a hook announces it.

    Attributes:
        name: What a mission writes. Lower case, unique within its kind.
        summary: One line, for ``star plugins`` and for editors.
        make: ``make(scene, **options)`` returns the part; for a task, ``make(scene, rows,
            **options)`` with the rows (a tuple) of the agents it is for. Import what is heavy in
            here.
        options: JSON Schema of those options: an object with ``properties``. Options that are not
            listed are refused.
        check: ``check(scene, **options)`` (for a task ``check(scene, rows, **options)``) yields
            what is wrong that a schema cannot see. It runs in ``star check``: import nothing heavy.
        realtime: Of a transport: whether mission time goes on by itself, as on hardware. Every part
            reads it in `Scene.realtime`.
        before: Of a task: where its agents have to be when it begins; None if that does not matter.
        after: Of a task: where they are when it has succeeded; None if that is not known.
    """

    name: str
    summary: str
    make: Callable[..., Part_co]
    options: Mapping[str, Any] = field(default_factory=lambda: NO_OPTIONS)
    check: Callable[..., Iterable[Problem]] | None = None
    realtime: bool = False
    before: Literal["ground", "air"] | None = None
    after: Literal["ground", "air", "same"] | None = None
