"""The swarm in the map frame: telemetry, estimates and phases in, commands and setpoints out."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from star_core.messages.arrays import Mask, Rows, frozen, some
from star_core.messages.commands import Command, Order
from star_core.messages.state import AIRBORNE, AgentPhase, Estimate, Health, Setpoint
from star_core.messages.telemetry import Supervisor, Telemetry
from star_core.observers import Observers
from star_core.phases import Phases
from star_core.pipeline import PluginPipeline, renewed
from star_core.plugin_support.tick_timing import TickTiming
from star_core.safety.agents_in_the_way import FALL_TIME, MAX_REPORT_AGE, UnheardAgents
from star_core.safety.ground_evidence import ON_BOARD, GroundEvidence
from star_core.safety.monitors import Misreport
from star_core.targets import Targets
from star_core.world.scene import Scene

log = logging.getLogger(__name__)

UNSTEERED = (Order.GOTO, Order.FOLLOW)  # no setpoints are sent until these are over
COMMANDER_FINISHED = int(Supervisor.COMMANDER_FINISHED)
DESCENT_SPEED = 0.3  # m/s, of agents that setpoints bring down
TINY = 1e-9  # m/s
TOUCHDOWN_HEIGHT = 0.04  # m, as reported: then they are on the floor
SETTLED_SPEED = 0.1  # m/s, vertical, below which a climb has come to rest
MAX_SETTLING_TIME = 2.0  # s that it has for that


class VehicleInterface:
    """Telemetry, estimates and phases in; commands and setpoints out, in each agent's own frame.

    Attributes:
        time: Of the tick, s.
        estimate: Of the tick; None before the first.
        phases: Of every agent and of the mission.
        targets: That were found so far.
        climb_top: (N,) z at which each agent's last climb ends, m in the map.
        down_by: Time at which the last of all landings so far ends, s.
        ground: What shows that agents are on the ground.
        timing: Lateness of the ticks.
        unheard: Where agents may be that are not heard.
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
        self.climb_top = np.zeros(n)
        self.down_by = 0.0
        self.ground = GroundEvidence(n)
        self.timing = TickTiming(scene.period)
        self._localizer_failed = False
        self._until = np.zeros(n)  # s, earliest end of what a commander flies
        self._climbs = np.zeros(n)  # s, latest end of a climb
        self._setpoints_sent = np.zeros(n, np.bool_)  # in the last tick
        self._missing = self._no_velocity = frozen(np.zeros((n, 3)))  # m/s, true less reported
        self._drifts = self._none = frozen(np.zeros(n, np.bool_))
        self.unheard = UnheardAgents(n, scene.limits)
        self._heard = np.ones(n, np.bool_)
        self._height = np.full(n, np.nan)  # m, as reported
        self._descending = np.zeros(n, np.bool_)  # by setpoints

    def receive(self) -> Telemetry:
        """Wait for the next tick, and return what arrived since the last one.

        A tick that comes late because its process did not run is no silence of the agents: what
        they sent meanwhile may not be received yet, so the stall does not count in their ages.
        """
        self.wait()
        telemetry = self._pipeline.receive()
        if not self.timing.stall:
            return telemetry
        return replace(telemetry, age=np.maximum(0.0, telemetry.age - self.timing.stall))

    def wait(self) -> None:
        """Wait for the next tick."""
        due = self._due * self._scene.period
        self.time = self._pipeline.wait(due)
        self._observers.begin_tick(self.time)
        in_flight = some(self.phases.among(*AIRBORNE))
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
            estimate = self._pipeline.locate(telemetry)
            self._missing, self._drifts = self._no_velocity, self._none
            if len(estimate.corrections.agent):
                self._pipeline.correct(estimate.corrections)
            for text in estimate.messages:
                self._observers.event("estimate", text)
        self._heard = telemetry.age <= MAX_REPORT_AGE
        self._height = telemetry.position[:, 2]
        return estimate

    def track(self, telemetry: Telemetry, estimate: Estimate) -> Health:
        """Update the phases of the agents and the targets they found; return their health."""
        self.estimate = estimate
        self.ground.observe(self.time, telemetry)
        finished = telemetry.state & COMMANDER_FINISHED != 0
        settled = self._settled(finished, estimate)
        self.phases.observe(telemetry.state, self._heard, estimate.valid, settled)
        if telemetry.rebooted is not None and telemetry.rebooted.any():
            self._ground(telemetry.rebooted)
        finished &= self.time >= self._until  # earlier it refers to the previous command
        self._commanded &= ~finished
        if len(estimate.sightings.tag):
            for target, finder in self.targets.add(estimate.sightings, self.time):
                self._observers.event("found", f"{finder} found {target!r}", finder)
        health = Health.made(
            self.phases.of_agents(), telemetry.battery, telemetry.age, self.targets.finder
        )
        self.report_phases()
        return health

    def misreport(self, finding: Misreport) -> None:
        """Note what agents do not report in this tick; that of several monitors adds up."""
        self._missing = self._missing + finding.missing
        self._drifts = self._drifts | finding.drifts

    def stop_locating(self) -> None:
        """Stop calling the localizer, which has failed: from now on no agent is located."""
        self._localizer_failed = True

    def setpoint(self, planned: Setpoint, estimate: Estimate) -> Setpoint:
        """Return a planned setpoint for the agents that setpoints fly.

        Rows that the planner leaves inactive get zero velocity; without a setpoint the drone would
        fall.
        """
        active = self.steered(estimate)
        velocity = np.where(planned.active[:, None], planned.velocity, 0.0)
        yaw = np.where(planned.active, planned.yaw, estimate.yaw)
        bare = Setpoint.made(velocity, yaw, active)
        return bare.following(planned, planned.followed() & active)

    def steered(self, estimate: Estimate) -> Mask:
        """Return which agents setpoints fly: (N,)."""
        return self.phases.among(AgentPhase.FLYING) & estimate.valid & ~self._commanded

    def send(self, setpoint: Setpoint, telemetry: Telemetry, estimate: Estimate) -> Setpoint:
        """Send a setpoint, with zero velocity for agents that must brake; return what was sent."""
        setpoint = self._with_brakes(setpoint, telemetry, estimate)
        to_map = estimate.map_from_odom
        odom = Setpoint.made(
            to_map.turn_back(setpoint.velocity), setpoint.yaw - to_map.yaw, setpoint.active
        )
        if estimate.heights is not None:  # climb by what the agent takes for its climb
            velocity = odom.velocity.copy()
            error = telemetry.velocity[:, 2] - estimate.heights[:, 1]
            velocity[:, 2] += np.where(estimate.valid & np.isfinite(error), error, 0.0)
            odom = replace(odom, velocity=frozen(velocity))
        if setpoint.position is not None and setpoint.acceleration is not None:
            odom = replace(
                odom,
                position=to_map.inverse().apply(setpoint.position),
                acceleration=to_map.turn_back(setpoint.acceleration),
                yaw_rate=setpoint.yaw_rate,
            )
        sent = self._pipeline.send(odom, to_map)
        self.unheard.steered(self.time, setpoint.active)
        self.unheard.descend(self._descending)
        self.ground.steered(self.time, setpoint.active)
        if sent is odom:
            return setpoint
        velocity, yaw = to_map.turn(sent.velocity), sent.yaw + to_map.yaw
        return Setpoint(velocity, yaw, sent.active).following(setpoint, sent.followed())

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
        until = self.time + command.duration
        self.ground.commanded(self.time, command.order, command.agent, until)
        if command.order is not Order.ARM:
            self._commanded[command.agent] = command.order in UNSTEERED
        heard = self._heard[command.agent]
        if command.order in ON_BOARD:
            self.unheard.flies_on_board(command.agent, command.end(), until)
        match command.order:
            case Order.TAKEOFF:
                self.climb_top[command.agent] = command.position[:, 2]
                self.phases.fire("take_off", command.agent)
            case Order.LAND:
                self.unheard.lands(command.agent, self.time + command.duration, heard)
                lands = self.phases.of_agents()[command.agent] == AgentPhase.LANDING
                self.phases.fire("land", command.agent[~lands])
                self.down_by = max(self.down_by, self.time + float(command.duration.max(initial=0)))
            case Order.STOP:
                fallen = np.full(len(heard), self.time + FALL_TIME)
                self.unheard.lands(command.agent, fallen, heard)
                self.phases.fire("fail", command.agent, "its motors were stopped")
            case Order.GOTO | Order.FOLLOW:
                self._until[command.agent] = self.time + command.duration
        self.report_phases()

    def drifts(self) -> Mask:
        """Return which agents would drift in a landing, and can be brought down by setpoints: (N,).

        By a `Misreport` they would hold, on board, a velocity that is not zero.
        """
        steerable = self._setpoints_sent & self._heard & self.phases.among(AgentPhase.LOST)
        drifts: Mask = steerable & self._drifts & (self._height > TOUCHDOWN_HEIGHT)
        return drifts

    def descend(self, rows: Iterable[int]) -> None:
        """Let agents that `drifts` descend by setpoints in this tick, and no others."""
        self._descending[:] = False
        self._descending[list(rows)] = True

    def release(self, rows: Iterable[int]) -> None:
        """Fly agents by setpoints again, whatever their commanders fly."""
        self._commanded[list(rows)] = False

    def emergency_stop(self, agents: Mask) -> None:
        """Stop the motors of some agents at once, for the operator."""
        rows = np.flatnonzero(agents)
        text = f"the operator stops the motors of {self._scene.named(rows)}"
        names = [self._scene.agents[row].name for row in rows]
        self._observers.event("interrupt", text, details={"agents": names})
        self.stop_motors(rows)

    def stop_motors(self, rows: Rows) -> None:
        """Send the command that stops motors."""
        zero = np.zeros(len(rows))
        if self.estimate is not None:
            command = Command(Order.STOP, rows, np.zeros((len(rows), 3)), zero, zero)
            self.send_command(command, self.estimate)

    def report_phases(self) -> None:
        """Report the phases that have changed to the observers."""
        for agent, phase in self.phases.changes():
            self._observers.notify("star_phase_changed", time=self.time, agent=agent, phase=phase)
            if phase in {"lost", "emergency"}:
                state = self.phases.describe(self._scene.names.index(agent))
                self._observers.event("failure", f"{agent} is {state}", agent)

    def _settled(self, finished: Mask, estimate: Estimate) -> Mask:
        """Return which agents have come to rest vertically since their commanders finished: (N,).

        A drone trails the climb of its commander. Position control must end it: its integral is
        the thrust for hovering, without which setpoints of velocity would let the drone sink.
        """
        self._climbs = np.where(finished, self._climbs, self.time + MAX_SETTLING_TIME)
        slow = ~(np.abs(estimate.velocity[:, 2]) > SETTLED_SPEED)
        return slow | (self.time >= self._climbs)

    def _with_brakes(
        self, setpoint: Setpoint, telemetry: Telemetry, estimate: Estimate
    ) -> Setpoint:
        """Add a zero velocity for agents in flight that are heard but not located.

        It needs no position, and without setpoints such an agent would fly on for a while.
        """
        brakes = self._setpoints_sent & self.phases.among(AgentPhase.LOST) & ~self._commanded
        if not some(brakes):
            self._setpoints_sent = setpoint.active
            return setpoint
        heading = telemetry.heading + estimate.map_from_odom.yaw
        brakes &= (telemetry.age <= MAX_REPORT_AGE) & np.isfinite(heading)
        self._setpoints_sent = setpoint.active | brakes
        if not some(brakes):
            return setpoint
        rest = 0.0 - estimate.map_from_odom.turn(self._missing)  # m/s, at which agents are at rest
        limit = self._scene.limits.speed
        rest[self._descending, 2] = -min(DESCENT_SPEED, limit)
        level = np.sqrt(limit**2 - rest[:, 2:] ** 2)  # m/s, that the descent leaves
        speed = np.linalg.norm(rest[:, :2], axis=1, keepdims=True)
        rest[:, :2] *= level / np.maximum(speed, np.maximum(level, TINY))
        return Setpoint(
            velocity=np.where(brakes[:, None], rest, setpoint.velocity),
            yaw=np.where(brakes, heading, setpoint.yaw),
            active=self._setpoints_sent,
        ).following(setpoint, setpoint.followed() & ~brakes)

    def _ground(self, rebooted: Mask) -> None:
        """Remove agents that rebooted from the flight, unless they have landed before."""
        unfit = rebooted & self.phases.among(AgentPhase.GROUNDED, *AIRBORNE)
        flew = self.phases.among(*AIRBORNE)
        for row in np.flatnonzero(unfit).tolist():
            name = self._scene.agents[row].name
            moment = "in flight: its motors stopped" if flew[row] else "before its take-off"
            text = f"{name} rebooted {moment}; it is not flown any more"
            self._observers.event("failure", text, name)
        self.phases.fire("fail", np.flatnonzero(unfit), "rebooted")
