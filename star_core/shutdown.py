"""Lands all agents at the end of a flight, whatever failed."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core.errors import PluginError
from star_core.messages.arrays import Mask, Rows
from star_core.messages.state import AIRBORNE, AgentPhase, Estimate, Goals
from star_core.observers import Observers
from star_core.operator import Operator
from star_core.scene import Scene
from star_core.tick import ControlLoop

MAX_LANDING_DELAY: Final = 10.0  # s after the planned end of its landing; then it has failed
REPORT_WAIT_AFTER: Final = 3.0  # s after that end; most drones report sooner
MAX_SILENCE: Final = 3.0  # s; an agent not heard for longer is not waited for after its landing


class Shutdown:
    """Lands the agents that are in the air.

    Args:
        scene: The agents.
        loop: The control loop that has flown them.
        observers: Receive the events.
        operator: Requests to stop the motors.
    """

    def __init__(
        self, scene: Scene, loop: ControlLoop, observers: Observers, operator: Operator
    ) -> None:
        self._scene = scene
        self._loop = loop
        self._vehicles = loop.vehicles
        self._observers = observers
        self._operator = operator

    def land_all(self, end: str, *, at_once: bool = False) -> str:
        """Land all agents; return what failed, if anything.

        Args:
            end: The trigger of the mission's phase with which the flight ends.
            at_once: Land each agent from its position, without leading it to a free one first,
                which takes every plugin.
        """
        vehicles, n = self._vehicles, len(self._scene.agents)
        if end == "complete":
            vehicles.phases.fire_mission("land")
        estimate = vehicles.estimate
        if estimate is None:
            return ""
        begun = vehicles.time
        self._command_landings(np.arange(n), estimate, at_once=at_once)
        age = np.zeros(n)  # s, of each agent's newest report
        waits = False  # for a report after the planned end of all landings
        while (up := self._unreported()).any():
            if self._operator.stops > 1:
                vehicles.emergency_stop(up)
                return "stopped, motors off"
            commanded = max(begun, vehicles.down_by, self._loop.landing.until)
            delay = 0.0 if (age[up] > MAX_SILENCE).all() else MAX_LANDING_DELAY
            assumed = vehicles.ground.assumed_down(vehicles.time)
            if vehicles.time >= commanded + delay or assumed[up].all():
                return self._report_unreported(up) or self._fallen(end)
            if vehicles.time >= commanded + REPORT_WAIT_AFTER and not waits:
                waits = True
                self._report("landing", "waiting for {} to report a landing", up)
            telemetry = vehicles.receive()
            age = telemetry.age
            estimate = vehicles.locate(telemetry)
            health = vehicles.track(telemetry, estimate)
            lost = np.flatnonzero(vehicles.phases.among(AgentPhase.LOST))
            goals = self._command_landings(lost, estimate, at_once=at_once)
            self._loop.landing.repeat_missed(telemetry, estimate)
            if goals.active.any():
                self._loop.steer(telemetry, estimate, health, goals, ["landing"])
            else:
                self._loop.watch(telemetry, estimate, health)
        return self._fallen(end)

    def land_all_without_plugins(self) -> str:
        """Land all agents though a plugin has failed; return what failed, if anything."""
        try:
            return self.land_all("fail", at_once=True)
        except PluginError:
            self._vehicles.stop_locating()  # it may be the localizer that raised
        try:
            return self.land_all("fail", at_once=True)
        except PluginError as error:
            if reason := self._wait_unheard():
                return reason
            for row in np.flatnonzero(self._vehicles.phases.among(*AIRBORNE)).tolist():
                name = self._scene.agents[row].name
                text = f"{name} is left to the transport's close, and its own timeouts"
                self._observers.event("failure", text, name)
            text = f"no agent could be landed: {error}"
            self._observers.event("failure", text)
            return text

    def _wait_unheard(self) -> str:
        """Wait for the end of all landings without telemetry; return what failed.

        Returns:
            Empty if not all agents were commanded to land, or time does not advance.
        """
        vehicles = self._vehicles
        up = vehicles.phases.among(*AIRBORNE)
        try:
            while vehicles.time < vehicles.down_by:
                vehicles.wait()
        except PluginError:
            return ""
        if (up != vehicles.phases.among(AgentPhase.LANDING)).any():
            return ""
        return self._report_unreported(up)

    def _unreported(self) -> Mask:
        """Return which agents have flown and do not report to be on the ground: (N,)."""
        vehicles = self._vehicles
        stops = vehicles.phases.among(AgentPhase.EMERGENCY)
        stops &= vehicles.ground.stop_unconfirmed(vehicles.time)
        unreported: Mask = vehicles.phases.among(*AIRBORNE) | stops
        return unreported

    def _report_unreported(self, up: Mask) -> str:
        """Report agents that do not report to be on the ground: (N,).

        Returns:
            The reason for which the mission fails; empty if all of these have left the mission, and
            are known to be on the ground although they do not report it.
        """
        ground, time = self._vehicles.ground, self._vehicles.time
        aloft = up & ~ground.down(time)
        names = self._scene.names
        for row in np.flatnonzero(aloft).tolist():
            text = f"{names[row]} may be in the air: {ground.describe(row, time)}"
            self._observers.event("airborne", text, names[row])
        for row in np.flatnonzero(up & ground.assumed_down(time)).tolist():
            text = f"{names[row]} counts as landed: {ground.describe(row, time)}"
            self._observers.event("landing", text, names[row])
        fails = aloft | (up & ~self._loop.unassigned())
        if not fails.any():
            return ""
        return self._report("failure", "{} did not report to be on the ground", fails)

    def _report(self, kind: str, text: str, agents: Mask) -> str:
        """Report an event about some agents, all of which the record names; return its text."""
        rows = np.flatnonzero(agents).tolist()
        text = text.format(self._scene.named(rows))
        names = [self._scene.agents[row].name for row in rows]
        self._observers.event(kind, text, details={"agents": names})
        return text

    def _fallen(self, end: str) -> str:
        """Return which agents of a completed mission ended in emergency, if any."""
        fallen = self._vehicles.phases.among(AgentPhase.EMERGENCY) & ~self._loop.unassigned()
        if end != "complete" or not fallen.any():
            return ""
        return f"{self._scene.named(np.flatnonzero(fallen).tolist())} ended in emergency"

    def _command_landings(self, rows: Rows, estimate: Estimate, *, at_once: bool) -> Goals:
        """Command landings now, or once each agent is at rest above a free position.

        Returns:
            The goals of the agents that have yet to come to rest there.
        """
        no_goals = Goals.none(len(self._scene.agents))
        if at_once:
            self._loop.landing.land_now(rows, estimate)
            return no_goals
        self._loop.landing.land(rows)
        return self._loop.landing.step(estimate, no_goals)
