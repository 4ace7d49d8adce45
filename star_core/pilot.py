"""Flies a mission's ticks, and brings everybody down at the end whatever happens."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np

from star_core.contracts import Status
from star_core.crew import Crew
from star_core.errors import PluginError
from star_core.flight import Corrected, Tick
from star_core.helm import Helm
from star_core.interrupts import Interrupts
from star_core.mission import Mission
from star_core.observers import Observers
from star_core.phases import AIRBORNE, MissionPhase
from star_core.registry import Registry
from star_core.relief import Relief
from star_core.roster import Roster
from star_core.rules import Answer, Rules
from star_core.safety import SafetyFilter
from star_core.summary import Meter
from star_core.swarm import (
    AgentPhase,
    Estimate,
    Goals,
    Health,
    Paths,
    Plan,
    Setpoint,
    Telemetry,
)
from star_core.table import Mask
from star_core.tasks import Course

LOST_PATIENCE = 1.0  # s; told nothing for 2 s, a Crazyflie stops its motors
LAND_PATIENCE = 10.0  # s, beyond what a landing takes, before an agent counts as not landed
CALM = 1.0  # s without a correction, after which the next one is told again

ANSWERS = {
    Answer.HOLD: "holds its place",
    Answer.LAND: "lands",
    Answer.STOP: "stops its motors",
}
"""What the record says of agents that a safety rule takes out of the mission."""

CORRECTED = {
    "fence": "is held inside the fence",
    "speed": "is slowed to the speed limit",
    "separation": "brakes for another agent",
}
"""What the record says of the agents that `star_core.safety` corrects, by the reason."""


class Pilot:
    """Flies one mission with a crew, which is connected before `fly`.

    Args:
        mission: What to fly.
        registry: Where verbs and observers are found.
        crew: The four parts.
        interrupts: The operator's wish to end.

    Attributes:
        reason: Why it did not complete; empty when it did, None before it flies.
    """

    def __init__(
        self, mission: Mission, registry: Registry, crew: Crew, interrupts: Interrupts
    ) -> None:
        self._scene = mission.scene
        self._n = len(mission.scene.agents)
        self._crew = crew
        self._interrupts = interrupts
        self.observers = Observers(registry.manager)
        self._roster = Roster(self._n, mission.reserve_rows)
        self._course = Course(mission, registry, self._roster, self.event, self.observers.events)
        self._rules = Rules(mission.scene, mission.safety)
        self._relief = Relief(
            mission.scene, self._roster, self._rules, mission.reserve, partial(self.event, "relief")
        )
        self._safety = SafetyFilter(mission.scene)
        self._corrected = {why: np.full(self._n, -np.inf) for why in CORRECTED}  # s, when last
        self._lost_since = np.full(self._n, np.inf)  # s
        self._wall_time = 0.0
        self.reason: str | None = None
        self._meter = Meter(mission.scene)
        self._helm = Helm(mission.scene, crew, self.observers)

    def fly(self) -> None:
        """Fly to the end, and land everybody."""
        begun = time.perf_counter()
        self.reason = ""
        self._helm.phases.fire_mission("start")
        try:
            self.reason = self._fly()
        finally:
            self._wall_time = time.perf_counter() - begun

    def summary(self, mission: str) -> dict[str, Any]:
        """Sum the flight up, as ``summary.json`` keeps it."""
        return self._meter.summary(
            mission=mission,
            outcome=str(self._helm.phases.mission),
            reason=self.reason or "",
            wall_time=self._wall_time,
            took=self._crew.took,
            steps=self._course.steps,
            targets=self._helm.targets,
            events=self.observers.events,
        )

    def close(self) -> list[str]:
        """Close the tasks; return what went wrong."""
        return self._course.close()

    def _fly(self) -> str:
        """Fly to the end, land everybody, and return why it did not complete, if so."""
        try:
            end, reason = self._steps()
            reason = self._bring_down(end) or reason
        except PluginError as error:
            end, reason = "fail", str(error)
            self.event("failure", reason)
            reason = "; ".join(filter(None, (reason, self._bring_down_broken())))
        except BaseException as error:
            self.reason = f"Python was interrupted: {type(error).__name__}"
            try:
                self._bring_down_broken()
            finally:  # it may be interrupted again
                self._helm.phases.fire_mission("abort")
                self._helm.tell_phases()
            raise
        self._helm.phases.fire_mission(end)
        if self._helm.phases.mission is MissionPhase.COMPLETED and reason:
            self._helm.phases.fire_mission("fail")
        self._helm.tell_phases()
        return reason

    def event(self, kind: str, text: str, agent: str | None = None) -> None:
        """Put an event on record."""
        self.observers.event(kind, text, agent)

    def _steps(self) -> tuple[str, str]:
        """Fly the mission's steps; return how they ended (a trigger of the mission) and why."""
        while True:
            status = self._tick()
            if self._interrupts.count:
                self.event("interrupt", "the operator ends the flight: everybody lands")
                return "abort", "interrupted by the operator"
            if status is Status.FAILURE:
                self.event("failure", self._course.reason)
                return "fail", self._course.reason
            if status is Status.SUCCESS:
                return "complete", ""

    def _tick(self) -> Status:
        """Receive, locate, run the steps, plan, avoid, limit, send: once, for the whole swarm."""
        telemetry, estimate, health = self._helm.look()
        self._judge(estimate, health)
        if why := self._nobody_left() or self._lost_too_long():
            self._course.reason = why
            return Status.FAILURE
        self._course.refused = dict(telemetry.refusals)
        for row, reason in telemetry.refusals:
            name = self._scene.agents[row].name
            self.event("refused", f"{name} {reason}", name)
        status, wishes = self._course.step(self._helm.time, estimate, health)
        self._relief.step(self._helm.time, estimate, health, wishes)
        for command in wishes.commands:
            self._helm.order(command, estimate)
        if wishes.leave:
            self._helm.land(np.array(sorted(wishes.leave)), estimate)
        flying = self._helm.phases.among(AgentPhase.FLYING)
        self._course.hold(flying, estimate)
        goals = wishes.goals()
        plan = self._crew.plan(estimate, goals)
        active = flying & estimate.valid & ~self._helm.commanded
        said = plan.setpoint.active  # who is left out brakes: told nothing, a drone would fall
        wanted = Setpoint(
            velocity=np.where(said[:, None], plan.setpoint.velocity, 0.0),
            yaw=np.where(said, plan.setpoint.yaw, estimate.yaw),
            active=active,
        )
        safe = self._crew.avoid(estimate, wanted)
        with self._crew.timed("safety"):
            last, corrected = self._safety.filter(estimate, safe, wanted)
        self._tell_corrected(corrected)
        sent = self._helm.send(last, estimate)
        self._course.no_way = {
            row: plan.reasons.get(row, "the planner finds no way to the goal")
            for row in np.flatnonzero(plan.unreachable & active).tolist()
        }
        self._record(
            telemetry, estimate, health, goals, plan, sent, ", ".join(wishes.doing), corrected
        )
        return status

    def _tell_corrected(self, corrected: Corrected) -> None:
        """Put on record whose setpoints begin to be corrected."""
        for why, text in CORRECTED.items():
            who = getattr(corrected, why)
            if not who.any():
                continue
            since = self._helm.time - self._corrected[why]
            self._corrected[why][who] = self._helm.time
            for row in np.flatnonzero(who & (since > CALM)).tolist():
                name = self._scene.agents[row].name
                self.event("safety", f"{name} {text}", name)

    def _judge(self, estimate: Estimate, health: Health) -> None:
        """Let the safety rules take agents that are in trouble out of the mission."""
        for row, answer, reason in self._rules.judge(self._helm.time, estimate, health):
            name = self._scene.agents[row].name
            self.event("safety", f"{name} {ANSWERS[answer]}: {reason}", name)
            self._course.drop(row, estimate)
            if answer is Answer.LAND:
                self._helm.land(np.array([row]), estimate)
            elif answer is Answer.STOP:
                self._helm.cut(np.array([row]))
        self._course.excused = self._rules.excuse(health, estimate.valid)

    def _nobody_left(self) -> str:
        """Say so if the safety rules have taken every agent out of the mission."""
        nobody = self._rules.answer.any() and self._roster.left().all()
        return "the safety rules left no agent" if nobody else ""

    def _lost_too_long(self) -> str:
        """Say who was lost for so long, and is in no step that says what to do, that all land."""
        lost = self._helm.phases.among(AgentPhase.LOST) & ~self._course.excused
        if not lost.any():
            self._lost_since.fill(np.inf)
            return ""
        self._lost_since = np.where(lost, np.fmin(self._lost_since, self._helm.time), np.inf)
        late = np.flatnonzero((self._helm.time - self._lost_since > LOST_PATIENCE) & ~self._left())
        return f"{self._scene.named(late)} is lost" if len(late) else ""

    def _bring_down(self, end: str) -> str:
        """Land everybody; return what went wrong on the way, if anything."""
        if end == "complete":
            self._helm.phases.fire_mission("land")
        estimate = self._helm.estimate
        if estimate is None:
            return ""
        takes = self._helm.land(np.arange(self._n), estimate)
        until = self._helm.time + takes + LAND_PATIENCE
        while (up := self._helm.phases.among(*AIRBORNE)).any():
            if self._interrupts.count > 1:
                self._helm.stop(up)
                return "stopped by the operator: motors off"
            if self._helm.time >= until:
                who = self._scene.named(np.flatnonzero(up).tolist())
                self.event("failure", f"{who} did not report to be on the ground")
                if not (up & ~self._left()).any():
                    break  # the mission had given them up
                return f"{who} did not report to be on the ground"
            telemetry, estimate, health = self._helm.look()
            self._helm.land(np.flatnonzero(self._helm.phases.among(AgentPhase.LOST)), estimate)
            n = self._n
            still = Setpoint(np.zeros((n, 3)), np.zeros(n), np.zeros(n, np.bool_))
            nowhere = Paths(np.zeros(0, np.int64), np.zeros((0, 3)))
            plan = Plan(still, nowhere, np.zeros(n, np.bool_))
            nobody = np.zeros(n, np.bool_)
            self._record(
                telemetry,
                estimate,
                health,
                Goals.none(n),
                plan,
                still,
                "landing",
                Corrected(nobody, nobody, nobody),
            )
        fallen = self._helm.phases.among(AgentPhase.EMERGENCY)
        if end == "complete" and (hurt := [int(r) for r in np.flatnonzero(fallen & ~self._left())]):
            return f"{self._scene.named(hurt)} ended in emergency"
        return ""

    def _bring_down_broken(self) -> str:
        """Land everybody though a plugin is broken; return what went wrong, if anything."""
        try:
            return self._bring_down("fail")
        except PluginError:
            self._helm.without_localizer = True  # it may be the localizer that raised
        try:
            return self._bring_down("fail")
        except PluginError as error:
            for row in np.flatnonzero(self._helm.phases.among(*AIRBORNE)).tolist():
                name = self._scene.agents[row].name
                self.event("failure", f"{name} is left to its own time-out", name)
            self.event("failure", f"nobody could be landed: {error}")
            return f"nobody could be landed: {error}"

    def _left(self) -> Mask:
        """Agents whose failure the mission allowed."""
        return self._roster.left()

    def _record(
        self,
        telemetry: Telemetry,
        estimate: Estimate,
        health: Health,
        goals: Goals,
        plan: Plan,
        sent: Setpoint,
        doing: str,
        corrected: Corrected,
    ) -> None:
        """Measure a tick and show it to the observers."""
        now, truth = self._helm.time, self._helm.truth()
        tick = Tick(now, telemetry, estimate, health, goals, plan, sent, truth, doing, corrected)
        self._meter.add(tick)
        self.observers.tell("star_ticked", tick=tick)
