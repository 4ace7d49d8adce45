"""Monitors: safety checks after the stages of a tick, and the findings that they return."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import Literal, NamedTuple, Protocol, TypeAlias

import numpy as np

from star_core.errors import ContractError, PluginError
from star_core.messages.arrays import Array, Mask, Rows
from star_core.messages.state import AIRBORNE, Estimate, Goals, Health, Setpoint, among
from star_core.messages.telemetry import Telemetry
from star_core.plugin_support.compute_time import ComputeTime
from star_core.plugin_support.guard import PluginGuard, Strikes, require_signature
from star_core.plugin_support.option_schema import PIPELINE_KINDS
from star_core.plugin_support.outputs import checked_estimate, checked_goals, checked_setpoint
from star_core.plugin_support.registry import Found, Registry
from star_core.world.scene import Scene

log = logging.getLogger(__name__)


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
        stage: After which it is checked now.
        brakes: Whether a monitor of an earlier stage brakes all agents.
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
    stage: Stage = Stage.LOCATED
    brakes: bool = False
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
    """A table or mask to go on with, instead of that of the tick's state."""

    table: Literal["estimate", "visible", "goals", "setpoint", "redirected"]
    value: Estimate | Goals | Setpoint | Mask


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


class Misreport(NamedTuple):
    """Velocities that agents do not report, in this tick; without any, zero.

    To rest they are commanded the opposite velocities.

    Attributes:
        missing: (N, 3) true less reported velocities, m/s in the odometry frames.
        drifts: (N,) agents that would drift if they landed on board: setpoints bring them down.
    """

    missing: Array
    drifts: Mask


Finding: TypeAlias = Report | Use | Exclude | Strike | Brake | Misreport


class Monitor(Protocol):
    """Checks a tick after a stage; the control loop acts on the findings, one after the other."""

    @property
    def after(self) -> Stage | tuple[Stage, ...]:
        """The stage, or stages; `TickState.stage` is the present one."""
        ...

    def check(self, state: TickState) -> Iterable[Finding]:
        """Return the findings; without any, a monitor costs as little as it can."""
        ...


class PendingBrakes:
    """Brakes all agents once there is a setpoint.

    It does so in ticks in which a monitor of an earlier stage brakes, or in which a plugin has
    failed and the failure is tolerated.
    """

    after = Stage.AVOIDED

    def __init__(self, strikes: Strikes) -> None:
        self._strikes = strikes

    def check(self, state: TickState) -> Iterable[Brake]:
        """Return that all agents brake, if they are to."""
        return (Brake(),) if state.brakes or self._strikes.pending else ()


class PluginMonitor:
    """A monitor that a plugin adds: guarded, timed, and its findings checked.

    One that fails is named and dropped for the rest of the flight, which goes on without it.

    Args:
        report: Receives the text of an event.
    """

    def __init__(
        self, plugin: Found, scene: Scene, compute_time: ComputeTime, report: Callable[[str], None]
    ) -> None:
        name = f"monitor {plugin.offer.name!r} ({plugin.source})"
        self._n, self._report = len(scene.agents), report
        self._guard = PluginGuard(name, compute_time.of(name, quiet=plugin.source.own))
        self.after: Stage | tuple[Stage, ...] = Stage.LOCATED
        self._failure: PluginError | None = None
        self._dropped = False
        try:
            with PluginGuard(name):
                self._monitor: Monitor = plugin.offer.make(scene)
                require_signature(self._monitor.check, "check", ("state",))
                self.after = tuple(map(Stage, stages_of(self._monitor)))
        except PluginError as error:
            self._failure = error  # reported in flight

    def check(self, state: TickState) -> Iterable[Finding]:
        """Return the findings; none if the monitor fails."""
        if self._dropped:
            return ()
        try:
            if self._failure is not None:
                raise self._failure
            with self._guard:
                return [checked_finding(it, self._n) for it in self._monitor.check(state)]
        except PluginError as error:
            self._dropped = True
            text = f"the flight goes on without a monitor: {error}"
            log.warning("%s", text)
            self._report(text)
        return ()


def stages_of(monitor: Monitor) -> tuple[Stage, ...]:
    """Return the stages that a monitor checks."""
    return monitor.after if isinstance(monitor.after, tuple) else (monitor.after,)


def plugin_monitors(
    scene: Scene, registry: Registry, compute_time: ComputeTime, report: Callable[[str], None]
) -> Iterator[PluginMonitor]:
    """Yield the monitors of all plugins; the arguments are those of `PluginMonitor`."""
    for kind, plugin in registry:
        if kind == "monitor":
            yield PluginMonitor(plugin, scene, compute_time, report)


def checked_finding(finding: Finding, n: int) -> Finding:
    """Return a finding of a plugin about `n` agents; raise `ContractError`."""
    match finding:
        case Use("estimate" | "visible", table):
            checked_estimate(table, n)
        case Use("goals", table):
            checked_goals(table, n)
        case Use("setpoint", table):
            checked_setpoint(table, n)
        case Use("redirected", np.ndarray(shape=(rows,), dtype=np.bool_)) if rows == n:
            pass
        case Exclude(int() | np.integer() as row, SafetyAction()) if 0 <= row < n:
            pass
        case Strike(kind) if kind in PIPELINE_KINDS:
            pass
        case Misreport(missing, drifts):
            if missing.shape != (n, 3) or not np.isfinite(missing).all() or drifts.shape != (n,):
                raise ContractError(f"{finding} has not finite rows of {n} agents")
        case Report(str(), str(), str() | None) | Brake():
            pass
        case _:
            raise ContractError(f"check() yields {_mistake(finding, n)}")
    return finding


def _mistake(finding: object, n: int) -> str:
    """Return a wrong finding, and what is expected of one of its type."""
    match finding:
        case Use(table):
            tables = "'estimate', 'visible', 'goals', 'setpoint', or 'redirected' with a mask"
            return f"Use({table!r}, ...), expected {tables}"
        case Exclude():
            return f"{finding!r}, expected a row from 0 to {n - 1} and a SafetyAction"
        case Strike():
            return f"{finding!r}, expected a kind of plugin: {', '.join(PIPELINE_KINDS)}"
        case Report():
            return f"{finding!r}, expected a kind, a text and the name of an agent, as text"
        case _:
            return f"{finding!r}, expected a finding"
