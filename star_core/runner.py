"""Flies a mission from its plugins to its summary."""

from __future__ import annotations

import gc
import logging
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import Any

from star_core.contracts import Status
from star_core.errors import PluginError
from star_core.messages.events import Flight
from star_core.mission import Mission
from star_core.observers import Observers
from star_core.operator import Operator
from star_core.phases import MissionPhase
from star_core.pipeline import PluginPipeline
from star_core.plugin_support.guard import leaked_threads
from star_core.plugin_support.registry import Registry
from star_core.records.manifest import manifest
from star_core.tick import ControlLoop, MissionStatus
from star_core.toolkit.progress import Progress
from star_core.world.scene import Scene

log = logging.getLogger(__name__)


def fly(
    mission: Mission,
    registry: Registry,
    *,
    folder: Path | str | None = None,
    save_frames: bool = False,
    operator: Operator | None = None,
) -> dict[str, Any]:
    """Fly `mission` and return its summary, as ``summary.json`` keeps it.

    Args:
        mission: What to fly.
        registry: Of its plugins and observers.
        folder: For the observers' records.
        save_frames: Whether to record the cameras' images.
        operator: Controls of the flight, for its caller; observers receive them as well.

    Raises:
        PluginError: A plugin cannot be made, or the links cannot be opened; nothing has moved.
    """
    folder = None if folder is None else Path(folder)
    operator = operator or Operator()
    before = set(threading.enumerate())
    pipeline = PluginPipeline(mission, registry)
    run: _Run | None = None
    try:
        run = _Run(mission, registry, pipeline, operator)
        pipeline.connect(run.loop.trajectories, folder)
        operator.simulation = pipeline.paced
        operator.report = run.observers.event
        operator.await_landings = pipeline.await_landings
        facts = manifest(mission, registry)
        run.observers.start(
            Flight(mission.name, mission.scene, facts, folder, save_frames), operator
        )
        if text := registry.missing_monitors():
            log.warning("%s", text)
            run.observers.event("plugin", text)
        with pipeline.compute_time.watchdog, _short_collections(mission.scene):
            run.fly()
    finally:
        with Progress("closing the links and the record"):
            failures: list[str] = []
            try:
                failures += run.loop.close() if run is not None else ()
                failures += pipeline.close()
            finally:  # the operator may interrupt a plugin that hangs
                operator.recording = True
                if run is not None and run.reason is not None:  # it began to fly
                    for text in failures:
                        run.observers.event("failure", text)
                    if text := leaked_threads(before):
                        run.observers.event("plugin", text)
                    summary = run.summary()
                    run.observers.notify("star_mission_ended", summary=deepcopy(summary))
                operator.recording = False
    return summary


@contextmanager
def _short_collections(scene: Scene) -> Iterator[None]:
    """Exclude everything that exists before a flight in real time from garbage collection.

    A full collection examines some 180,000 objects otherwise, which takes longer than a tick.
    """
    before = gc.get_freeze_count()
    if scene.realtime:
        gc.freeze()
    try:
        yield
    finally:
        if scene.realtime and not before:
            gc.unfreeze()


def outcome_of(summary: Mapping[str, Any]) -> int:
    """Return the exit status of a flight: 0 when it completed, else 1."""
    return 0 if summary["outcome"] == MissionPhase.COMPLETED else 1


class _Run:
    """One flight, from its first tick until all agents are on the ground.

    Attributes:
        observers: Receive ticks and events.
        loop: The control loop.
        reason: Why the mission did not complete; empty if it did, None before it flies.
    """

    def __init__(
        self, mission: Mission, registry: Registry, pipeline: PluginPipeline, operator: Operator
    ) -> None:
        self._operator = operator
        self._wall_time = 0.0
        self.observers = Observers(registry.observers(), pipeline.compute_time)
        self.loop = ControlLoop(mission, registry, pipeline, self.observers, operator)
        self.reason: str | None = None

    def fly(self) -> None:
        """Fly the steps, and land all agents."""
        begun = time.perf_counter()
        self.reason = ""
        self.loop.change_phase("start")
        try:
            self.reason = self._fly()
        finally:
            self._wall_time = time.perf_counter() - begun

    def summary(self) -> dict[str, Any]:
        """Return the contents of ``summary.json``."""
        return self.loop.summary(self.reason or "", self._wall_time)

    def _fly(self) -> str:
        """Fly the steps and land all agents; return why the mission did not complete, if so."""
        if self._operator.stops:  # while observers, such as a view, waited
            self.observers.event("interrupt", "the operator ends the flight before it begins")
            self.loop.change_phase("abort")
            return "not started: interrupted by the operator"
        try:
            end, reason = self._fly_steps()
            landing = self.loop.land_all(complete=end == "complete")
            reasons = [reason, self._until_over(landing).reason]
        except PluginError as error:
            self.observers.event("failure", str(error))
            end, reasons = "fail", [str(error), self._land_whatever_failed()]
        except BaseException as error:
            self.reason = f"Python was interrupted: {type(error).__name__}"
            try:
                self._land_whatever_failed()
            finally:  # it may be interrupted again
                self.loop.change_phase("abort")
            raise
        reason = "; ".join(filter(None, (*reasons, *self.loop.finish())))
        if self.loop.change_phase(end) is MissionPhase.COMPLETED and reason:
            self.loop.change_phase("fail")
        return reason

    def _fly_steps(self) -> tuple[str, str]:
        """Fly the mission's steps; return how they ended (a trigger of the mission) and why."""
        while True:
            now = self.loop.tick()
            if self._operator.stops:
                self.observers.event("interrupt", "the operator ends the flight: all agents land")
                return "abort", "interrupted by the operator"
            if now.status is Status.FAILURE:
                self.observers.event("failure", now.reason)
                return "fail", now.reason
            if now.status is Status.SUCCESS:
                return "complete", ""

    def _until_over(self, now: MissionStatus) -> MissionStatus:
        """Run ticks until what the loop does is over; return its status."""
        while now.status is Status.RUNNING:
            now = self.loop.tick()
        return now

    def _land_whatever_failed(self) -> str:
        """Land all agents from their positions; return what failed, if anything."""
        try:
            return self._until_over(self.loop.land_all(complete=False, at_once=True)).reason
        except PluginError:
            self.loop.stop_locating()  # it may be the localizer that raised
        try:
            return self._until_over(self.loop.land_all(complete=False, at_once=True)).reason
        except PluginError as error:
            return self.loop.give_up(error)
