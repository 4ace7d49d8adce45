"""Flies a mission's ticks, and brings everybody down at the end whatever happens."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from star_core.contracts import Status
from star_core.crew import Crew
from star_core.errors import PluginError
from star_core.flight import Tick
from star_core.frames import Lying, Transform
from star_core.interrupts import Interrupts
from star_core.mission import Mission
from star_core.observers import Observers
from star_core.phases import AIRBORNE, MissionPhase, Phases
from star_core.registry import Registry
from star_core.safety import limited
from star_core.summary import Meter
from star_core.swarm import (
    AgentPhase,
    Command,
    Estimate,
    Goals,
    Health,
    Order,
    Paths,
    Plan,
    Setpoint,
    Supervisor,
    Telemetry,
    Truth,
)
from star_core.table import Mask, Rows
from star_core.tasks import Course

STALE_AFTER = 0.5  # s, an agent not heard for longer is lost: the firmware's commander time-out
LOST_PATIENCE = 1.0  # s; told nothing for 2 s, a Crazyflie stops its motors
LAND_SPEED = 0.3  # m/s, when the core itself lands
LAND_SHORTEST = 1.0  # s, the quickest landing the core asks for
LAND_PATIENCE = 10.0  # s, beyond what a landing takes, before an agent counts as not landed


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
        self._phases = Phases(mission.scene.names)
        self._course = Course(mission, registry, self.event)
        self._due = 0  # number of the next tick
        self._time = 0.0
        self._estimate: Estimate | None = None
        self._lost_localizer = False
        self._commanded = np.zeros(self._n, np.bool_)  # flies to a place on its own, on board
        self._until = np.zeros(self._n)  # s, until when it does at least
        self._lost_since = np.full(self._n, np.inf)  # s
        self._lying = Lying(
            Transform(
                np.array([agent.yaw for agent in mission.scene.agents]),
                np.array([agent.start for agent in mission.scene.agents]),
            )
        )
        self._blind = False  # the truth cannot be had
        self._wall_time = 0.0
        self.reason: str | None = None
        self._meter = Meter(mission.scene)
        self.observers = Observers(registry.manager)

    def fly(self) -> None:
        """Fly to the end, and land everybody."""
        begun = time.perf_counter()
        self.reason = ""
        self._phases.fire_mission("start")
        try:
            self.reason = self._fly()
        finally:
            self._wall_time = time.perf_counter() - begun

    def summary(self, mission: str) -> dict[str, Any]:
        """Sum the flight up, as ``summary.json`` keeps it."""
        return self._meter.summary(
            mission=mission,
            outcome=str(self._phases.mission),
            reason=self.reason or "",
            wall_time=self._wall_time,
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
                self._phases.fire_mission("abort")
                self._tell_phases()
            raise
        self._phases.fire_mission(end)
        if self._phases.mission is MissionPhase.COMPLETED and reason:
            self._phases.fire_mission("fail")
        self._tell_phases()
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
        telemetry, estimate, health = self._look()
        if late := self._lost_too_long():
            self._course.reason = late
            return Status.FAILURE
        status, wishes = self._course.step(estimate, health)
        for command in wishes.commands:
            self._order(command, estimate)
        if wishes.leave:
            self._land(np.array(sorted(wishes.leave)), estimate)
        flying = self._phases.among(AgentPhase.FLYING)
        self._course.hold(flying, estimate)
        goals = wishes.goals()
        plan = self._crew.plan(estimate, goals)
        active = flying & estimate.valid & ~self._commanded
        said = plan.setpoint.active  # who is left out brakes: told nothing, a drone would fall
        wanted = Setpoint(
            velocity=np.where(said[:, None], plan.setpoint.velocity, 0.0),
            yaw=np.where(said, plan.setpoint.yaw, estimate.yaw),
            active=active,
        )
        safe = self._crew.avoid(estimate, wanted)
        sent = self._send(limited(safe, wanted, self._scene.limits.speed), estimate)
        self._record(telemetry, estimate, health, goals, plan, sent, ", ".join(wishes.doing))
        return status

    def _lost_too_long(self) -> str:
        """Say who was lost for so long, and is in no step that says what to do, that all land."""
        lost = self._phases.among(AgentPhase.LOST)
        if not lost.any():
            self._lost_since.fill(np.inf)
            return ""
        self._lost_since = np.where(lost, np.fmin(self._lost_since, self._time), np.inf)
        late = np.flatnonzero((self._time - self._lost_since > LOST_PATIENCE) & ~self._left())
        return f"{self._scene.named(late)} is lost" if len(late) else ""

    def _look(self) -> tuple[Telemetry, Estimate, Health]:
        """Wait for the tick that is due, and see how things are."""
        self._time = self.observers.time = self._crew.wait(self._due * self._scene.period)
        self._due = max(self._due, int(self._time / self._scene.period + 1e-6)) + 1
        telemetry = self._crew.receive()
        if self._lost_localizer and self._estimate is not None:
            nobody = np.zeros(self._n, np.bool_)
            estimate = replace(self._estimate, time=telemetry.time, valid=nobody)
        else:
            estimate = self._crew.locate(telemetry)
            lies = self._lying.last_known(estimate.map_from_odom)
            estimate = replace(estimate, map_from_odom=lies)
            if len(estimate.corrections.agent):
                self._crew.correct(estimate.corrections)
        self._estimate = estimate
        heard = telemetry.age <= STALE_AFTER
        self._phases.observe(telemetry.state, heard, estimate.valid)
        finished = telemetry.state & int(Supervisor.COMMANDER_FINISHED) != 0
        finished &= self._time >= self._until  # earlier it is the order before that is over
        self._commanded &= ~finished
        health = Health(self._phases.of_agents(), telemetry.battery, telemetry.age)
        self._tell_phases()
        return telemetry, estimate, health

    def _send(self, setpoint: Setpoint, estimate: Estimate) -> Setpoint:
        """Send a setpoint in the agents' odometry frames; return what was sent, in the map."""
        to_map = estimate.map_from_odom
        odom = replace(
            setpoint,
            velocity=to_map.turn_back(setpoint.velocity),
            yaw=setpoint.yaw - to_map.yaw,
        )
        sent = self._crew.send(odom)
        return replace(sent, velocity=to_map.turn(sent.velocity), yaw=sent.yaw + to_map.yaw)

    def _order(self, command: Command, estimate: Estimate) -> None:
        """Give an order in the agents' odometry frames, and follow it in their phases."""
        to_odom = estimate.map_from_odom.of(command.agent).inverse()
        self._crew.command(
            replace(
                command,
                position=to_odom.apply(command.position),
                yaw=command.yaw + to_odom.yaw,
            )
        )
        match command.order:
            case Order.TAKEOFF:
                self._phases.fire("take_off", command.agent)
            case Order.LAND:
                self._phases.fire("land", command.agent)
            case Order.STOP:
                self._phases.fire("fail", command.agent)
            case Order.GOTO:
                self._commanded[command.agent] = True
                self._until[command.agent] = self._time + command.duration
        self._tell_phases()

    def _land(self, rows: Rows, estimate: Estimate) -> float:
        """Land those of some agents that are in the air; return how long the longest takes, s."""
        airborne = self._phases.among(AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LOST)
        rows = rows[airborne[rows]]
        if not len(rows):
            return 0.0
        position = estimate.position[rows].copy()
        unknown = ~np.isfinite(position[:, 2])
        position[unknown, 2] = self._scene.limits.height[1]
        position = np.nan_to_num(position)
        duration = np.maximum(LAND_SHORTEST, position[:, 2] / LAND_SPEED)
        position[:, 2] = 0.0
        yaw = np.nan_to_num(estimate.yaw[rows])
        self._order(Command(Order.LAND, rows, position, yaw, duration), estimate)
        return float(duration.max())

    def _bring_down(self, end: str) -> str:
        """Land everybody; return what went wrong on the way, if anything."""
        if end == "complete":
            self._phases.fire_mission("land")
        estimate = self._estimate
        if estimate is None:
            return ""
        takes = self._land(np.arange(self._n), estimate)
        until = self._time + takes + LAND_PATIENCE
        while (up := self._phases.among(*AIRBORNE)).any():
            if self._interrupts.count > 1:
                self._stop(up)
                return "stopped by the operator: motors off"
            if self._time >= until:
                who = self._scene.named(np.flatnonzero(up).tolist())
                self.event("failure", f"{who} did not report to be on the ground")
                return f"{who} did not report to be on the ground"
            telemetry, estimate, health = self._look()
            self._land(np.flatnonzero(self._phases.among(AgentPhase.LOST)), estimate)
            n = self._n
            still = Setpoint(np.zeros((n, 3)), np.zeros(n), np.zeros(n, np.bool_))
            nowhere = Paths(np.zeros(0, np.int64), np.zeros((0, 3)))
            plan = Plan(still, nowhere, np.zeros(n, np.bool_))
            self._record(telemetry, estimate, health, Goals.none(n), plan, still, "landing")
        fallen = self._phases.among(AgentPhase.EMERGENCY)
        if end == "complete" and (hurt := [int(r) for r in np.flatnonzero(fallen & ~self._left())]):
            return f"{self._scene.named(hurt)} ended in emergency"
        return ""

    def _bring_down_broken(self) -> str:
        """Land everybody though a plugin is broken; return what went wrong, if anything."""
        try:
            return self._bring_down("fail")
        except PluginError:
            self._lost_localizer = True  # it may be the localizer that raised: land without it
        try:
            return self._bring_down("fail")
        except PluginError as error:
            self.event("failure", f"nobody could be landed: {error}")
            return f"nobody could be landed: {error}"

    def _left(self) -> Mask:
        """Agents whose failure the mission allowed."""
        left = np.zeros(self._n, np.bool_)
        left[sorted(self._course.left)] = True
        return left

    def _stop(self, up: Mask) -> None:
        """Switch motors off, at once."""
        rows = np.flatnonzero(up)
        self.event("interrupt", f"the operator stops the motors of {self._scene.named(rows)}")
        zero = np.zeros(len(rows))
        if self._estimate is not None:
            command = Command(Order.STOP, rows, np.zeros((len(rows), 3)), zero, zero)
            self._order(command, self._estimate)

    def _record(
        self,
        telemetry: Telemetry,
        estimate: Estimate,
        health: Health,
        goals: Goals,
        plan: Plan,
        sent: Setpoint,
        doing: str,
    ) -> None:
        """Measure a tick and show it to the observers."""
        tick = Tick(
            self._time, telemetry, estimate, health, goals, plan, sent, self._truth(), doing
        )
        self._meter.add(tick)
        self.observers.tell("star_ticked", tick=tick)

    def _truth(self) -> Truth | None:
        """Where the agents really are; a transport that failed to tell is not asked again."""
        if self._blind:
            return None
        self._blind = True
        truth = self._crew.truth()
        self._blind = False
        return truth

    def _tell_phases(self) -> None:
        for agent, phase in self._phases.changes():
            self.observers.tell("star_phase_changed", time=self._time, agent=agent, phase=phase)
            if phase in {"lost", "emergency"}:
                self.event("failure", f"{agent} is {phase}", agent)
