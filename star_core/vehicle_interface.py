"""The swarm in the map frame: telemetry, estimates and phases in, commands and setpoints out."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows
from star_core.messages.commands import Command, Order
from star_core.messages.rotations import Transform
from star_core.messages.state import AIRBORNE, AgentPhase, Estimate, Health, Setpoint, Truth
from star_core.messages.telemetry import Supervisor, Telemetry
from star_core.metrics.targets import Targets
from star_core.metrics.timing import TickTiming
from star_core.observers import Observers
from star_core.phases import Phases
from star_core.pipeline import PluginPipeline, renewed
from star_core.safety.monitor import FALL_TIME, MAX_REPORT_AGE, EstimateGate, UnheardAgents
from star_core.safety.motion_check import MotionCheck
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
        targets: That were found so far.
        down_by: Time at which the last of all landings so far ends, s.
        timing: Lateness of the ticks.
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
        self._commanded = np.zeros(n, np.bool_)  # flown on board to a point or along a trajectory
        self.targets = Targets(scene)
        self.down_by = 0.0
        self.timing = TickTiming(scene.period)
        self._localizer_failed = False
        self._until = np.zeros(n)  # s, earliest end of what a commander flies
        self._setpoints_sent = np.zeros(n, np.bool_)  # in the last tick
        self._truth_failed = False
        self._gate = EstimateGate(n, scene.limits.speed)
        self._motion = MotionCheck(n)
        self._contradicted = np.zeros(n, np.bool_)
        self._unheard = UnheardAgents(n, scene.limits)
        self._heard = np.ones(n, np.bool_)
        self._frames = Transform(  # last known
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents]),
        )

    def receive(self) -> Telemetry:
        """Wait for the next tick, and return what arrived since the last one."""
        self.wait()
        return self._pipeline.receive()

    def wait(self) -> None:
        """Wait for the next tick."""
        due = self._due * self._scene.period
        self.time = self._pipeline.wait(due)
        self._observers.begin_tick(self.time)
        in_flight = bool(self.phases.among(*AIRBORNE).any())
        self._pipeline.strikes.begin_tick(in_flight=in_flight)
        if late := self.timing.note(due, self.time, self._pipeline.took()):
            self._observers.event("late", late)
        for slow in self._pipeline.compute_time.end_tick():
            log.warning("%s", slow)
            self._observers.event("slow", slow)
        self._due = max(self._due, int(self.time / self._scene.period + 1e-6)) + 1

    def locate(self, telemetry: Telemetry) -> Estimate:
        """Estimate the positions of the agents; send corrections to their own estimators."""
        if self._localizer_failed and self.estimate is not None:
            unlocated = np.zeros(len(self.estimate.valid), np.bool_)
            estimate = replace(renewed(self.estimate, telemetry.time), valid=unlocated)
        else:
            estimate = self._with_known_frames(self._pipeline.locate(telemetry))
            if len(estimate.corrections.agent):
                self._pipeline.correct(estimate.corrections)
            estimate = self._gated(estimate, telemetry)
        self._heard = telemetry.age <= MAX_REPORT_AGE
        self.estimate = self._unheard.mark(estimate, telemetry.age, self.phases.among(*AIRBORNE))
        return self.estimate

    def track(self, telemetry: Telemetry, estimate: Estimate) -> Health:
        """Update the phases of the agents and the targets they found; return their health."""
        heard = telemetry.age <= MAX_REPORT_AGE
        self.phases.observe(telemetry.state, heard, estimate.valid)
        if telemetry.rebooted is not None and telemetry.rebooted.any():
            self._ground(telemetry.rebooted)
        finished = telemetry.state & int(Supervisor.COMMANDER_FINISHED) != 0
        finished &= self.time >= self._until  # earlier it refers to the previous command
        self._commanded &= ~finished
        if len(estimate.sightings.tag):
            for target, finder in self.targets.add(estimate.sightings, self.time):
                self._observers.event("found", f"{finder} found {target!r}", finder)
        health = Health(
            self.phases.of_agents(), telemetry.battery, telemetry.age, self.targets.finder
        )
        self.report_phases()
        return health

    def stop_locating(self) -> None:
        """Stop calling the localizer, which has failed: from now on no agent is located."""
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
            active=flying & estimate.valid & ~self._commanded,
        )

    def send(self, setpoint: Setpoint, telemetry: Telemetry, estimate: Estimate) -> Setpoint:
        """Send a setpoint, with zero velocity for agents that must brake; return what was sent."""
        setpoint = self._with_brakes(setpoint, telemetry, estimate)
        to_map = estimate.map_from_odom
        odom = replace(
            setpoint,
            velocity=to_map.turn_back(setpoint.velocity),
            yaw=setpoint.yaw - to_map.yaw,
        )
        sent = self._pipeline.send(odom, to_map)
        self._unheard.steered(self.time, setpoint.active)
        if sent is odom:
            return setpoint
        return replace(sent, velocity=to_map.turn(sent.velocity), yaw=sent.yaw + to_map.yaw)

    def send_command(self, command: Command, estimate: Estimate) -> None:
        """Send a command to the on-board commanders, and update the agents' phases."""
        to_odom = estimate.map_from_odom.of(command.agent).inverse()
        self._pipeline.command(
            replace(
                command,
                position=to_odom.apply(command.position),
                yaw=command.yaw + to_odom.yaw,
            )
        )
        if command.order is not Order.ARM:
            self._commanded[command.agent] = command.order in FLOWN_ON_BOARD
        heard = self._heard[command.agent]
        match command.order:
            case Order.TAKEOFF:
                self._unheard.flies_on_board(command.agent)
                self.phases.fire("take_off", command.agent)
            case Order.LAND:
                self._unheard.lands(command.agent, self.time + command.duration, heard)
                self.phases.fire("land", command.agent)
                self.down_by = max(self.down_by, self.time + float(command.duration.max(initial=0)))
            case Order.STOP:
                fallen = np.full(len(heard), self.time + FALL_TIME)
                self._unheard.lands(command.agent, fallen, heard)
                self.phases.fire("fail", command.agent)
            case Order.GOTO | Order.FOLLOW:
                self._unheard.flies_on_board(command.agent)
                self._until[command.agent] = self.time + command.duration
        self.report_phases()

    def release(self, rows: Iterable[int]) -> None:
        """Fly agents by setpoints again, whatever their commanders fly."""
        self._commanded[list(rows)] = False

    def land(self, rows: Rows, estimate: Estimate, durations: Array | None = None) -> None:
        """Command agents to land from their positions, if they are in the air.

        Args:
            rows: (K,) the agents.
            estimate: Of their positions.
            durations: (K,) of the descents, s; NaN or None is at the core's own pace. No descent
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
        # a commander's plan begins where the previous one is, which a climbing agent trails
        rise = CONTROLLER_LAG * np.maximum(0.0, np.nan_to_num(estimate.velocity[rows, 2]))
        duration = (position[:, 2] + rise) / LAND_SPEED + LAG_ALLOWANCE
        if durations is not None:
            duration = np.where(np.isnan(durations[up]), duration, durations[up])
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
        """Return the ground truth, if there is one; after a failure it is not requested again."""
        if self._truth_failed:
            return None
        self._truth_failed = True
        truth = self._pipeline.truth()
        self._truth_failed = False
        return truth

    def report_phases(self) -> None:
        """Report the phases that have changed to the observers."""
        for agent, phase in self.phases.changes():
            self._observers.notify("star_phase_changed", time=self.time, agent=agent, phase=phase)
            if phase in {"lost", "emergency"}:
                self._observers.event("failure", f"{agent} is {phase}", agent)

    def _with_brakes(
        self, setpoint: Setpoint, telemetry: Telemetry, estimate: Estimate
    ) -> Setpoint:
        """Add a zero velocity for agents in flight that are heard but not located.

        It needs no position, and without setpoints such an agent would fly on for a while.
        """
        heading = telemetry.heading + estimate.map_from_odom.yaw
        brakes = self._setpoints_sent & self.phases.among(AgentPhase.LOST) & ~self._commanded
        brakes &= (telemetry.age <= MAX_REPORT_AGE) & np.isfinite(heading)
        self._setpoints_sent = setpoint.active | brakes
        if not brakes.any():
            return setpoint
        _, faster = self._motion.errors()
        rest = 0.0 - estimate.map_from_odom.turn(faster)  # flown so, they are at rest
        speed = np.linalg.norm(rest, axis=1, keepdims=True)
        rest *= self._scene.limits.speed / np.maximum(speed, self._scene.limits.speed)
        return Setpoint(
            velocity=np.where(brakes[:, None], rest, setpoint.velocity),
            yaw=np.where(brakes, heading, setpoint.yaw),
            active=self._setpoints_sent,
        )

    def _ground(self, rebooted: Mask) -> None:
        """Remove agents that rebooted from the flight, unless they have landed before."""
        unfit = rebooted & self.phases.among(AgentPhase.GROUNDED, *AIRBORNE)
        flew = self.phases.among(*AIRBORNE)
        for row in np.flatnonzero(unfit).tolist():
            name = self._scene.agents[row].name
            moment = "in flight: its motors stopped" if flew[row] else "before its take-off"
            text = f"{name} rebooted {moment}; it is not flown any more"
            self._observers.event("failure", text, name)
        self.phases.fire("fail", np.flatnonzero(unfit))

    def _with_known_frames(self, estimate: Estimate) -> Estimate:
        """Return the estimate with the last known frames of agents whose frames are not finite."""
        known = estimate.map_from_odom.known
        if known.all():
            self._frames = estimate.map_from_odom
            return estimate
        self._frames = estimate.map_from_odom.where(known, self._frames)
        return replace(estimate, map_from_odom=self._frames)

    def _gated(self, estimate: Estimate, telemetry: Telemetry) -> Estimate:
        """Return the estimate without implausible positions and motions, and report new ones."""
        airborne = self.phases.among(*AIRBORNE)
        heard = telemetry.age <= MAX_REPORT_AGE
        reported = np.where(heard[:, None], telemetry.velocity, np.nan)
        accepted, jumps = self._gate.check(estimate, airborne, reported, heard)
        for jump in jumps:
            name = self._scene.agents[jump.row].name
            moved = (
                f"moved {jump.distance:.2f} m in {jump.seconds:.2f} s, expected at most "
                f"{jump.plausible:.2f} m"
            )
            if np.isnan(jump.plausible):
                moved = f"did not change while it reported {jump.distance:.2f} m of flight,"
            self._observers.event(
                "estimate",
                f"{name} brakes: its estimated position {moved} from {self._pipeline.localizer}",
                name,
            )
        contradicted = self._motion.check(telemetry, airborne)
        for row in np.flatnonzero(contradicted & ~self._contradicted).tolist():
            name = self._scene.agents[row].name
            self._observers.event(
                "estimate",
                f"{name} brakes: it flies faster than it reports, by its tilt; "
                "does its flow sensor see the floor?",
                name,
            )
        self._contradicted = contradicted
        if not contradicted.any():
            return accepted
        away, faster = map(accepted.map_from_odom.turn, self._motion.errors())
        return replace(
            accepted,
            position=accepted.position + away,
            velocity=accepted.velocity + faster,
            valid=accepted.valid & ~contradicted,
        )
