"""The four parts a mission flies with, made and blamed by name."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any

from star_core.blame import Blame, close
from star_core.conformance import (
    checked_estimate,
    checked_plan,
    checked_setpoint,
    checked_telemetry,
    expect,
    keeps,
)
from star_core.contracts import Avoider, Localizer, Planner, Transport
from star_core.document import PARTS
from star_core.errors import ContractError, PluginError
from star_core.mission import Mission
from star_core.orders import Command, Trajectory
from star_core.registry import Registry
from star_core.sight import Corrections
from star_core.swarm import Estimate, Goals, Plan, Setpoint, Truth
from star_core.telemetry import Telemetry

EARLY = 1e-3  # s, by which a time may be off: clocks of computers have grains

CONTRACTS = {
    "transport": Transport,
    "localizer": Localizer,
    "planner": Planner,
    "avoider": Avoider,
}


class Crew:
    """Calls the parts, holds every answer to its contract, and names the plugin that breaks it.

    Every method may raise `PluginError`.

    Args:
        mission: Names the parts.
        registry: Where they are found.

    Attributes:
        took: How long was computed in all, s, by the kind of part, and for ``safety``; of the
            transport nothing, which waits.
        trajectories: What the agents are to fly on board; to be set before `connect`.
    """

    def __init__(self, mission: Mission, registry: Registry) -> None:
        self._n = len(mission.scene.agents)
        self._blame = {kind: Blame(str(mission.parts[kind])) for kind in PARTS}
        self._parts: dict[str, Any] = {}
        self.trajectories: tuple[Trajectory, ...] = ()
        self.took = dict.fromkeys(("localizer", "planner", "avoider", "safety"), 0.0)
        try:
            for kind in PARTS:
                part = mission.parts[kind]
                with self._blame[kind]:
                    made = registry.find(kind, part.use).offer.make(mission.scene, **part.options)
                    self._parts[kind] = made
                    keeps(made, CONTRACTS[kind])
        except BaseException:
            self.close()
            raise

    def connect(self) -> None:
        """Open the links, and upload the trajectories."""
        transport = self._parts["transport"]
        with self._blame["transport"]:
            if self.trajectories and not hasattr(transport, "upload"):
                raise PluginError("flies no trajectories on board")
            transport.connect()
            if self.trajectories:
                transport.upload(self.trajectories)

    def wait(self, until: float) -> float:
        """Let time pass until `until`, s, and return the mission time it is then, s."""
        with self._blame["transport"]:
            now = float(self._parts["transport"].wait(until))
            if not until - EARLY <= now < math.inf:
                raise ContractError(
                    f"wait({until!r}) returned {now!r}, expected that time or later"
                )
            return now

    def receive(self) -> Telemetry:
        """Return what arrived since the last call."""
        with self._blame["transport"]:
            return checked_telemetry(self._parts["transport"].receive(), self._n)

    def locate(self, telemetry: Telemetry) -> Estimate:
        """Estimate where the agents are."""
        with self.timed("localizer"), self._blame["localizer"]:
            estimate = checked_estimate(self._parts["localizer"].locate(telemetry), self._n)
            if not abs(estimate.time - telemetry.time) <= EARLY:
                raise ContractError(
                    f"Estimate.time is {estimate.time!r}, expected the telemetry's, "
                    f"{telemetry.time!r}"
                )
            return estimate

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        """Plan the next setpoint."""
        with self.timed("planner"), self._blame["planner"]:
            return checked_plan(self._parts["planner"].plan(estimate, goals), self._n)

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        """Make a setpoint safe."""
        with self.timed("avoider"), self._blame["avoider"]:
            return checked_setpoint(self._parts["avoider"].avoid(estimate, wanted), self._n)

    def command(self, command: Command) -> None:
        """Give an order, already in odometry frames."""
        with self._blame["transport"]:
            self._parts["transport"].command(command)

    def correct(self, corrections: Corrections) -> None:
        """Tell on-board estimators where their agents are."""
        with self._blame["transport"]:
            self._parts["transport"].correct(corrections)

    def send(self, setpoint: Setpoint) -> Setpoint:
        """Send a setpoint, already in odometry frames, and return what was sent."""
        with self._blame["transport"]:
            return checked_setpoint(self._parts["transport"].send(setpoint), self._n)

    def truth(self) -> Truth | None:
        """Where the agents really are, if the transport can know."""
        with self._blame["transport"]:
            truth = self._parts["transport"].truth()
            if truth is not None and len(expect(truth, Truth).position) != self._n:
                raise ContractError(
                    f"Truth.position has {len(truth.position)} rows, expected {self._n}"
                )
            return truth  # type: ignore[no-any-return]

    @contextmanager
    def timed(self, kind: str) -> Iterator[None]:
        """Add the time that something takes to what its kind took."""
        begun = perf_counter()
        yield
        self.took[kind] += perf_counter() - begun

    def close(self) -> list[str]:
        """Close every part that can be closed; return what went wrong."""
        return close((self._blame[kind], part) for kind, part in self._parts.items())
