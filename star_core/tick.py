"""The control loop: one tick from telemetry to setpoints, top to bottom."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from star_core.contracts import Status
from star_core.execution.assignments import Assignments
from star_core.execution.goal_buffer import GoalBuffer
from star_core.execution.landing import LandingManager
from star_core.execution.reserves import ReserveManager
from star_core.executor import StepExecutor, TickContext
from star_core.messages.arrays import Mask
from star_core.messages.commands import Command, Order
from star_core.messages.events import Corrected, Tick
from star_core.messages.state import AgentPhase, Estimate, Goals, Health, Paths, Plan, Setpoint
from star_core.messages.telemetry import Refusal, Telemetry
from star_core.metrics.contacts import Contacts, Incident
from star_core.metrics.summary import FlightMetrics
from star_core.mission import Mission
from star_core.observers import Observers
from star_core.pipeline import PluginPipeline
from star_core.registry import Registry
from star_core.safety.filter import SafetyFilter
from star_core.safety.rules import Rules, SafetyAction
from star_core.safety.unheard import MAX_REPORT_AGE
from star_core.vehicle_interface import VehicleInterface

MAX_LOST_TIME = 1.0  # s; without setpoints for 2 s, a Crazyflie stops its motors
REPORT_INTERVAL = 1.0  # s without a correction, after which the next one is reported again

ACTIONS = {
    SafetyAction.HOLD: "holds its position",
    SafetyAction.LAND: "lands",
    SafetyAction.STOP: "stops its motors",
}
"""What events say of agents that a safety rule takes out of the mission."""

CORRECTED = {
    "fence": "is held inside the fence",
    "speed": "is slowed to the speed limit",
    "separation": "brakes for another agent",
}
"""What events say of agents whose setpoints the safety filter corrects, by the reason."""

NO_TRUTH = "no ground truth: separation and collisions are computed from estimated positions"


@dataclass(frozen=True, slots=True)
class MissionStatus:
    """How far the mission is after a tick.

    Attributes:
        status: Of its steps.
        reason: Why it failed; empty unless it did.
    """

    status: Status
    reason: str = ""


class ControlLoop:
    """Flies the steps of a mission, a tick at a time.

    Args:
        mission: What to fly.
        registry: Where verbs are found.
        pipeline: The four plugins; their transport is connected before the first tick.
        observers: Receive every tick and event.

    Attributes:
        vehicles: The swarm.
        executor: The steps.
        landing: Landings that are to be commanded.
        contacts: Collisions and closest approaches so far.
        metrics: Of the flight so far.
    """

    def __init__(
        self, mission: Mission, registry: Registry, pipeline: PluginPipeline, observers: Observers
    ) -> None:
        scene, n = mission.scene, len(mission.scene.agents)
        self._scene = scene
        self._pipeline = pipeline
        self._observers = observers
        self._assignments = Assignments(n, mission.reserve_rows)
        self._rules = Rules(scene, mission.safety)
        self._safety = SafetyFilter(scene)
        self.vehicles = VehicleInterface(scene, pipeline, observers)
        self.executor = StepExecutor(
            mission, registry, self._assignments, observers, pipeline.compute_time
        )
        self._reserves = ReserveManager(
            scene,
            self._assignments,
            self._rules,
            mission.reserve,
            report=partial(observers.event, "relief"),
        )
        self.landing = LandingManager(scene, self.vehicles, observers, pipeline.refuses)
        self.contacts = Contacts(scene)
        self.metrics = FlightMetrics(scene, self.contacts)
        self._unreachable: dict[int, str] = {}  # why goals cannot be reached, by row: last tick
        self._lost_since = np.full(n, np.inf)  # s
        self._corrected_at = {why: np.full(n, -np.inf) for why in CORRECTED}  # s
        self._setpoints_sent = np.zeros(n, np.bool_)  # in the last tick
        self._without_truth = False  # reported

    def tick(self) -> MissionStatus:
        """Run one control tick for the whole swarm; return how far the mission is."""
        telemetry = self.vehicles.receive()
        estimate = self.vehicles.locate(telemetry)
        health = self.vehicles.track(telemetry, estimate)
        excused = self._apply_rules(estimate, health)
        if reason := self._no_agent_left() or self._lost_too_long(excused):
            return MissionStatus(Status.FAILURE, reason)
        refused = self._report_refusals(telemetry.refusals)
        context = TickContext(
            self.vehicles.time, estimate, health, excused, refused, self._unreachable
        )
        status, goals = self.executor.step(context)
        self._reserves.step(context.time, estimate, health, goals)
        self._send_commands(goals, estimate)
        self.landing.step(estimate, goals)
        goals.hold(self.vehicles.phases.among(AgentPhase.FLYING), estimate)
        self._unreachable = self.steer(telemetry, estimate, health, goals)
        return MissionStatus(status, self.executor.reason)

    def steer(
        self, telemetry: Telemetry, estimate: Estimate, health: Health, goals: GoalBuffer
    ) -> dict[int, str]:
        """Fly towards goals for a tick; return why goals cannot be reached, by row."""
        wanted_goals = goals.goals()
        plan = self._pipeline.plan(estimate, wanted_goals)
        wanted = self.vehicles.setpoint(plan.setpoint, estimate)
        avoided = self._pipeline.avoid(estimate, wanted)
        with self._pipeline.timed("safety"):
            safe, corrected = self._safety.filter(estimate, avoided, wanted)
        self._report_corrections(corrected)
        braked = self._with_brakes(safe, telemetry, estimate, health)
        sent = self.vehicles.send(braked, estimate)
        made = telemetry, estimate, health, wanted_goals, plan, sent
        self._record(
            Tick(
                self.vehicles.time, *made, self.vehicles.truth(), ", ".join(goals.doing), corrected
            )
        )
        return {
            row: plan.reasons.get(row, "the planner finds no way to the goal")
            for row in np.flatnonzero(plan.unreachable & wanted.active).tolist()
        }

    def watch(self, telemetry: Telemetry, estimate: Estimate, health: Health) -> None:
        """Record a tick in which nothing is sent."""
        n = len(self._scene.agents)
        none = np.zeros(n, np.bool_)
        still = Setpoint(np.zeros((n, 3)), np.zeros(n), none)
        plan = Plan(still, Paths(np.zeros(0, np.int64), np.zeros((0, 3))), none)
        made = telemetry, estimate, health, Goals.none(n), plan, still
        unchanged = Corrected(none, none, none)
        self._record(Tick(self.vehicles.time, *made, self.vehicles.truth(), "landing", unchanged))

    def finish(self) -> None:
        """Report what is still open when the flight ends."""
        self._report_incidents(self.contacts.finish())

    def given_up(self) -> Mask:
        """(N,) agents that are not in the mission (any more), whose failure it allows."""
        return self._assignments.left()

    def _apply_rules(self, estimate: Estimate, health: Health) -> Mask:
        """Let the safety rules take agents out of the mission.

        Returns:
            (N,) agents that may be lost without failing their step.
        """
        for row, action, reason in self._rules.judge(self.vehicles.time, estimate, health):
            name = self._scene.agents[row].name
            self._observers.event("safety", f"{name} {ACTIONS[action]}: {reason}", name)
            self.executor.drop(row, estimate)
            if action is SafetyAction.LAND:
                self.landing.bring([row])
            elif action is SafetyAction.STOP:
                self.vehicles.stop_motors(np.array([row]))
        return self._rules.excuse(health, estimate.valid)

    def _no_agent_left(self) -> str:
        """Return the reason to end if the safety rules have taken out every agent."""
        none = self._rules.answer.any() and self._assignments.left().all()
        return "the safety rules left no agent" if none else ""

    def _lost_too_long(self, excused: Mask) -> str:
        """Return the reason to end if an agent of the mission has been lost for too long."""
        lost = self.vehicles.phases.among(AgentPhase.LOST) & ~excused
        time = self.vehicles.time
        self._lost_since = np.where(lost, np.fmin(self._lost_since, time), np.inf)
        late = (time - self._lost_since > MAX_LOST_TIME) & ~self.given_up()
        return f"{self._scene.named(np.flatnonzero(late))} is lost" if late.any() else ""

    def _report_refusals(self, refusals: Sequence[Refusal]) -> dict[int, str]:
        """Report commands that drones refused; return the reasons by row."""
        for row, reason in refusals:
            name = self._scene.agents[row].name
            self._observers.event("refused", f"{name} {reason}", name)
        return dict(refusals)

    def _send_commands(self, goals: GoalBuffer, estimate: Estimate) -> None:
        """Send the commands of this tick; landings are held back by the landing manager."""
        self.vehicles.release(goals.free)
        for command in goals.commands:
            self._send_command(command, estimate)
        self.landing.bring(sorted(goals.leave))

    def _send_command(self, command: Command, estimate: Estimate) -> None:
        if command.order is Order.LAND:
            self.landing.ask(command)
        else:
            self.vehicles.send_command(command, estimate)

    def _with_brakes(
        self, setpoint: Setpoint, telemetry: Telemetry, estimate: Estimate, health: Health
    ) -> Setpoint:
        """Add a zero velocity for agents in flight that are heard but not located.

        It needs no position, and without setpoints such an agent would fly on for a while.
        """
        heading = telemetry.heading + estimate.map_from_odom.yaw
        brakes = self._setpoints_sent & (health.phase == AgentPhase.LOST)
        brakes &= (health.age <= MAX_REPORT_AGE) & np.isfinite(heading) & ~self.vehicles.commanded
        self._setpoints_sent = setpoint.active | brakes
        if not brakes.any():
            return setpoint
        return Setpoint(
            velocity=np.where(brakes[:, None], 0.0, setpoint.velocity),
            yaw=np.where(brakes, heading, setpoint.yaw),
            active=self._setpoints_sent,
        )

    def _report_corrections(self, corrected: Corrected) -> None:
        """Report the agents whose setpoints begin to be corrected."""
        for why, text in CORRECTED.items():
            rows = getattr(corrected, why)
            if not rows.any():
                continue
            since = self.vehicles.time - self._corrected_at[why]
            self._corrected_at[why][rows] = self.vehicles.time
            for row in np.flatnonzero(rows & (since > REPORT_INTERVAL)).tolist():
                name = self._scene.agents[row].name
                self._observers.event("corrected", f"{name} {text}", name)

    def _report_incidents(self, incidents: Iterable[Incident]) -> None:
        """Record collisions and close approaches as events."""
        for one in incidents:
            self._observers.event(one.kind, one.text, details=one.details)

    def _record(self, tick: Tick) -> None:
        """Measure a tick and show it to the observers."""
        if tick.truth is None and not self._without_truth:
            self._without_truth = True
            self._observers.event("no_truth", NO_TRUTH)
        self.metrics.add(tick)
        self._report_incidents(self.contacts.update(tick))
        self._observers.notify("star_ticked", tick=tick)
