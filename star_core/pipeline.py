"""Calls the four plugins of a flight: guarded, timed, and their outputs validated once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any, Final

import numpy as np

from star_core.contracts import Avoider, Localizer, Paced, Planner, Transport
from star_core.errors import PluginError
from star_core.messages.arrays import Array, Mask
from star_core.messages.commands import Command, Trajectory
from star_core.messages.rotations import Transform
from star_core.messages.state import Estimate, Goals, Plan, Setpoint, Truth
from star_core.messages.telemetry import (
    Corrections,
    Detections,
    Frames,
    Odometry,
    Sightings,
    Telemetry,
)
from star_core.mission import Mission
from star_core.plugin_support.compute_time import ComputeTime, Stopwatch
from star_core.plugin_support.guard import (
    PluginGuard,
    Strikes,
    ToleratingGuard,
    close_all,
    require_methods,
    require_signature,
)
from star_core.plugin_support.option_schema import PARTS
from star_core.plugin_support.outputs import (
    checked_location,
    checked_plan,
    checked_setpoint,
    checked_telemetry,
    checked_time,
    checked_truth,
)
from star_core.registry import Registry
from star_core.toolkit.progress import Progress

CONTRACTS: Final = {
    "transport": Transport,
    "localizer": Localizer,
    "planner": Planner,
    "avoider": Avoider,
}


class PluginPipeline:
    """Calls the plugins, validates what they return, and names the plugin that breaks its contract.

    Every method may raise `PluginError`. Failures in flight are tolerated at first where a method
    says what it returns instead.

    Args:
        mission: Names the plugins.
        registry: Where they are found.

    Attributes:
        compute_time: Of every plugin of the flight.
        strikes: Failures in flight of every plugin.
        safety_time: Measures the safety filter.
    """

    def __init__(self, mission: Mission, registry: Registry) -> None:
        self._n = len(mission.scene.agents)
        self._scene = mission.scene
        # rows of the agents whose cameras send mosaics, and the kinds of their pixels
        self._mosaics = {
            row: agent.camera.pixels
            for row, agent in enumerate(mission.scene.agents)
            if agent.camera is not None and agent.camera.pixels != "gray"
        }
        self._plugins: dict[str, Any] = {}
        self._making = {kind: PluginGuard(str(mission.parts[kind]), self._n) for kind in PARTS}
        self.compute_time = ComputeTime(
            mission.scene.period, realtime=mission.scene.realtime, brake=self._brake
        )
        self.strikes = Strikes(mission.plugin_strikes)
        self._telemetry: Telemetry  # the last, like the next two
        self._estimate: Estimate
        self._sent: Setpoint | None = None  # without agents that have received a command since
        self._truth_failed = False
        self.safety_time = Stopwatch(perf_counter)
        self._watches = {
            kind: self.compute_time.of(guard.plugin, waits=kind == "transport")
            for kind, guard in self._making.items()
        }
        self._calling = {
            kind: PluginGuard(guard.plugin, self._n, self._watches[kind])
            for kind, guard in self._making.items()
        }
        self._tolerating = {
            kind: ToleratingGuard(guard, self.strikes) for kind, guard in self._calling.items()
        }
        specs = {kind: registry.find(kind, mission.parts[kind].use).offer for kind in PARTS}
        options = {kind: dict(mission.parts[kind].options) for kind in PARTS}
        self._check_goals = specs["planner"].check_goals
        self._planner_options = options["planner"]
        try:
            for kind in PARTS:
                with self._making[kind], Progress(f"preparing {self._making[kind].plugin}"):
                    make = specs[kind].make
                    require_signature(make, "make", ("scene",), options[kind])
                    self._plugins[kind] = make(mission.scene, **options[kind])
                    require_methods(self._plugins[kind], CONTRACTS[kind])
        except BaseException:
            self.close()
            raise

    @property
    def localizer(self) -> str:
        """The localizer with its distribution and version, for messages."""
        return self._making["localizer"].plugin

    @property
    def paced(self) -> Paced | None:
        """The transport, if it is a simulation whose speed can be changed."""
        transport = self._plugins["transport"]
        return transport if isinstance(transport, Paced) else None

    def took(self) -> dict[str, float]:
        """Return the time spent so far, s, by the kind of plugin, and for ``safety``.

        The transport is not in it: it also waits.
        """
        kinds = ("localizer", "planner", "avoider")
        times = {kind: self._watches[kind].elapsed for kind in kinds}
        return times | {"safety": self.safety_time.elapsed}

    def connect(self, trajectories: Sequence[Trajectory], folder: Path | None = None) -> None:
        """Open the links, and upload the trajectories that agents may fly on board.

        `folder` is that of the record, if there is one.
        """
        transport = self._plugins["transport"]
        with self._making["transport"], Progress(f"connecting to {self._n} agents"):
            if trajectories and not hasattr(transport, "upload"):
                raise PluginError("flies no trajectories on board")
            transport.connect()
            if trajectories:
                transport.upload(trajectories)
            if folder is not None and hasattr(transport, "record_in"):
                transport.record_in(folder)

    def wait(self, until: float) -> float:
        """Let time pass until `until`, s, and return the mission time it is then, s."""
        with self._calling["transport"]:
            return checked_time(self._plugins["transport"].wait(until), until)

    def receive(self) -> Telemetry:
        """Return what arrived since the last call: nothing new if the transport fails."""
        with self._tolerating["transport"]:
            telemetry = checked_telemetry(self._plugins["transport"].receive(), self._n)
            self._telemetry = self._without_mosaics(telemetry) if self._mosaics else telemetry
            return self._telemetry
        self._telemetry = replace(
            self._telemetry,
            age=self._telemetry.age + self._scene.period,
            odometry=Odometry.none(),
            frames=Frames.none(),
            detections=Detections.none(),
            refusals=(),
        )
        return self._telemetry

    def _without_mosaics(self, telemetry: Telemetry) -> Telemetry:
        """Return telemetry whose images are gray, for localizers and observers."""
        from star_core.toolkit.mosaic import gray_from_mosaic  # imports OpenCV

        frames = telemetry.frames
        images = (
            gray_from_mosaic(image, self._mosaics.get(row, "gray"))
            for row, image in zip(frames.agent.tolist(), frames.image, strict=True)
        )
        return replace(telemetry, frames=replace(frames, image=tuple(images)))

    def locate(self, telemetry: Telemetry) -> Estimate:
        """Estimate the positions of the agents: as in the last tick if the localizer fails."""
        with self._tolerating["localizer"]:
            answer = self._plugins["localizer"].locate(telemetry)
            self._estimate = checked_location(answer, telemetry)
            return self._estimate
        return renewed(self._estimate, telemetry.time)

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        """Plan the next setpoint: none if the planner fails."""
        with self._tolerating["planner"]:
            return checked_plan(self._plugins["planner"].plan(estimate, goals), self._n)
        return Plan.none(self._n)

    def refuses(self, position: Array) -> Mask:
        """Return which positions, (K, 3) m, the planner would not fly to: (K,)."""
        refused = np.zeros(len(position), np.bool_)
        if self._check_goals is not None:
            goals = [(x, y, z) for x, y, z in position.tolist()]
            with self._calling["planner"]:
                for problem in self._check_goals(self._scene, goals, **self._planner_options):
                    refused[int(problem.path[0])] = True
        return refused

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        """Return the setpoint nearest to `wanted` that keeps the agents apart.

        If the avoider fails it is `wanted`: the tick then brakes all agents.
        """
        with self._tolerating["avoider"]:
            return checked_setpoint(self._plugins["avoider"].avoid(estimate, wanted), self._n)
        return wanted

    def fail(self, reasons: Mapping[str, str]) -> None:
        """Count failures that only several outputs show, by kind, as those that plugins raise."""
        for kind, reason in reasons.items():
            with self._tolerating[kind]:
                raise PluginError(reason)

    def command(self, command: Command) -> None:
        """Send a command whose positions are in odometry frames."""
        with self._calling["transport"]:
            self._plugins["transport"].command(command)
        if self._sent is not None:
            others = ~np.isin(np.arange(self._n), command.agent)
            self._sent = replace(self._sent, active=self._sent.active & others)

    def correct(self, corrections: Corrections) -> None:
        """Send pose corrections to the on-board estimators, unless the transport fails."""
        with self._tolerating["transport"]:
            self._plugins["transport"].correct(corrections)

    def send(self, setpoint: Setpoint, map_from_odom: Transform) -> Setpoint:
        """Send a setpoint in odometry frames; return the one that was sent, or is to be."""
        transport = self._plugins["transport"]
        with self._tolerating["transport"]:
            self._sent = setpoint
            if hasattr(transport, "note_frames"):
                transport.note_frames(map_from_odom)
            sent = transport.send(setpoint)
            return setpoint if sent is setpoint else checked_setpoint(sent, self._n)
        return setpoint

    def _brake(self) -> None:
        """Let the agents that setpoints fly brake while another plugin hangs."""
        if self._sent is not None:
            with suppress(Exception):
                still = np.zeros((self._n, 3))
                self._plugins["transport"].send(replace(self._sent, velocity=still))

    def truth(self) -> Truth | None:
        """Return the ground truth, if there is one.

        It is None if the transport fails, and for good after a failure that is not tolerated.
        """
        if self._truth_failed:
            return None
        truth, self._truth_failed = None, True
        with self._tolerating["transport"]:
            truth = checked_truth(self._plugins["transport"].truth(), self._n)
        self._truth_failed = False
        return truth

    def close(self) -> list[str]:
        """Close every plugin that has ``close()``; return their errors."""
        return close_all((self._making[kind], plugin) for kind, plugin in self._plugins.items())

    def await_landings(self) -> None:
        """Wait for the transport to land, after the flight, what may be in the air."""
        with self._making["transport"]:
            getattr(self._plugins["transport"], "await_landings", lambda: None)()


def renewed(last: Estimate, time: float) -> Estimate:
    """Return the last estimate for the present time, without what was sent with it once."""
    return replace(
        last,
        time=time,
        corrections=Corrections.none(),
        sightings=Sightings.none(),
        detections=Detections.none(),
    )
