"""One tick from goals to setpoints: planned, made safe, limited, sent, measured and shown."""

from __future__ import annotations

import numpy as np

from star_core.crew import Crew
from star_core.flight import Corrected, Tick
from star_core.helm import Helm
from star_core.observers import Observers
from star_core.safety import SafetyFilter
from star_core.scene import Scene
from star_core.summary import Meter
from star_core.swarm import AgentPhase, Estimate, Goals, Health, Paths, Plan, Setpoint
from star_core.table import Mask
from star_core.telemetry import Telemetry

CALM = 1.0  # s without a correction, after which the next one is told again

CORRECTED = {
    "fence": "is held inside the fence",
    "speed": "is slowed to the speed limit",
    "separation": "brakes for another agent",
}
"""What the record says of the agents that `star_core.safety` corrects, by the reason."""


class Steering:
    """Leads the swarm to its goals, a tick at a time.

    Args:
        scene: The agents.
        crew: The four parts.
        helm: What setpoints are sent through.
        observers: Shown every tick.

    Attributes:
        meter: Has measured every tick.
    """

    def __init__(self, scene: Scene, crew: Crew, helm: Helm, observers: Observers) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._crew = crew
        self._helm = helm
        self._observers = observers
        self._safety = SafetyFilter(scene)
        self._corrected = {why: np.full(n, -np.inf) for why in CORRECTED}  # s, when last
        self.meter = Meter(scene)

    def steer(
        self, telemetry: Telemetry, estimate: Estimate, health: Health, goals: Goals, doing: str
    ) -> tuple[Plan, Mask]:
        """Plan, avoid, limit and send; return the plan, and (N,) who is steered."""
        plan = self._crew.plan(estimate, goals)
        flying = self._helm.phases.among(AgentPhase.FLYING)
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
        now, truth = self._helm.time, self._helm.truth()
        made = telemetry, estimate, health, goals, plan, sent
        self._record(Tick(now, *made, truth, doing, corrected))
        return plan, active

    def watch(self, telemetry: Telemetry, estimate: Estimate, health: Health) -> None:
        """Record a tick in which nothing is sent."""
        n = len(self._scene.agents)
        nobody = np.zeros(n, np.bool_)
        still = Setpoint(np.zeros((n, 3)), np.zeros(n), nobody)
        nowhere = Paths(np.zeros(0, np.int64), np.zeros((0, 3)))
        plan = Plan(still, nowhere, nobody)
        unchanged = Corrected(nobody, nobody, nobody)
        made = telemetry, estimate, health, Goals.none(n), plan, still
        self._record(Tick(self._helm.time, *made, self._helm.truth(), "landing", unchanged))

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
                self._observers.event("corrected", f"{name} {text}", name)

    def _record(self, tick: Tick) -> None:
        """Measure a tick and show it to the observers."""
        self.meter.add(tick)
        self._observers.tell("star_ticked", tick=tick)
