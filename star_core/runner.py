"""A flight from its plugins to its summary: by the steps of a mission, or by a program."""

from __future__ import annotations

import gc
import inspect
import logging
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from star_core.contracts import Status
from star_core.errors import PluginError, StarError
from star_core.execution.executor import StartedStep
from star_core.messages.commands import Command
from star_core.messages.events import Flight, Tick
from star_core.messages.state import Goals, Setpoint
from star_core.mission import Mission, OnFailure
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
    with open_flight(
        mission, registry, steps=True, folder=folder, save_frames=save_frames, operator=operator
    ) as flight:
        while not flight.over:
            flight.advance()
    return flight.close()


def open_flight(
    mission: Mission,
    registry: Registry,
    *,
    steps: bool = False,
    folder: Path | str | None = None,
    save_frames: bool = False,
    operator: Operator | None = None,
) -> OpenFlight:
    """Begin a flight that its caller steps, commands and closes.

    With `steps`, those of the mission are flown, too, by agents until they are given something
    else. All else is as of `fly`.

    Example:
        >>> from star_core import Registry, load
        >>> registry = Registry()
        >>> with open_flight(load("first_flight", registry), registry) as flight:
        ...     flight.run("takeoff", height=0.8)
        ...     flight.run("goto", agents="cf1", by=[0.2, 0.0, 0.0])
        ...     flight.tick.estimate.position.shape
        'success'
        'success'
        (3, 3)
        >>> flight.close()["outcome"]
        'completed'
    """
    if not steps:
        mission = replace(mission, steps=(), reactions=())
    return OpenFlight(
        mission,
        registry,
        has_steps=steps,
        folder=None if folder is None else Path(folder),
        save_frames=save_frames,
        operator=operator or Operator(),
    )


@contextmanager
def _short_collections(scene: Scene) -> Iterator[None]:
    """Exclude everything that exists before a flight in real time from garbage collection.

    A full collection examines some 180,000 objects otherwise, which takes longer than a tick.
    """
    if not scene.realtime:
        yield
        return
    before = gc.get_freeze_count()  # by counting them one by one
    gc.freeze()
    try:
        yield
    finally:
        if not before:
            gc.unfreeze()


