"""The control loop: one tick from telemetry to setpoints, top to bottom."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from star_core.contracts import Status
from star_core.errors import PluginError, shortlist
from star_core.execution.assignments import Assignments
from star_core.execution.executor import StepExecutor
from star_core.execution.instructions import GoalDraft, Instructions
from star_core.execution.land_all import LandAll
from star_core.execution.landing import LandingManager
from star_core.execution.program import Program
from star_core.execution.reserves import ReserveManager
from star_core.execution.step_run import TaskPool, TickContext
from star_core.geometry.neighbours import Pairs
from star_core.messages.arrays import Mask, Rows, some
from star_core.messages.commands import Order
from star_core.messages.events import Corrected, Tick
from star_core.messages.state import (
    UNFIT,
    AgentPhase,
    Estimate,
    Goals,
    Health,
    Plan,
    Setpoint,
    among,
)  # fmt: skip
from star_core.mission import Mission
from star_core.observers import Observers
from star_core.operator import Operator
from star_core.phases import MissionPhase
from star_core.pipeline import PluginPipeline
from star_core.plugin_support.registry import Registry
from star_core.records.summary import FlightSummary, event_record
from star_core.safety.agents_in_the_way import GroundedAgents
from star_core.safety.estimate_gate import EstimateMonitor
from star_core.safety.filter import SafetyFilter
from star_core.safety.monitors import (
    Brake,
    Exclude,
    Finding,
    Misreport,
    Monitor,
    PendingBrakes,
    Report,
    SafetyAction,
    Stage,
    Strike,
    TickState,
    Use,
    plugin_monitors,
    stages_of,
)
from star_core.safety.rules import Rules
from star_core.vehicle_interface import VehicleInterface

MAX_LOST_TIME: Final = 1.0  # s; without setpoints for 2 s, a Crazyflie stops its motors

ACTIONS: Final = {
    SafetyAction.HOLD: "holds its position",
    SafetyAction.LAND: "lands",
    SafetyAction.STOP: "stops its motors",
}
"""Texts of events about agents that a safety rule removes from the mission."""


class MissionStatus(NamedTuple):
    """Status of the mission after a tick, and why it failed if it did."""

    status: Status
    reason: str = ""


class ControlLoop:
    """Flies the steps of a mission and lands all agents, a tick at a time.

    Args:
        pipeline: The four plugins; their transport is connected before the first tick.

    Attributes:
        program: What the program of the flight gives the agents.
        trajectories: That agents may be ordered to fly on board, each once.
        last: The last tick that was recorded; None before the first.
    """

    def __init__(
        self,
        mission: Mission,
        registry: Registry,
        pipeline: PluginPipeline,
        observers: Observers,
        operator: Operator,
    ) -> None:
        scene, n = mission.scene, len(mission.scene.agents)
        self._mission = mission
        self._scene = scene
        self._operator = operator
        self._pipeline = pipeline
        self._observers = observers
        self._assignments = Assignments(n, mission.reserve_rows)
        self._rules = Rules(scene, mission.safety)
        self._safety = SafetyFilter(scene)
        self._vehicles = VehicleInterface(scene, pipeline, observers)
        report = partial(observers.event, "plugin")
        monitors: tuple[Monitor, ...] = (
            EstimateMonitor(scene, pipeline.localizer),
            *plugin_monitors(scene, registry, pipeline.compute_time, report),
            self._vehicles.unheard,
            self._rules,
            GroundedAgents(n, scene.limits),
            PendingBrakes(pipeline.strikes),
        )
        self._monitors = {
            stage: [monitor for monitor in monitors if stage in stages_of(monitor)]
            for stage in Stage
        }
        tasks = TaskPool(mission, registry, pipeline.compute_time)
        self.trajectories = tasks.trajectories
        self._executor = StepExecutor(
            mission, tasks, self._assignments, observers, pipeline.strikes
        )
        self.program = Program(mission, registry, self._executor, self._assignments)
        self.last: Tick | None = None
        report = partial(observers.event, "relief")
        self._reserves = (
            ReserveManager(scene, self._assignments, self._rules, mission.reserve, report)
            if mission.reserve
            else None
        )
        self._landing = LandingManager(scene, self._vehicles, observers, pipeline.refuses)
        self._summary = FlightSummary(scene)
        self._uncertain_landings: dict[int, str] = {}  # names by the slots that they left
        self._unreachable: dict[int, str] = {}  # reasons by row, in the last tick
        self._lost_since = np.full(n, np.inf)  # s
        self._goals = Goals.none(n)  # of the last tick
        self._land_all: LandAll | None = None  # once it is what the flight does

    def tick(self) -> MissionStatus:
        """Run one control tick for the whole swarm; return the status of the mission."""
        vehicles = self._vehicles
        telemetry = vehicles.receive()
        state = TickState(telemetry, vehicles.phases.of_agents(), vehicles.ground.steered_seen)
        state.estimate = vehicles.locate(telemetry)
        self._check(Stage.LOCATED, state)
        state.health = vehicles.track(telemetry, state.estimate)
        if self._land_all is not None:
            status, instructions = Status.RUNNING, self._land_all.step(telemetry, state.estimate)
        else:
            self._check(Stage.TRACKED, state)
            excused = self._rules.excuse(state.health, state.estimate.valid)
            if reason := (
                self._rules.reason_to_end(state.health, self._assignments.unassigned)
                or self._lost_too_long(state.health, excused)
            ):
                return MissionStatus(Status.FAILURE, reason)
            context = self._context(state, excused)
            status, instructions = self._executor.step(context)
            if self._reserves is not None:
                self._reserves.step(context, instructions)
            self.program.step(instructions)
        self._send_commands(instructions, state.estimate)
        goals = instructions.goals
        self._landing.step(state.estimate, goals)
        self._landing.repeat_missed(telemetry, state.estimate)
        idle = vehicles.phases.among(AgentPhase.FLYING) & ~goals.active
        goals.hold(idle, state.estimate, self._scene.limits.speed)
        self._goals = goals.finish()
        if self._land_all is None or some(self._goals.active):
            self._steer(state, shortlist(instructions.doing))
        else:
            self._watch(state)
        if self._land_all is not None:
            return _status(self._land_all.result())
        return MissionStatus(status, self._executor.reason)

    def _steer(self, state: TickState, doing: str) -> None:
        """Fly towards the goals for a tick."""
        vehicles, estimate = self._vehicles, state.estimate
        self._aim(state)
        self._check(Stage.AIMED, state)
        plan = self.program.steer(self._pipeline.plan(estimate, state.goals))
        state.setpoint = plan.setpoint
        self._check(Stage.PLANNED, state)
        state.planned = vehicles.setpoint(state.setpoint, estimate)
        state.setpoint = self._pipeline.avoid(state.visible, state.planned, state.goals)
        near = self._near(estimate)
        with self._pipeline.safety_time:
            self._check(Stage.AVOIDED, state)
            safe, corrected = self._safety.filter(
                state.visible, state.setpoint, state.planned, near
            )
        safe = self._safety.keep_trajectories(safe, plan.setpoint, estimate)
        sent = vehicles.send(safe, state.telemetry, estimate)
        self._record(state, plan, sent, doing, corrected, near)
        unreachable = plan.unreachable & state.planned.active & ~state.redirected
        self._unreachable = {
            row: plan.reasons.get(row, "the planner finds no way to the goal")
            for row in unreachable.nonzero()[0].tolist()
        }

    def _watch(self, state: TickState) -> None:
        """Record a tick in which no plugin is called but the transport, and nothing is sent."""
        n = len(self._scene.agents)
        state.goals, plan = Goals.none(n), Plan.none(n)
        unchanged = Corrected(*np.zeros((4, n), np.bool_))
        near = self._near(state.estimate)
        self._record(state, plan, plan.setpoint, "landing", unchanged, near)

    def _check(self, stage: Stage, state: TickState) -> None:
        """Check a tick after a stage, and act on what the monitors find."""
        state.stage = stage
        for monitor in self._monitors[stage]:
            for finding in monitor.check(state):
                self._act(finding, state)

    def _act(self, finding: Finding, state: TickState) -> None:
        """Act on a finding of a monitor; nothing else does."""
        match finding:
            case Use(table, value):
                setattr(state, table, value)
            case Report(kind, text, agent):
                self._observers.event(kind, text, agent)
            case Strike(kind, reason):
                self._pipeline.strike(kind, reason)
            case Misreport():
                self._vehicles.misreport(finding)
            case Brake() if state.stage is Stage.AVOIDED:
                still = np.zeros_like(state.setpoint.active)
                state.setpoint = replace(state.setpoint, active=still)
            case Brake():
                state.brakes = True
            case Exclude() if self._rules.record(finding):
                self._exclude(finding, state.estimate)

    def _exclude(self, finding: Exclude, estimate: Estimate) -> None:
        """Remove an agent from the mission; from its steps too, where its goal is its position."""
        row, action, reason, fails = finding
        name = self._scene.agents[row].name
        slot = self._assignments.slot(row)
        if fails and slot is not None:
            self._uncertain_landings[slot] = name
        self._observers.event("safety", f"{name} {ACTIONS[action]}: {reason}", name)
        self._assignments.vacate([row])
        goals = GoalDraft(self._goals)
        goals.active[row] = False
        alone = np.arange(len(estimate.valid)) == row
        goals.hold(alone & estimate.valid, estimate, self._scene.limits.speed)
        self._goals = goals.finish()
        if action is SafetyAction.LAND:
            self._landing.land([row])
        elif action is SafetyAction.STOP:
            self._vehicles.stop_motors(np.array([row]))

    def _aim(self, state: TickState) -> None:
        """Add the goals and which agents follow them to a tick's state."""
        vehicles = self._vehicles
        state.goals, state.phase = self._goals, vehicles.phases.of_agents()
        state.landing = vehicles.phases.among(AgentPhase.LANDING)
        if waiting := self._landing.rows:
            state.landing = state.landing.copy()
            state.landing[waiting] = True
        state.steered = vehicles.steered(state.estimate) & ~state.landing
        state.gone = self._gone()
        state.redirected = np.zeros(len(state.phase), np.bool_)

    def land_all(self, *, complete: bool, at_once: bool = False) -> MissionStatus:
        """Land all agents from now on: the ticks that follow do nothing else.

        Args:
            complete: Whether the mission's steps are done.
            at_once: Land each agent from its position; see `LandAll`.

        Returns:
            Its status, as ticks return it: it may be over at once.
        """
        self._land_all = LandAll(
            self._scene,
            self._vehicles,
            self._landing,
            self._assignments,
            self._observers,
            self._operator,
            complete=complete,
            at_once=at_once,
        )
        self._land_all.begin()
        return _status(self._land_all.result())

    def stop_locating(self) -> None:
        """Stop calling the localizer, which may have failed: no agent is located any more."""
        self._vehicles.stop_locating()
        self._monitors[Stage.LOCATED] = [self._vehicles.unheard]

    def give_up(self, error: PluginError) -> str:
        """Return what failed when all agents cannot be landed either, as `error` reports."""
        return "" if self._land_all is None else self._land_all.give_up(error)

    @property
    def phases(self) -> Rows:
        """The `AgentPhase` of each agent: (N,)."""
        return self._vehicles.phases.of_agents()

    @property
    def phase(self) -> MissionPhase:
        """The phase of the mission."""
        return self._vehicles.phases.mission

    def change_phase(self, trigger: str) -> MissionPhase:
        """Apply a trigger to the phase of the mission, report changes, and return the phase."""
        self._vehicles.phases.fire_mission(trigger)
        self._vehicles.report_phases()
        return self.phase

    def finish(self) -> list[str]:
        """Report what is not over when the flight ends.

        Returns:
            Reasons why the mission has failed although its steps have not.
        """
        contacts = self._summary.contacts
        for event in contacts.finish():
            self._observers.record(event)
        collisions = "" if self._mission.collisions == "record" else contacts.collisions()
        return [*filter(None, (self._uncertain_landed(), collisions))]

    def close(self) -> list[str]:
        """Abort the running steps and close every task; return their errors."""
        return self._executor.close()

    def summary(self, reason: str, wall_time: float) -> dict[str, Any]:
        """Return the contents of ``summary.json``.

        Args:
            reason: Why the mission did not complete; empty if it did.
            wall_time: Of the flight, s.
        """
        summary = (
            self._summary.summary(
                mission=self._mission.name,
                outcome=str(self.phase),
                reason=reason,
                wall_time=wall_time,
                took=self._pipeline.took(),
            )
            | self._vehicles.timing.summary()
            | self._pipeline.compute_time.summary()
        )
        measures = self._observers.measures({*summary, "targets", "steps", "events"})
        return {
            **summary,
            **measures,
            "targets": self._vehicles.targets.summary(),
            "steps": list(self._executor.steps),
            "events": [*map(event_record, self._observers.events)],
        }

    def _uncertain_landed(self) -> str:
        """Return which agents landed for their uncertainty and are not replaced; empty if none."""
        vacant = {*self._assignments.vacancies()}
        names = [name for slot, name in self._uncertain_landings.items() if slot in vacant]
        verb = "was" if len(names) == 1 else "were"
        return f"{shortlist(names)} {verb} too uncertain and landed early" if names else ""

    def _gone(self) -> Mask:
        """Return which agents do not take off again once they have landed: (N,).

        A reserve may, whatever it was removed for: its battery may be replaced.
        """
        if self._reserves is not None:
            return np.zeros(len(self._scene.agents), np.bool_)
        return self._assignments.removed

    def _lost_too_long(self, health: Health, excused: Mask) -> str:
        """Return the reason to end if an agent of the mission has been lost for too long."""
        lost = self._vehicles.phases.among(AgentPhase.LOST) | self._landing.unheard(health.age)
        lost &= ~excused
        time = self._vehicles.time
        if not some(lost):
            self._lost_since.fill(np.inf)
            return ""
        self._lost_since = np.where(lost, np.fmin(self._lost_since, time), np.inf)
        late = (time - self._lost_since > MAX_LOST_TIME) & ~self._assignments.unassigned
        return f"{self._scene.named(np.flatnonzero(late))} is lost" if some(late) else ""

    def _context(self, state: TickState, excused: Mask) -> TickContext:
        """Return the inputs of the steps, after reporting the commands that drones refused."""
        telemetry, estimate, health = state.telemetry, state.estimate, state.health
        for row, reason in telemetry.refusals:
            name = self._scene.agents[row].name
            self._observers.event("refused", f"{name} {reason}", name)
        unfit = (among(health.phase, *UNFIT) & ~excused).nonzero()[0].tolist()
        disabled = {row: self._vehicles.phases.describe(row) for row in unfit}
        refusals = dict(telemetry.refusals)
        time = self._vehicles.time
        return TickContext(
            time, estimate, health, disabled, refusals, self._unreachable, self._goals
        )

    def _send_commands(self, instructions: Instructions, estimate: Estimate) -> None:
        """Send the commands of this tick; landings are held back by the landing manager."""
        self._vehicles.release(instructions.free)
        for command in instructions.commands:
            if command.order is Order.LAND:
                self._landing.request(command)
            else:
                self._vehicles.send_command(command, estimate)
        for rows, values in instructions.parameters:
            self._pipeline.set_parameters(rows, values)
        self._landing.land(sorted(instructions.leave))

    def _near(self, estimate: Estimate) -> Pairs:
        """Return the pairs of agents that safety filter and contacts consider."""
        reach = max(self._safety.reach, self._summary.contacts.reach)
        return Pairs.of(estimate.position, reach)

    def _record(
        self,
        state: TickState,
        plan: Plan,
        sent: Setpoint,
        doing: str,
        corrected: Corrected,
        near: Pairs,
    ) -> None:
        """Add a tick to the summary and pass it to the observers."""
        inputs = state.telemetry, state.estimate, state.health, state.goals
        truth = self._pipeline.truth()
        timing = self._vehicles.timing.of_tick(self._pipeline.took())
        tick = Tick(self._vehicles.time, *inputs, plan, sent, truth, doing, corrected, timing)
        self.last = tick
        for failure in self._pipeline.strikes.drain():
            self._observers.event("plugin", failure)
        for event in self._summary.add(tick, near):
            self._observers.record(event)
        self._observers.notify("star_ticked", tick=tick)


def _status(result: str | None) -> MissionStatus:
    """Return the status for what failed in landing all agents; None while they land."""
    if result is None:
        return MissionStatus(Status.RUNNING)
    return MissionStatus(Status.FAILURE if result else Status.SUCCESS, result)
