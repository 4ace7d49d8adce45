"""Monitors: safety checks after the stages of a tick, and the findings that they return."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import Literal, NamedTuple, Protocol, TypeAlias

from star_core.messages.arrays import Mask, Rows
from star_core.messages.state import AIRBORNE, Estimate, Goals, Health, Setpoint, among
from star_core.messages.telemetry import Telemetry
from star_core.plugin_support.guard import Strikes


class Stage(Enum):
    """Stage of a tick after which a monitor checks it."""

    LOCATED = "the estimate"
    TRACKED = "phases and health"
    AIMED = "the goals"
    PLANNED = "the planner's setpoint"
    AVOIDED = "the avoider's setpoint"


@dataclass(slots=True)
class TickState:
    """State of the current tick; each stage adds its results.

    Attributes:
        telemetry: Received.
        phase: (N,) `AgentPhase` of each agent: of the last tick until commands are sent.
        taken_over: (N,) agents that setpoints have flown, by their reports, since their last
            command.
        estimate: The localizer's, as changed by monitors.
        health: Of the agents.
        gone: (N,) agents on the ground that do not take off again.
        steered: (N,) agents that setpoints fly and that do not land.
        landing: (N,) agents that land or are about to.
        goals: For the planner.
        setpoint: The planner's, then the avoider's.
        planned: The planner's for the agents that setpoints fly.
        redirected: (N,) agents that brake or return, whatever their goals.
        visible: The estimate by which agents are kept apart.
    """

    telemetry: Telemetry
    phase: Rows
    taken_over: Mask
    estimate: Estimate = field(init=False)
    health: Health = field(init=False)
    gone: Mask = field(init=False)
    steered: Mask = field(init=False)
    landing: Mask = field(init=False)
    goals: Goals = field(init=False)
    setpoint: Setpoint = field(init=False)
    planned: Setpoint = field(init=False)
    redirected: Mask = field(init=False)
    visible: Estimate = field(init=False)

    @property
    def airborne(self) -> Mask:
        """Agents that are in the air: (N,)."""
        return among(self.phase, *AIRBORNE)


class SafetyAction(IntEnum):
    """Actions on an agent that is removed from the mission, the mildest first."""

    NOTHING = 0
    HOLD = 1
    LAND = 2
    STOP = 3


class Report(NamedTuple):
    """An event to report: its kind and text, and the agent's name."""

    kind: str
    text: str
    agent: str


class Use(NamedTuple):
    """A table to go on with, instead of that of the tick's state."""

    table: Literal["estimate", "visible", "goals", "setpoint"]
    value: Estimate | Goals | Setpoint


class Exclude(NamedTuple):
    """An agent to remove from the mission, by an action and for a reason.

    `fails`: the mission does not complete unless another agent takes over.
    """

    row: int
    action: SafetyAction
    reason: str
    fails: bool = False


class Strike(NamedTuple):
    """A failure of a plugin, by its kind, that only outputs of several plugins show."""

    kind: str
    reason: str


class Brake(NamedTuple):
    """All agents brake in this tick."""


Finding: TypeAlias = Report | Use | Exclude | Strike | Brake


class Monitor(Protocol):
    """Checks a tick after a stage; the control loop acts on the findings, one after the other.

    Attributes:
        after: The stage.
    """

    after: Stage

    def check(self, state: TickState) -> Iterable[Finding]:
        """Return the findings; without any, a monitor costs as little as it can."""
        ...


class PendingStrikes:
    """Brakes all agents in a tick in which a plugin has failed and the failure is tolerated.

    Args:
        strikes: Counts the failures.
    """

    after = Stage.AVOIDED

    def __init__(self, strikes: Strikes) -> None:
        self._strikes = strikes

    def check(self, state: TickState) -> Iterable[Brake]:
        """Return that all agents brake, after a failure."""
        return (Brake(),) if self._strikes.pending else ()
