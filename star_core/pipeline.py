"""Calls the four plugins of a flight: guarded, timed, and their outputs validated once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any, Final, TypeVar

import numpy as np

from star_core.contracts import (
    Avoider,
    AwaitsLandings,
    Localizer,
    NotesFrames,
    NotesGoals,
    Planner,
    Records,
    SetsParameters,
    Transport,
    Uploads,
)
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
from star_core.mission import Mission, PluginChoice
from star_core.operator import Paced
from star_core.plugin_support.compute_time import ComputeTime, Stopwatch
from star_core.plugin_support.guard import (
    PluginGuard,
    Strikes,
    close_all,
    require_methods,
    require_signature,
)
from star_core.plugin_support.option_schema import PIPELINE_KINDS
from star_core.plugin_support.outputs import (
    checked_location,
    checked_plan,
    checked_setpoint,
    checked_telemetry,
    checked_time,
    checked_truth,
)
from star_core.plugin_support.registry import Registry
from star_core.toolkit.progress import Progress
from star_core.world.scene import Scene

Value = TypeVar("Value")

CONTRACTS: Final = {
    "transport": Transport,
    "localizer": Localizer,
    "planner": Planner,
    "avoider": Avoider,
}


class PluginStage:
    """A plugin of the pipeline, whose calls are guarded, timed and validated.

    Attributes:
        plugin: Once it is made.
        making: Guards calls before and after the flight.
    """

    def __init__(self, choice: PluginChoice, compute_time: ComputeTime, strikes: Strikes) -> None:
        self.name = str(choice)
        self.watch = compute_time.of(self.name, waits=choice.kind == "transport")
        self.plugin: Any = None
        self.making = PluginGuard(self.name)
        self._calling = PluginGuard(self.name, self.watch)
        self._strikes = strikes

    def make(self, scene: Scene, spec: Any, options: Mapping[str, Any], contract: type) -> None:
        """Make the plugin, and check that it has the methods of its contract."""
        with self.making, Progress(f"preparing {self.name}"):
            require_signature(spec.make, "make", ("scene",), options)
            self.plugin = spec.make(scene, **options)
            require_methods(self.plugin, contract)

    def require(self, work: Callable[[], Value]) -> Value:
        """Return the result of what calls the plugin and must not fail."""
        with self._calling:
            return work()

    def attempt(self, work: Callable[[], Value], otherwise: Callable[[], Value]) -> Value:
        """Return the result of what calls the plugin; of the other if a failure is tolerated."""
        return self._calling.attempt(self._strikes, work, otherwise)

    def strike(self, reason: str) -> None:
        """Count a failure that only the outputs of several plugins show, as one that it raises."""
        error = PluginError(f"{self.name}: {reason}")
        if not self._strikes.tolerates(self.name, error):
            raise error


class PluginPipeline:
    """Calls the plugins, validates what they return, and names the plugin that breaks its contract.

    Every method may raise `PluginError`. Failures in flight are tolerated at first where the
    docstring of a method names a fallback.

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
        self.compute_time = ComputeTime(
            mission.scene.period, realtime=mission.scene.realtime, brake=self._brake
        )
        self.strikes = Strikes(mission.plugin_strikes)
        self._telemetry: Telemetry  # the last, like the next two
        self._estimate: Estimate
        self._sent: Setpoint | None = None  # without agents that have received a command since
        self._truth_failed = False
        self.safety_time = Stopwatch(perf_counter)
        self._stages = {
            kind: PluginStage(mission.plugins[kind], self.compute_time, self.strikes)
            for kind in PIPELINE_KINDS
        }
        self._transport, self._localizer, self._planner, self._avoider = map(
            self._stages.__getitem__, PIPELINE_KINDS
        )
        specs = {
            kind: registry.find(kind, mission.plugins[kind].use).offer for kind in PIPELINE_KINDS
        }
        self._check_goals = specs["planner"].check_goals
        self._planner_options = dict(mission.plugins["planner"].options)
        try:
            for kind, stage in self._stages.items():
                options = dict(mission.plugins[kind].options)
                stage.make(mission.scene, specs[kind], options, CONTRACTS[kind])
        except BaseException:
            self.close()
            raise
        transport = self._transport.plugin
        self._notes_frames = transport if isinstance(transport, NotesFrames) else None
        avoider = self._avoider.plugin
        self._notes_goals = avoider if isinstance(avoider, NotesGoals) else None

    @property
    def localizer(self) -> str:
        """The localizer with its distribution and version, for messages."""
        return self._localizer.name

    @property
    def paced(self) -> Paced | None:
        """The transport, if it is a simulation whose speed can be changed."""
        transport = self._transport.plugin
        return transport if isinstance(transport, Paced) else None

    def took(self) -> dict[str, float]:
        """Return the time spent so far, s, by the kind of plugin, and for ``safety``.

        The transport is not in it: it also waits.
        """
        kinds = ("localizer", "planner", "avoider")
        times = {kind: self._stages[kind].watch.elapsed for kind in kinds}
        return times | {"safety": self.safety_time.elapsed}

    def connect(self, trajectories: Sequence[Trajectory], folder: Path | None = None) -> None:
        """Open the links, and upload the trajectories that agents may fly on board.

        `folder` is that of the record, if there is one.
        """
        transport = self._transport.plugin
        uploads = isinstance(transport, Uploads)
        with self._transport.making, Progress(f"connecting to {self._n} agents"):
            if trajectories and not uploads:
                raise PluginError("flies no trajectories on board")
            transport.connect()
            if trajectories:
                transport.upload(trajectories)
            if folder is not None and isinstance(transport, Records):
                transport.record_in(folder)

    def wait(self, until: float) -> float:
        """Let time pass until `until`, s, and return the mission time it is then, s."""
        wait = self._transport.plugin.wait
        return self._transport.require(lambda: checked_time(wait(until), until))

    def receive(self) -> Telemetry:
        """Return what arrived since the last call: nothing new if the transport fails."""
        self._telemetry = self._transport.attempt(self._receive, self._nothing_received)
        return self._telemetry

    def _receive(self) -> Telemetry:
        telemetry = checked_telemetry(self._transport.plugin.receive(), self._n)
        return self._without_mosaics(telemetry) if self._mosaics else telemetry

    def _nothing_received(self) -> Telemetry:
        return replace(
            self._telemetry,
            age=self._telemetry.age + self._scene.period,
            odometry=Odometry.none(),
            frames=Frames.none(),
            detections=Detections.none(),
            refusals=(),
        )

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
        locate = self._localizer.plugin.locate
        self._estimate = self._localizer.attempt(
            lambda: checked_location(locate(telemetry), telemetry),
            lambda: renewed(self._estimate, telemetry.time),
        )
        return self._estimate

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        """Plan the next setpoint: none if the planner fails."""
        plan = self._planner.plugin.plan
        return self._planner.attempt(
            lambda: checked_plan(plan(estimate, goals), self._n), lambda: Plan.none(self._n)
        )

    def refuses(self, position: Array) -> Mask:
        """Return which positions, (K, 3) m, the planner would not fly to: (K,)."""
        refused = np.zeros(len(position), np.bool_)
        if self._check_goals is not None:
            goals = [(x, y, z) for x, y, z in position.tolist()]

            def check() -> None:
                for problem in self._check_goals(self._scene, goals, **self._planner_options):
                    refused[int(problem.path[0])] = True

            self._planner.require(check)
        return refused

    def avoid(self, estimate: Estimate, planned: Setpoint, goals: Goals) -> Setpoint:
        """Return the setpoint nearest to `planned` that keeps the agents apart.

        If the avoider fails it is `planned`: the tick then brakes all agents.
        """
        return self._avoider.attempt(lambda: self._avoid(estimate, planned, goals), lambda: planned)

    def _avoid(self, estimate: Estimate, planned: Setpoint, goals: Goals) -> Setpoint:
        if self._notes_goals is not None:
            self._notes_goals.note_goals(goals)
        return checked_setpoint(self._avoider.plugin.avoid(estimate, planned), self._n)

    def strike(self, kind: str, reason: str) -> None:
        """Count a failure that only several outputs show, as one that the plugin raises."""
        self._stages[kind].strike(reason)

    def command(self, command: Command) -> None:
        """Send a command whose positions are in odometry frames."""
        self._transport.require(lambda: self._transport.plugin.command(command))
        if self._sent is not None:
            others = ~np.isin(np.arange(self._n), command.agent)
            self._sent = replace(self._sent, active=self._sent.active & others)

    def set_parameters(self, rows: Sequence[int], values: Mapping[str, float]) -> None:
        """Set parameters of agents' firmware, unless the transport has none, or fails."""
        transport = self._transport.plugin
        if isinstance(transport, SetsParameters):
            self._transport.attempt(lambda: transport.set_parameters(rows, values), _nothing)

    def correct(self, corrections: Corrections) -> None:
        """Send pose corrections to the on-board estimators, unless the transport fails."""
        self._transport.attempt(lambda: self._transport.plugin.correct(corrections), _nothing)

    def send(self, setpoint: Setpoint, map_from_odom: Transform) -> Setpoint:
        """Send a setpoint in odometry frames; return the one that was sent, or is to be."""
        self._sent = setpoint
        return self._transport.attempt(
            lambda: self._send(setpoint, map_from_odom), lambda: setpoint
        )

    def _send(self, setpoint: Setpoint, map_from_odom: Transform) -> Setpoint:
        if self._notes_frames is not None:
            self._notes_frames.note_frames(map_from_odom)
        sent = self._transport.plugin.send(setpoint)
        return setpoint if sent is setpoint else checked_setpoint(sent, self._n)

    def _brake(self) -> None:
        """Let the agents that setpoints fly brake while another plugin hangs."""
        if self._sent is not None:
            with suppress(Exception):
                still = np.zeros((self._n, 3))
                sent = self._sent
                self._transport.plugin.send(Setpoint.made(still, sent.yaw, sent.active))

    def truth(self) -> Truth | None:
        """Return the ground truth, if there is one.

        It is None if the transport fails, and for good after a failure that is not tolerated.
        """
        if self._truth_failed:
            return None
        self._truth_failed = True
        truth = self._transport.attempt(
            lambda: checked_truth(self._transport.plugin.truth(), self._n), _nothing
        )
        self._truth_failed = False
        return truth

    def close(self) -> list[str]:
        """Close every plugin that has ``close()``; return their errors."""
        made = (stage for stage in self._stages.values() if stage.plugin is not None)
        return close_all((stage.making, stage.plugin) for stage in made)

    def await_landings(self) -> None:
        """Wait for the transport to land, after the flight, what may be in the air."""
        transport = self._transport.plugin
        if isinstance(transport, AwaitsLandings):
            with self._transport.making:
                transport.await_landings()


def renewed(last: Estimate, time: float) -> Estimate:
    """Return the last estimate for the present time, without what was sent with it once."""
    return replace(
        last,
        time=time,
        corrections=Corrections.none(),
        sightings=Sightings.none(),
        detections=Detections.none(),
        messages=(),
    )


def _nothing() -> None:
    """Return nothing, in the place of a result."""
