"""Flies a mission's ticks, and brings everybody down at the end whatever happens."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np

from star_core.contracts import Status
from star_core.crew import Crew
from star_core.descent import Descent
from star_core.errors import PluginError
from star_core.helm import Helm
from star_core.interrupts import Interrupts
from star_core.mission import Mission
from star_core.observers import Observers
from star_core.orders import Order
from star_core.phases import AIRBORNE, MissionPhase
from star_core.registry import Registry
from star_core.relief import Relief
from star_core.roster import Roster
from star_core.rules import Answer, Rules
from star_core.steering import Steering
from star_core.swarm import AgentPhase, Estimate, Health
from star_core.table import Mask, Rows
from star_core.tasks import Course
from star_core.wishes import Wishes

LOST_PATIENCE = 1.0  # s; told nothing for 2 s, a Crazyflie stops its motors
LAND_PATIENCE = 10.0  # s, beyond what a landing takes, before an agent counts as not landed

ANSWERS = {
    Answer.HOLD: "holds its place",
    Answer.LAND: "lands",
    Answer.STOP: "stops its motors",
}
"""What the record says of agents that a safety rule takes out of the mission."""


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
        self._lost_since = np.full(self._n, np.inf)  # s
        self._wall_time = 0.0
        self.reason: str | None = None
        crew.trajectories = self._course.trajectories
        self._helm = Helm(mission.scene, crew, self.observers)
        self._steering = Steering(mission.scene, crew, self._helm, self.observers)
        self._descent = Descent(mission.scene, self._helm, self.observers)

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
        return (
            self._steering.meter.summary(
                mission=mission,
                outcome=str(self._helm.phases.mission),
                reason=self.reason or "",
                wall_time=self._wall_time,
                took=self._crew.took,
                steps=self._course.steps,
                targets=self._helm.targets,
                events=self.observers.events,
            )
            | self._helm.lateness.summary()
        )

    def close(self) -> list[str]:
        """Close the tasks; return what went wrong."""
        return self._course.close()

    def _fly(self) -> str:
        """Fly to the end, land everybody, and return why it did not complete, if so."""
        try:
            end, reason = self._steps()
            reason = "; ".join(filter(None, (reason, self._bring_down(end))))
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
        self._helm.release(wishes.free)
        for command in wishes.commands:
            if command.order is Order.LAND:
                self._descent.ask(command)
            else:
                self._helm.order(command, estimate)
        self._descent.bring(sorted(wishes.leave))
        self._descent.step(estimate, wishes)
        self._course.hold(self._helm.phases.among(AgentPhase.FLYING), estimate)
        goals = wishes.goals()
        plan, active = self._steering.steer(
            telemetry, estimate, health, goals, ", ".join(wishes.doing)
        )
        self._course.no_way = {
            row: plan.reasons.get(row, "the planner finds no way to the goal")
            for row in np.flatnonzero(plan.unreachable & active).tolist()
        }
        return status

    def _judge(self, estimate: Estimate, health: Health) -> None:
        """Let the safety rules take agents that are in trouble out of the mission."""
        for row, answer, reason in self._rules.judge(self._helm.time, estimate, health):
            name = self._scene.agents[row].name
            self.event("safety", f"{name} {ANSWERS[answer]}: {reason}", name)
            self._course.drop(row, estimate)
            if answer is Answer.LAND:
                self._descent.bring([row])
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

    def _bring_down(self, end: str, *, at_once: bool = False) -> str:
        """Land everybody; return what went wrong on the way, if anything.

        Args:
            end: How the mission ended.
            at_once: Whether nobody is led to a free place first, which takes every plugin.
        """
        if end == "complete":
            self._helm.phases.fire_mission("land")
        estimate = self._helm.estimate
        if estimate is None:
            return ""
        begun = self._helm.time
        wishes = Wishes.none(self._n)
        self._down(np.arange(self._n), estimate, wishes, at_once=at_once)
        while (up := self._helm.phases.among(*AIRBORNE)).any():
            if self._interrupts.count > 1:
                self._helm.stop(up)
                return "stopped, motors off"
            ordered = max(begun, self._helm.down_by, self._descent.until)
            if self._helm.time >= ordered + LAND_PATIENCE:
                who = self._scene.named(np.flatnonzero(up).tolist())
                self.event("failure", f"{who} did not report to be on the ground")
                if not (up & ~self._left()).any():
                    break  # the mission had given them up
                return f"{who} did not report to be on the ground"
            telemetry, estimate, health = self._helm.look()
            lost = np.flatnonzero(self._helm.phases.among(AgentPhase.LOST))
            self._down(lost, estimate, wishes, at_once=at_once)
            if wishes.active.any():
                self._steering.steer(telemetry, estimate, health, wishes.goals(), "landing")
            else:
                self._steering.watch(telemetry, estimate, health)
        fallen = self._helm.phases.among(AgentPhase.EMERGENCY)
        if end == "complete" and (hurt := [int(r) for r in np.flatnonzero(fallen & ~self._left())]):
            return f"{self._scene.named(hurt)} ended in emergency"
        return ""

    def _down(self, rows: Rows, estimate: Estimate, wishes: Wishes, *, at_once: bool) -> None:
        """Order agents down, now or when each is at rest where it is free below."""
        wishes.active[:] = False
        if at_once:
            self._helm.land(rows, estimate)
        else:
            self._descent.bring(rows)
            self._descent.step(estimate, wishes)

    def _bring_down_broken(self) -> str:
        """Land everybody though a plugin is broken; return what went wrong, if anything."""
        try:
            return self._bring_down("fail", at_once=True)
        except PluginError:
            self._helm.without_localizer = True  # it may be the localizer that raised
        try:
            return self._bring_down("fail", at_once=True)
        except PluginError as error:
            for row in np.flatnonzero(self._helm.phases.among(*AIRBORNE)).tolist():
                name = self._scene.agents[row].name
                self.event(
                    "failure",
                    f"{name} is left to the transport's close, and its own time-outs",
                    name,
                )
            self.event("failure", f"nobody could be landed: {error}")
            return f"nobody could be landed: {error}"

    def _left(self) -> Mask:
        """Agents whose failure the mission allowed."""
        return self._roster.left()
