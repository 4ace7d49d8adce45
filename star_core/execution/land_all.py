"""The last step of every flight: all agents land, whatever failed before."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core.errors import PluginError
from star_core.execution.assignments import Assignments
from star_core.execution.instructions import GoalDraft, Instructions
from star_core.execution.landing import LandingManager
from star_core.messages.arrays import Mask
from star_core.messages.state import AIRBORNE, AgentPhase, Estimate, Goals
from star_core.messages.telemetry import Telemetry
from star_core.observers import Observers
from star_core.operator import Operator
from star_core.vehicle_interface import VehicleInterface
from star_core.world.scene import Scene

MAX_LANDING_DELAY: Final = 10.0  # s after the planned end of its landing; then it has failed
REPORT_WAIT_AFTER: Final = 3.0  # s after that end; most drones report sooner
MAX_SILENCE: Final = 3.0  # s; an agent not heard for longer is not waited for after its landing


class LandAll:
    """Lands the agents that are in the air, and waits until they report to be on the ground.

    Args:
        complete: Whether the mission's steps are done.
        at_once: Land each agent from its position, without leading it to a free one first, which
            takes every plugin.
    """

    def __init__(
        self,
        scene: Scene,
        vehicles: VehicleInterface,
        landing: LandingManager,
        assignments: Assignments,
        observers: Observers,
        operator: Operator,
        *,
        complete: bool,
        at_once: bool,
    ) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._vehicles = vehicles
        self._landing = landing
        self._assignments = assignments
        self._observers = observers
        self._operator = operator
        self._complete = complete
        self._at_once = at_once
        self._begun = vehicles.time  # s
        self._age = np.zeros(n)  # s, of each agent's newest report
        self._waits = False  # for a report after the planned end of all landings
        self._no_goals = Goals.none(n)

    def begin(self) -> None:
        """Command all landings that are possible."""
        if self._complete:
            self._vehicles.phases.fire_mission("land")
        estimate = self._vehicles.estimate
        if estimate is None:  # before the first tick
            return
        n = len(self._scene.agents)
        instructions = self._land(np.ones(n, np.bool_), estimate)
        self._landing.land(sorted(instructions.leave))
        self._landing.step(estimate, instructions.goals)

    def step(self, telemetry: Telemetry, estimate: Estimate) -> Instructions:
        """Return what to do in a tick: agents land that are lost or were not located before."""
        self._age = telemetry.age
        return self._land(self._vehicles.phases.among(AgentPhase.LOST), estimate)

    def result(self) -> str | None:
        """Return what failed; empty if nothing did, None while there is an agent to wait for."""
        vehicles = self._vehicles
        up = self._unreported()
        if not up.any():
            return self._fallen()
        if self._operator.stops > 1:
            vehicles.emergency_stop(up)
            return "stopped, motors off"
        commanded = max(self._begun, vehicles.down_by, self._landing.until)
        delay = 0.0 if (self._age[up] > MAX_SILENCE).all() else MAX_LANDING_DELAY
        assumed = vehicles.ground.assumed_down(vehicles.time)
        if vehicles.time >= commanded + delay or assumed[up].all():
            return self._report_unreported(up) or self._fallen()
        if vehicles.time >= commanded + REPORT_WAIT_AFTER and not self._waits:
            self._waits = True
            self._report("landing", "waiting for {} to report a landing", up)
        return None

    def give_up(self, error: PluginError) -> str:
        """Return what failed if landings cannot be commanded, or telemetry not be received."""
        if reason := self._wait_unheard():
            return reason
        for row in np.flatnonzero(self._vehicles.phases.among(*AIRBORNE)).tolist():
            name = self._scene.agents[row].name
            text = f"{name} is left to the transport's close, and its own timeouts"
            self._observers.event("failure", text, name)
        text = f"no agent could be landed: {error}"
        self._observers.event("failure", text)
        return text

    def _land(self, rows: Mask, estimate: Estimate) -> Instructions:
        """Land agents, (N,), now, or once each of them is at rest above a free position."""
        agents = np.flatnonzero(rows)
        if self._at_once:
            self._landing.land_now(agents, estimate)
            agents = agents[:0]
        goals = GoalDraft(self._no_goals)
        return Instructions(goals, doing=["landing"], leave={*agents.tolist()})

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
        stops = vehicles.ground.stop_unconfirmed(vehicles.time)
        stops &= vehicles.phases.among(AgentPhase.EMERGENCY)
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
        fails = aloft | (up & ~self._assignments.unassigned)
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

    def _fallen(self) -> str:
        """Return which agents of a completed mission ended in emergency, if any."""
        fallen = self._vehicles.phases.among(AgentPhase.EMERGENCY) & ~self._assignments.unassigned
        if not self._complete or not fallen.any():
            return ""
        return f"{self._scene.named(np.flatnonzero(fallen).tolist())} ended in emergency"