class OpenFlight:
    """A flight in progress, which `open_flight` begins; as a context it is closed at its end.

    Mission time stands still between two steps in simulation only. Real drones need setpoints: step
    at the mission's rate.

    Args:
        has_steps: Whether the flight is over when the mission's steps are done.

    Attributes:
        scene: What every plugin was made with.
        over: Whether only `close` is left to be called.
        reason: Why the mission did not complete; empty if it did, or has not ended.
    """

    def __init__(
        self,
        mission: Mission,
        registry: Registry,
        *,
        has_steps: bool,
        folder: Path | None,
        save_frames: bool,
        operator: Operator,
    ) -> None:
        self.scene = mission.scene
        self.over = False
        self.reason = ""
        self._end = "complete"  # trigger of the mission at its end
        self._failed = False  # whether a plugin did, or Python was interrupted
        self._lands = True
        self._has_steps = has_steps
        self._operator = operator
        self._before = set(threading.enumerate())
        self._pipeline = PluginPipeline(mission, registry)
        self._loop: ControlLoop | None = None
        self._begun: float | None = None  # s
        self._summary: dict[str, Any] | None = None
        self._contexts = ExitStack()
        try:
            self._open(mission, registry, folder, save_frames=save_frames)
        except BaseException:
            self._release()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if isinstance(error, Exception) and not self.over:
            self._stop("abort", f"the program raised {type(error).__name__}: {error}")
        elif error is not None and not self.over:
            self._stop("abort", f"Python was interrupted: {type(error).__name__}", failed=True)
        self.close()

    @property
    def tick(self) -> Tick:
        """The tables of the last tick.

        Raises:
            StarError: There was none.
        """
        if (tick := self._running_loop.last) is None:
            raise StarError("the flight has had no tick; call step()")
        return tick

    @property
    def time(self) -> float:
        """Mission time of the last tick, s."""
        last = self._running_loop.last
        return 0.0 if last is None else last.time

    def step(self) -> Tick:
        """Fly one tick; return its tables.

        Raises:
            StarError: The flight has ended, with the reason: a safety rule, a plugin that failed, a
                step that failed, or the operator.
        """
        if self.over:
            raise StarError(f"the flight is over{self._why}", "flight-ended")
        self.advance()
        if self.over and self._end != "complete":
            raise StarError(f"the flight ends{self._why}", "flight-ended")
        return self.tick

    def advance(self) -> None:
        """Fly one tick, as `step`, but set `over` and `reason` when the flight ends."""
        try:
            now = self._running_loop.tick()
        except PluginError as error:
            self._observers.event("failure", str(error))
            self._stop("fail", str(error), failed=True)
            return
        except BaseException as error:
            self._stop("abort", f"Python was interrupted: {type(error).__name__}", failed=True)
            raise
        if self._operator.stops:
            text = "the operator ends the flight: all agents land"
            self._observers.event("interrupt", text)
            self._stop("abort", "interrupted by the operator")
        elif now.status is Status.FAILURE:
            self._observers.event("failure", now.reason)
            self._stop("fail", now.reason)
        elif now.status is Status.SUCCESS and self._has_steps:
            self._stop("complete", "")

    def wait(self, seconds: float) -> Tick:
        """Fly for a time, at least one tick; return the tables of the last tick."""
        until = self.time + seconds - self.scene.period / 2
        tick = self.step()
        while tick.time < until:
            tick = self.step()
        return tick

    def start(
        self,
        verb: str,
        agents: str | list[str] | tuple[str, ...] | None = None,
        *,
        timeout: float | None = None,
        on_failure: OnFailure = "abort",
        location: str = "",
        **options: Any,
    ) -> StartedStep:
        """Start a step, which goes on while the flight is stepped.

        Its agents leave the steps that they are in.

        Args:
            verb: Any that missions have, such as ``takeoff``.
            agents: Names of agents or groups; None for all agents.
            timeout: Time after which it fails, s; None if the verb derives it.
            on_failure: As in a mission: what happens if it fails.
            location: For messages and the record, ``file:line:column``; empty for the caller's.
            options: Of the verb, as in a mission.

        Raises:
            InputError: An option or a name is wrong.
            StarError: An agent is not where the step needs it to be, or has left the mission.
            PluginError: There is no such verb, or its task cannot be made.
        """
        loop = self._running_loop
        action = loop.program.action(
            verb,
            agents,
            options,
            timeout=timeout,
            on_failure=on_failure,
            location=location or _caller(),
        )
        return loop.program.start(action, loop.phases)

    def run(self, verb: str, *arguments: Any, **options: Any) -> str:
        """Start a step and fly until it is over; return its outcome: see `start` and `step`."""
        started = self.start(verb, *arguments, **options)
        while not started.over:
            self.step()
        return str(started.outcome)

    def set_goals(self, goals: Goals) -> None:
        """Set goals of the active rows, by the planner; they stay, and rest after one tick.

        Raises:
            ContractError: A goal is no number, or there is not one row per agent.
        """
        self._running_loop.program.set_goals(goals)

    def set_setpoint(self, setpoint: Setpoint) -> None:
        """Set what the active rows fly in the next tick, without the planner.

        Avoider and safety filter still change it. After that tick an agent holds its position.

        Raises:
            ContractError: A value is no number, or there is not one row per agent.
        """
        self._running_loop.program.set_setpoint(setpoint)

    def send(self, command: Command) -> None:
        """Send a command to on-board commanders in the next tick; positions are in the map.

        Raises:
            ContractError: It is no command.
        """
        self._running_loop.program.send(command)

    def set_parameters(
        self, values: Mapping[str, float], agents: str | list[str] | tuple[str, ...] | None = None
    ) -> None:
        """Set parameters of agents' firmware now, without waiting for it; a simulation has none.

        Args:
            values: By ``group.name``, in the firmware's units.
            agents: Names of agents or groups; None for all agents.

        Raises:
            InputError: There is no such agent or group.
        """
        self._pipeline.set_parameters(self._running_loop.program.rows(agents), values)

    def fail(self, reason: str) -> None:
        """End the flight as failed, if it has not ended: `close` then lands all agents."""
        if not self.over:
            self._stop("fail", reason)

    def close(self) -> dict[str, Any]:
        """Land all agents and close the plugins; return the summary, as ``summary.json`` keeps it.

        It may be called again.
        """
        if self._summary is None:
            try:
                self._land()
            finally:
                self._release()
        assert self._summary is not None  # noqa: S101 -- `_release` sets it
        return self._summary

    @property
    def _running_loop(self) -> ControlLoop:
        assert self._loop is not None  # noqa: S101 -- `__init__` sets it, or raises
        return self._loop

    @property
    def _why(self) -> str:
        return f": {self.reason}" if self.reason else ""

    def _open(
        self, mission: Mission, registry: Registry, folder: Path | None, *, save_frames: bool
    ) -> None:
        """Make the control loop, open the links and begin the flight."""
        pipeline, operator = self._pipeline, self._operator
        observers = self._observers = Observers(registry.observers(), pipeline.compute_time)
        self._loop = ControlLoop(mission, registry, pipeline, observers, operator)
        pipeline.connect(self._loop.trajectories, folder)
        operator.simulation = pipeline.paced
        operator.report = observers.event
        operator.await_landings = pipeline.await_landings
        facts = manifest(mission, registry)
        observers.start(Flight(mission.name, mission.scene, facts, folder, save_frames), operator)
        if text := registry.missing_monitors():
            log.warning("%s", text)
            observers.event("plugin", text)
        self._contexts.enter_context(pipeline.compute_time.watchdog)
        self._contexts.enter_context(_short_collections(mission.scene))
        self._begun = time.perf_counter()
        self._loop.change_phase("start")
        if operator.stops:  # while observers, such as a view, waited
            observers.event("interrupt", "the operator ends the flight before it begins")
            self._loop.change_phase("abort")
            self._lands = False
            self._stop("abort", "not started: interrupted by the operator")

    def _stop(self, end: str, reason: str, *, failed: bool = False) -> None:
        """Note that the flight is over, with a trigger of the mission, and why."""
        self.over, self._end, self.reason, self._failed = True, end, reason, failed

    def _land(self) -> None:
        """Land all agents, and end the mission."""
        self.over = True
        if not self._lands:
            return
        loop = self._running_loop
        interrupted = self._failed and self._end == "abort"
        try:
            reasons = [self.reason, self._landing_fault()]
        except BaseException as error:
            if not interrupted:
                self.reason = f"Python was interrupted: {type(error).__name__}"
                interrupted = True
                self._land_whatever_failed()
            raise
        finally:  # it may be interrupted again
            if interrupted:
                loop.change_phase("abort")
        if interrupted:
            return
        self.reason = "; ".join(filter(None, (*reasons, *loop.finish())))
        if loop.change_phase(self._end) is MissionPhase.COMPLETED and self.reason:
            loop.change_phase("fail")

    def _landing_fault(self) -> str:
        """Land all agents; return what failed, if anything."""
        if self._failed:
            return self._land_whatever_failed()
        try:
            return self._until_over(self._running_loop.land_all(complete=self._end == "complete"))
        except PluginError as error:
            self._observers.event("failure", str(error))
            self._end = "fail"
            return "; ".join(filter(None, (str(error), self._land_whatever_failed())))

    def _land_whatever_failed(self) -> str:
        """Land all agents from their positions; return what failed, if anything."""
        loop = self._running_loop
        try:
            return self._until_over(loop.land_all(complete=False, at_once=True))
        except PluginError:
            loop.stop_locating()  # it may be the localizer that raised
        try:
            return self._until_over(loop.land_all(complete=False, at_once=True))
        except PluginError as error:
            return loop.give_up(error)

    def _until_over(self, now: MissionStatus) -> str:
        """Run ticks until what the loop does is over; return what failed, if anything."""
        while now.status is Status.RUNNING:
            now = self._running_loop.tick()
        return now.reason

    def _release(self) -> None:
        """Close the plugins, and complete the record of a flight that began."""
        wall_time = 0.0 if self._begun is None else time.perf_counter() - self._begun
        self._contexts.close()
        with Progress("closing the links and the record"):
            failures: list[str] = []
            try:
                failures += self._loop.close() if self._loop is not None else ()
                failures += self._pipeline.close()
            finally:  # the operator may interrupt a plugin that hangs
                self._operator.recording = True
                if self._loop is not None and self._begun is not None:
                    for text in failures:
                        self._observers.event("failure", text)
                    if text := leaked_threads(self._before):
                        self._observers.event("plugin", text)
                    summary = self._summary = self._loop.summary(self.reason, wall_time)
                    self._observers.notify("star_mission_ended", summary=deepcopy(summary))
                self._operator.recording = False


def _caller() -> str:
    """Return where the program called: ``file:line:1``."""
    frame = inspect.currentframe()
    while frame is not None and frame.f_globals.get("__name__") == __name__:
        frame = frame.f_back
    return "program:1:1" if frame is None else f"{frame.f_code.co_filename}:{frame.f_lineno}:1"
