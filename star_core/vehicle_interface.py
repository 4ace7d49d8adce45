"""The swarm in the map frame: telemetry and estimates in, commands and setpoints out."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows
from star_core.messages.commands import Command, Order
from star_core.messages.state import AIRBORNE, AgentPhase, Estimate, Health, Setpoint, Truth
from star_core.messages.telemetry import Supervisor, Telemetry
from star_core.messages.transforms import LastKnownTransform, Transform
from star_core.messages.vision import Corrections, Sightings
from star_core.metrics.targets import Targets
from star_core.metrics.tick_timing import TickTiming
from star_core.observers import Observers
from star_core.phases import Phases
from star_core.pipeline import PluginPipeline
from star_core.safety.estimate_gate import EstimateGate
from star_core.safety.unheard import MAX_REPORT_AGE, UnheardAgents
from star_core.scene import Scene

log = logging.getLogger(__name__)

FLOWN_ON_BOARD = (Order.GOTO, Order.FOLLOW)  # no setpoints are sent until these are over
LAND_SPEED = 0.3  # m/s, when the core itself lands
CONTROLLER_LAG = 0.5  # s, by which the firmware's default controller follows a plan late
LAG_ALLOWANCE = 2 * CONTROLLER_LAG  # s, added to a landing: its plan ends with the motors off
MIN_LAND_TIME = 2.5  # s, likewise the shortest landing of all


class VehicleInterface:
    """Telemetry, estimates and phases in; commands and setpoints out, in each agent's own frame.

    Args:
        scene: The agents.
        pipeline: The four plugins; their transport is connected.
        observers: Receive changes of phases.

    Attributes:
        time: Of the tick, s.
        estimate: Of the tick; None before the first.
        phases: Of every agent and of the mission.
        commanded: (N,) agents whose on-board commander flies them to a point or along a trajectory.
        targets: What was found so far.
        down_by: When the last of all landings so far ends, s.
        timing: How late ticks came.
    """

    def __init__(self, scene: Scene, pipeline: PluginPipeline, observers: Observers) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._pipeline = pipeline
        self._observers = observers
        self._due = 0  # number of the next tick
        self.time = 0.0
        self.estimate: Estimate | None = None
        self.phases = Phases(scene.names)
        self.commanded = np.zeros(n, np.bool_)
        self.targets = Targets(scene)
        self.down_by = 0.0
        self.timing = TickTiming(scene.period, pipeline.took)
        self._localizer_failed = False
        self._until = np.zeros(n)  # s, earliest end of what a commander flies
        self._blind = False  # the truth cannot be had
        self._gate = EstimateGate(n, scene.limits.speed)
        self._unheard = UnheardAgents(n)
        self._frames = LastKnownTransform(
            Transform(
                np.array([agent.yaw for agent in scene.agents]),
                np.array([agent.start for agent in scene.agents]),
            )
        )

    def receive(self) -> Telemetry:
        """Wait for the next tick, and return what arrived since the last one."""
        due = self._due * self._scene.period
        self.time = self._pipeline.wait(due)
        self._observers.begin_tick(self.time)
        if late := self.timing.note(due, self.time):
            self._observers.event("late", late)
        for slow in self._pipeline.compute_time.end_tick():
            log.warning("%s", slow)
            self._observers.event("slow", slow)
        self._due = max(self._due, int(self.time / self._scene.period + 1e-6)) + 1
        return self._pipeline.receive()

    def locate(self, telemetry: Telemetry) -> Estimate:
        """Estimate where the agents are; send the corrections of their own estimators."""
        if self._localizer_failed and self.estimate is not None:
            estimate = self._without_localizer(self.estimate, telemetry.time)
        else:
            estimate = self._pipeline.locate(telemetry)
            frames = self._frames.last_known(estimate.map_from_odom)
            if frames is not estimate.map_from_odom:
                estimate = replace(estimate, map_from_odom=frames)
            if len(estimate.corrections.agent):
                self._pipeline.correct(estimate.corrections)
            estimate = self._gated(estimate)
        self.estimate = self._unheard.mark(estimate, telemetry.age)
        return self.estimate

    def track(self, telemetry: Telemetry, estimate: Estimate) -> Health:
        """Update the phases of the agents and the targets they found; return their health."""
        heard = telemetry.age <= MAX_REPORT_AGE
        self.phases.observe(telemetry.state, heard, estimate.valid)
        if telemetry.rebooted is not None and telemetry.rebooted.any():
            self._ground(telemetry.rebooted)
        finished = telemetry.state & int(Supervisor.COMMANDER_FINISHED) != 0
        finished &= self.time >= self._until  # earlier it is the command before that is over
        self.commanded &= ~finished
        for target, finder in self.targets.see(estimate.sightings, self.time):
            self._observers.event("found", f"{finder} found {target!r}", finder)
        health = Health(
            self.phases.of_agents(), telemetry.battery, telemetry.age, self.targets.finder
        )
        self.report_phases()
        return health

    def stop_locating(self) -> None:
        """Ask the localizer no more, which is broken: from now on no agent is located."""
        self._localizer_failed = True

    def setpoint(self, planned: Setpoint, estimate: Estimate) -> Setpoint:
        """Return a planned setpoint for the agents that setpoints fly.

        Rows that the planner leaves inactive get zero velocity; without a setpoint the drone would
        fall.
        """
        given = planned.active
        flying = self.phases.among(AgentPhase.FLYING)
        return Setpoint(
            velocity=np.where(given[:, None], planned.velocity, 0.0),
            yaw=np.where(given, planned.yaw, estimate.yaw),
            active=flying & estimate.valid & ~self.commanded,
        )

    @staticmethod
    def _without_localizer(last: Estimate, time: float) -> Estimate:
        """Return the last estimate with no agent located."""
        return replace(
            last,
            time=time,
            valid=np.zeros(len(last.yaw), np.bool_),
            corrections=Corrections.none(),
            sightings=Sightings.none(),
        )

    def _gated(self, estimate: Estimate) -> Estimate:
        """Return the estimate without positions that cannot be true, and report new ones."""
        accepted, jumps = self._gate.check(estimate, self.phases.among(*AIRBORNE))
        for jump in jumps:
            name = self._scene.agents[jump.row].name
            self._observers.event(
                "estimate",
                f"{name} brakes: its estimated position moved {jump.distance:.2f} m in "
                f"{jump.seconds:.2f} s, expected at most {jump.plausible:.2f} m from "
                f"{self._pipeline.localizer}",
                name,
            )
        return accepted

    def _ground(self, rebooted: Mask) -> None:
        """Take agents out of the flight that rebooted, unless they have landed before."""
        unfit = rebooted & self.phases.among(AgentPhase.GROUNDED, *AIRBORNE)
        flew = self.phases.among(*AIRBORNE)
        for row in np.flatnonzero(unfit).tolist():
            name = self._scene.agents[row].name
            what = "in flight: its motors stopped" if flew[row] else "before its take-off"
            text = f"{name} rebooted {what}; it is not flown any more"
            self._observers.event("failure", text, name)
        self.phases.fire("fail", np.flatnonzero(unfit))

    def send(self, setpoint: Setpoint, estimate: Estimate) -> Setpoint:
        """Send a setpoint; return what was sent."""
        to_map = estimate.map_from_odom
        odom = replace(
            setpoint,
            velocity=to_map.turn_back(setpoint.velocity),
            yaw=setpoint.yaw - to_map.yaw,
        )
        sent = self._pipeline.send(odom)
        if sent is odom:
            return setpoint
        return replace(sent, velocity=to_map.turn(sent.velocity), yaw=sent.yaw + to_map.yaw)

    def send_command(self, command: Command, estimate: Estimate) -> None:
        """Send a command to the on-board commanders, and follow it in the agents' phases."""
        to_odom = estimate.map_from_odom.of(command.agent).inverse()
        self._pipeline.command(
            replace(
                command,
                position=to_odom.apply(command.position),
                yaw=command.yaw + to_odom.yaw,
            )
        )
        if command.order is not Order.ARM:
            self.commanded[command.agent] = command.order in FLOWN_ON_BOARD
        match command.order:
            case Order.TAKEOFF:
                self.phases.fire("take_off", command.agent)
            case Order.LAND:
                self.phases.fire("land", command.agent)
                self.down_by = max(self.down_by, self.time + float(command.duration.max(initial=0)))
            case Order.STOP:
                self.phases.fire("fail", command.agent)
            case Order.GOTO | Order.FOLLOW:
                self._until[command.agent] = self.time + command.duration
        self.report_phases()

    def release(self, rows: Iterable[int]) -> None:
        """Fly agents by setpoints again, whatever their commanders fly."""
        for row in rows:
            self.commanded[row] = False

    def land(self, rows: Rows, estimate: Estimate, takes: Array | None = None) -> None:
        """Command those of some agents to land that are in the air, from their positions.

        Args:
            rows: (K,) the agents.
            estimate: Where they are.
            takes: (K,) how long, s; NaN, or nothing given, is at the core's own pace. No descent
                takes less than `MIN_LAND_TIME`.
        """
        airborne = self.phases.among(AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LOST)
        up = airborne[rows]
        rows = rows[up]
        if not len(rows):
            return
        position = estimate.position[rows].copy()
        unknown = ~np.isfinite(position[:, 2])
        position[unknown, 2] = self._scene.limits.height[1]
        position[:, 2] = np.minimum(position[:, 2], self._scene.world.fence.high[2])
        position = np.nan_to_num(position)
        # a plan begins where the plan before is, which an agent that climbs follows late
        rise = CONTROLLER_LAG * np.maximum(0.0, np.nan_to_num(estimate.velocity[rows, 2]))
        duration = (position[:, 2] + rise) / LAND_SPEED + LAG_ALLOWANCE
        if takes is not None:
            duration = np.where(np.isnan(takes[up]), duration, takes[up])
        duration = np.maximum(duration, MIN_LAND_TIME)
        position[:, 2] = 0.0
        yaw = np.nan_to_num(estimate.yaw[rows])
        self.send_command(Command(Order.LAND, rows, position, yaw, duration), estimate)

    def emergency_stop(self, agents: Mask) -> None:
        """Stop the motors of some agents at once, for the operator."""
        rows = np.flatnonzero(agents)
        self._observers.event(
            "interrupt", f"the operator stops the motors of {self._scene.named(rows)}"
        )
        self.stop_motors(rows)

    def stop_motors(self, rows: Rows) -> None:
        """Send the command that stops motors."""
        zero = np.zeros(len(rows))
        if self.estimate is not None:
            command = Command(Order.STOP, rows, np.zeros((len(rows), 3)), zero, zero)
            self.send_command(command, self.estimate)

    def truth(self) -> Truth | None:
        """Where the agents really are; a transport that failed to tell is not asked again."""
        if self._blind:
            return None
        self._blind = True
        truth = self._pipeline.truth()
        self._blind = False
        return truth

    def report_phases(self) -> None:
        """Report the phases that have changed to the observers."""
        for agent, phase in self.phases.changes():
            self._observers.notify("star_phase_changed", time=self.time, agent=agent, phase=phase)
            if phase in {"lost", "emergency"}:
                self._observers.event("failure", f"{agent} is {phase}", agent)
