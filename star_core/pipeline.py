"""The four parts a mission flies with, made and blamed by name."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter
from typing import Any

import numpy as np

from star_core.contracts import Avoider, Localizer, Planner, Transport
from star_core.errors import ContractError, PluginError
from star_core.messages.arrays import Array, Mask
from star_core.messages.commands import Command, Trajectory
from star_core.messages.state import Estimate, Goals, Plan, Setpoint, Truth
from star_core.messages.telemetry import Telemetry
from star_core.messages.validation import (
    accepts,
    checked_estimate,
    checked_plan,
    checked_setpoint,
    checked_telemetry,
    expect_rows,
    require_methods,
    require_type,
)
from star_core.messages.vision import Corrections
from star_core.metrics.compute_time import ComputeTime
from star_core.mission import Mission
from star_core.mission_file.located_document import PARTS
from star_core.plugin_guard import PluginGuard, close
from star_core.plugin_schema import fill_defaults
from star_core.registry import Registry

EARLY = 1e-3  # s, by which a time may be off: clocks of computers have grains

CONTRACTS = {
    "transport": Transport,
    "localizer": Localizer,
    "planner": Planner,
    "avoider": Avoider,
}


class PluginPipeline:
    """Calls the parts, holds every answer to its contract, and names the plugin that breaks it.

    Every method may raise `PluginError`.

    Args:
        mission: Names the parts.
        registry: Where they are found.

    Attributes:
        took: How long was computed in all, s, by the kind of part, and for ``safety``; of the
            transport nothing, which waits.
        compute_time: Of every plugin of the flight.
    """

    def __init__(self, mission: Mission, registry: Registry) -> None:
        self._n = len(mission.scene.agents)
        self._blame = {kind: PluginGuard(str(mission.parts[kind]), self._n) for kind in PARTS}
        self._scene = mission.scene
        specs = {kind: registry.find(kind, mission.parts[kind].use).offer for kind in PARTS}
        options = {
            kind: fill_defaults(mission.parts[kind].options, spec.options)
            for kind, spec in specs.items()
        }
        self._check_goals = specs["planner"].check_goals
        self._planner_options = options["planner"]
        self._parts: dict[str, Any] = {}
        self.compute_time = ComputeTime(mission.scene.period, realtime=mission.scene.realtime)
        self._watch = {
            kind: self.compute_time.of(blame.whom, waits=kind == "transport")
            for kind, blame in self._blame.items()
        }
        self.took = dict.fromkeys(("localizer", "planner", "avoider", "safety"), 0.0)
        try:
            for kind in PARTS:
                with self._blame[kind]:
                    make = specs[kind].make
                    accepts(make, "make", ("scene",), options[kind])
                    made = self._parts[kind] = make(mission.scene, **options[kind])
                    require_methods(made, CONTRACTS[kind])
        except BaseException:
            self.close()
            raise

    @property
    def localizer(self) -> str:
        """The localizer with its distribution and version, for messages."""
        return self._blame["localizer"].whom

    def connect(self, trajectories: Sequence[Trajectory]) -> None:
        """Open the links, and upload what the agents are to fly on board."""
        transport = self._parts["transport"]
        with self._blame["transport"]:
            if trajectories and not hasattr(transport, "upload"):
                raise PluginError("flies no trajectories on board")
            transport.connect()
            if trajectories:
                transport.upload(trajectories)

    def wait(self, until: float) -> float:
        """Let time pass until `until`, s, and return the mission time it is then, s."""
        with self._watch["transport"], self._blame["transport"]:
            now = float(self._parts["transport"].wait(until))
            if not until - EARLY <= now < math.inf:
                raise ContractError(
                    f"wait({until!r}) returned {now!r}, expected that time or later"
                )
            return now

    def receive(self) -> Telemetry:
        """Return what arrived since the last call."""
        with self._watch["transport"], self._blame["transport"]:
            return checked_telemetry(self._parts["transport"].receive(), self._n)

    def locate(self, telemetry: Telemetry) -> Estimate:
        """Estimate where the agents are."""
        with self.timed("localizer"), self._watch["localizer"], self._blame["localizer"]:
            estimate = checked_estimate(self._parts["localizer"].locate(telemetry), self._n)
            if not abs(estimate.time - telemetry.time) <= EARLY:
                raise ContractError(
                    f"Estimate.time is {estimate.time!r}, expected the telemetry's, "
                    f"{telemetry.time!r}"
                )
            return estimate

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        """Plan the next setpoint."""
        with self.timed("planner"), self._watch["planner"], self._blame["planner"]:
            return checked_plan(self._parts["planner"].plan(estimate, goals), self._n)

    def refuses(self, position: Array) -> Mask:
        """Return which positions, (K, 3) m, the planner would not fly to: (K,)."""
        refused = np.zeros(len(position), np.bool_)
        if self._check_goals is not None:
            goals = [(x, y, z) for x, y, z in position.tolist()]
            with self._blame["planner"]:
                for problem in self._check_goals(self._scene, goals, **self._planner_options):
                    refused[int(problem.path[0])] = True
        return refused

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        """Make a setpoint safe."""
        with self.timed("avoider"), self._watch["avoider"], self._blame["avoider"]:
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
            if truth is not None:
                expect_rows(require_type(truth, Truth), len(truth.position), self._n)
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
