"""Sees and steers the swarm in the map: reports in, orders and setpoints out, phases kept."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from star_core.crew import Crew
from star_core.frames import Lying, Transform
from star_core.lateness import Lateness
from star_core.observers import Observers
from star_core.orders import Command, Order
from star_core.phases import Phases
from star_core.scene import Scene
from star_core.sight import Corrections, Sightings
from star_core.swarm import AgentPhase, Estimate, Health, Setpoint, Truth
from star_core.table import Array, Mask, Rows
from star_core.targets import Targets
from star_core.telemetry import Supervisor, Telemetry

STALE_AFTER = 0.5  # s, an agent not heard for longer is lost: the firmware's commander time-out
ON_ITS_OWN = (Order.GOTO, Order.FOLLOW)  # an agent is not steered until these are over
LAND_SPEED = 0.3  # m/s, when the core itself lands
LAND_SHORTEST = 1.0  # s, the quickest landing the core asks for


class Helm:
    """The swarm as it is flown.

    Args:
        scene: The agents.
        crew: The four parts; their transport is connected.
        observers: Told of phases.

    Attributes:
        time: Of the tick, s.
        estimate: Of the tick; None before the first.
        phases: Of every agent and of the mission.
        commanded: (N,) who flies to a place or along a trajectory on its own, on board.
        targets: What was found so far.
        down_by: When the last of all landings so far is over, s.
        lateness: How late ticks came.
        without_localizer: To be set where that is broken: nobody is located any more.
    """

    def __init__(self, scene: Scene, crew: Crew, observers: Observers) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._crew = crew
        self._observers = observers
        self._due = 0  # number of the next tick
        self.time = 0.0
        self.estimate: Estimate | None = None
        self.phases = Phases(scene.names)
        self.commanded = np.zeros(n, np.bool_)
        self.targets = Targets(scene)
        self.down_by = 0.0
        self.lateness = Lateness(scene.period, crew.took)
        self.without_localizer = False
        self._until = np.zeros(n)  # s, until when who is commanded is at least
        self._blind = False  # the truth cannot be had
        self._lying = Lying(
            Transform(
                np.array([agent.yaw for agent in scene.agents]),
                np.array([agent.start for agent in scene.agents]),
            )
        )

    def look(self) -> tuple[Telemetry, Estimate, Health]:
        """Wait for the tick that is due, and see how things are."""
        due = self._due * self._scene.period
        self.time = self._observers.time = self._crew.wait(due)
        if late := self.lateness.note(due, self.time):
            self._observers.event("late", late)
        self._due = max(self._due, int(self.time / self._scene.period + 1e-6)) + 1
        telemetry = self._crew.receive()
        if self.without_localizer and self.estimate is not None:
            nobody = np.zeros(len(self.commanded), np.bool_)
            estimate = replace(
                self.estimate,
                time=telemetry.time,
                valid=nobody,
                corrections=Corrections.none(),
                sightings=Sightings.none(),
            )
        else:
            estimate = self._crew.locate(telemetry)
            lies = self._lying.last_known(estimate.map_from_odom)
            if lies is not estimate.map_from_odom:
                estimate = replace(estimate, map_from_odom=lies)
            if len(estimate.corrections.agent):
                self._crew.correct(estimate.corrections)
        self.estimate = estimate
        heard = telemetry.age <= STALE_AFTER
        self.phases.observe(telemetry.state, heard, estimate.valid)
        finished = telemetry.state & int(Supervisor.COMMANDER_FINISHED) != 0
        finished &= self.time >= self._until  # earlier it is the order before that is over
        self.commanded &= ~finished
        for target, finder in self.targets.see(estimate.sightings, self.time):
            self._observers.event("found", f"{finder} found {target!r}", finder)
        health = Health(
            self.phases.of_agents(), telemetry.battery, telemetry.age, self.targets.finder
        )
        self.tell_phases()
        return telemetry, estimate, health

    def send(self, setpoint: Setpoint, estimate: Estimate) -> Setpoint:
        """Send a setpoint; return what was sent."""
        to_map = estimate.map_from_odom
        odom = replace(
            setpoint,
            velocity=to_map.turn_back(setpoint.velocity),
            yaw=setpoint.yaw - to_map.yaw,
        )
        sent = self._crew.send(odom)
        if sent is odom:
            return setpoint
        return replace(sent, velocity=to_map.turn(sent.velocity), yaw=sent.yaw + to_map.yaw)

    def order(self, command: Command, estimate: Estimate) -> None:
        """Give an order, and follow it in the agents' phases."""
        to_odom = estimate.map_from_odom.of(command.agent).inverse()
        self._crew.command(
            replace(
                command,
                position=to_odom.apply(command.position),
                yaw=command.yaw + to_odom.yaw,
            )
        )
        if command.order is not Order.ARM:
            self.commanded[command.agent] = command.order in ON_ITS_OWN
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
        self.tell_phases()

    def release(self, rows: Iterable[int]) -> None:
        """Steer agents again, whatever they fly on their own."""
        for row in rows:
            self.commanded[row] = False

    def land(self, rows: Rows, estimate: Estimate, takes: Array | None = None) -> None:
        """Order those of some agents down that are in the air, from where they are.

        Args:
            rows: (K,) who is meant.
            estimate: Where they are.
            takes: (K,) how long, s; NaN, or nothing given, is at the core's own pace.
        """
        airborne = self.phases.among(AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LOST)
        up = airborne[rows]
        rows = rows[up]
        if not len(rows):
            return
        position = estimate.position[rows].copy()
        unknown = ~np.isfinite(position[:, 2])
        position[unknown, 2] = self._scene.limits.height[1]
        position = np.nan_to_num(position)
        duration = np.maximum(LAND_SHORTEST, position[:, 2] / LAND_SPEED)
        if takes is not None:
            duration = np.where(np.isnan(takes[up]), duration, takes[up])
        position[:, 2] = 0.0
        yaw = np.nan_to_num(estimate.yaw[rows])
        self.order(Command(Order.LAND, rows, position, yaw, duration), estimate)

    def stop(self, who: Mask) -> None:
        """Switch motors off, at once."""
        rows = np.flatnonzero(who)
        self._observers.event(
            "interrupt", f"the operator stops the motors of {self._scene.named(rows)}"
        )
        self.cut(rows)

    def cut(self, rows: Rows) -> None:
        """Order that motors stop."""
        zero = np.zeros(len(rows))
        if self.estimate is not None:
            command = Command(Order.STOP, rows, np.zeros((len(rows), 3)), zero, zero)
            self.order(command, self.estimate)

    def truth(self) -> Truth | None:
        """Where the agents really are; a transport that failed to tell is not asked again."""
        if self._blind:
            return None
        self._blind = True
        truth = self._crew.truth()
        self._blind = False
        return truth

    def tell_phases(self) -> None:
        """Tell the observers what phases have changed."""
        for agent, phase in self.phases.changes():
            self._observers.tell("star_phase_changed", time=self.time, agent=agent, phase=phase)
            if phase in {"lost", "emergency"}:
                self._observers.event("failure", f"{agent} is {phase}", agent)
