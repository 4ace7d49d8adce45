"""Wraps the plugins of a flight with their faults, and reports the faults as events."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Generator, Iterable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from star_core import Flight, Operator, PluginError, Scene, World, hookimpl
from star_core.toolkit import Fault, InjectsFaults
from star_faults.links import ReportFaults, SendFaults
from star_faults.outputs import OutputFaults

SIMULATED: Final = ("motor", "battery", "flow", "gyro", "ranger", "positioning")
"""Components inside of drones, and what measures them: the transport simulates their faults."""

METHODS: Final = {"localizer": "locate", "planner": "plan", "avoider": "avoid", "task": "step"}

_STREAM: Final = 4302

Offers = Generator[None, Iterable[Iterable[Any]], list[list[Any]]]


class FaultInjector:
    """Injects faults into one flight: register it as a plugin, before the flight.

    It wraps the plugins as they are made; a plugin without a fault is not wrapped.

    Args:
        file: The fault file, which is copied into the record.
    """

    def __init__(self, scene: Scene, faults: Sequence[Fault], file: bytes = b"") -> None:
        self._scene = scene
        self.faults = faults
        self._file = file
        self._randoms = [
            np.random.default_rng([scene.seed, _STREAM, fault.number]) for fault in faults
        ]
        self._now = 0.0
        self._active: list[tuple[int, ...]] = [()] * len(faults)
        self._report = Operator().report

    @hookimpl
    def star_mission_started(self, flight: Flight, operator: Operator) -> None:
        self._report = operator.report
        if flight.folder is not None:
            flight.folder.mkdir(parents=True, exist_ok=True)
            (flight.folder / "faults.yaml").write_bytes(self._file)

    @hookimpl(wrapper=True)
    def star_transports(self) -> Offers:
        return (yield from self._wrapped("transport"))

    @hookimpl(wrapper=True)
    def star_localizers(self) -> Offers:
        return (yield from self._wrapped("localizer"))

    @hookimpl(wrapper=True)
    def star_planners(self) -> Offers:
        return (yield from self._wrapped("planner"))

    @hookimpl(wrapper=True)
    def star_avoiders(self) -> Offers:
        return (yield from self._wrapped("avoider"))

    @hookimpl(wrapper=True)
    def star_tasks(self) -> Offers:
        return (yield from self._wrapped("task"))

    def _wrapped(self, kind: str) -> Offers:
        offers = yield
        if kind != "transport" and not self._of("plugin", plugin=kind):
            return [list(group) for group in offers]
        return [[self._with_faults(kind, offer) for offer in group] for group in offers]

    def _with_faults(self, kind: str, offer: Any) -> Any:
        def make(scene: Scene, *arguments: Any, **options: Any) -> Any:
            if kind != "transport":
                plugin = offer.make(scene, *arguments, **options)
                self._spoil_calls(plugin, METHODS[kind], kind)
                return plugin
            world = self._world(scene.world)
            transport = offer.make(replace(scene, world=world), *arguments, **options)
            self._spoil_transport(transport, offer.name)
            return transport

        return replace(offer, make=make)

    def _of(self, *components: str, **values: str) -> list[tuple[Fault, np.random.Generator]]:
        """Return the faults of some components, with their random numbers."""
        return [
            (fault, random)
            for fault, random in zip(self.faults, self._randoms, strict=True)
            if fault.component in components
            and all(fault.values[key] == value for key, value in values.items())
        ]

    def _spoil_calls(self, plugin: Any, method: str, kind: str) -> None:
        """Replace a method of a plugin by one with faults."""
        right = getattr(plugin, method)
        for fault, random in self._of("plugin", plugin=kind):
            right = OutputFaults(fault, random, right, lambda: self._now)
        setattr(plugin, method, right)

    def _spoil_transport(self, transport: Any, name: str) -> None:
        """Replace the methods of a transport by ones with faults."""
        inner = [fault for fault, _ in self._of(*SIMULATED) if not _only_reported(fault)]
        if inner and not isinstance(transport, InjectsFaults):
            failing = ", ".join(sorted({fault.component for fault in inner}))
            raise PluginError(f"transport {name!r} simulates no faults of {failing}")
        if self._of("firmware"):
            raise PluginError("only `star fleet` simulates faults of firmware")
        if inner:
            transport.inject(inner)
        reports = [ReportFaults(*target, self._scene) for target in self._of("telemetry", "link")]
        reports += [ReportFaults(*target, self._scene) for target in self._of("battery", "camera")]
        sends = [SendFaults(*target, self._scene) for target in self._of("link")]
        self._spoil_calls(transport, "receive", "transport")
        wait, receive = transport.wait, transport.receive

        def waited(until: float) -> float:
            self._now = wait(until)
            for fault in sends:
                fault.deliver(self._now)
            return self._now

        def received() -> Any:
            self._begin_and_end()
            telemetry = receive()
            for fault in reports:
                telemetry = fault.report(telemetry, self._now)
            return telemetry

        transport.wait, transport.receive = waited, received
        for fault in sends:
            transport.send, transport.command = fault.wrap(transport.send, transport.command)

    def _begin_and_end(self) -> None:
        """Report which faults begin and end, and stop the program if that is one."""
        for number, fault in enumerate(self.faults):
            rows = fault.rows(self._now)
            begun = [row for row in rows if row not in self._active[number]]
            ended = [row for row in self._active[number] if row not in rows]
            self._active[number] = rows
            for changed, state in ((begun, fault.mode), (ended, "ok")):
                if changed:
                    self._announce(fault, changed, state)
            if fault.component == "ground_program" and rows:
                _disturb(fault, first=bool(begun))

    def _announce(self, fault: Fault, rows: Sequence[int], state: str) -> None:
        names = [self._scene.names[row] for row in rows]
        general = fault.component in {"tags", "ground_program"} or len(rows) == len(
            self._scene.agents
        )
        kind = fault.values.get("plugin", "") if fault.component == "plugin" else ""
        agents = "" if general else f" of {self._scene.named(rows)}"
        text = f"fault: {fault.component} {kind}".rstrip() + f"{agents}: {state}"
        details = {"component": fault.component, "mode": state, "agents": names}
        self._report("fault", text, names[0] if len(names) == 1 else None, details)

    def _world(self, world: World) -> World:
        """Return the world that the transport simulates: its landmarks need not be on the map."""
        landmarks = world.landmarks
        for fault, _ in self._of("tags"):
            places = {tag.of: np.array(tag.position) for tag in reversed(landmarks)}
            names = fault.values.get("tags") or list(places)
            if fault.mode == "off":
                landmarks = tuple(tag for tag in landmarks if tag.of not in names)
                continue
            moves = {name: np.array(fault.values["offset"]) for name in names}
            if fault.values["swap"]:
                following = zip(names, [*names[1:], names[0]], strict=True)
                moves = {name: places[other] - places[name] for name, other in following}
            landmarks = tuple(
                replace(tag, position=tuple(np.add(tag.position, moves.get(tag.of, 0.0)).tolist()))
                for tag in landmarks
            )
        return replace(world, landmarks=landmarks)


def _only_reported(fault: Fault) -> bool:
    """Whether a fault changes the reports of a drone, not the drone."""
    return fault.component == "battery" and "charge" not in fault.values


def _disturb(fault: Fault, *, first: bool) -> None:
    """Kill, stop or stall this program."""
    if fault.mode == "off":
        os.kill(os.getpid(), signal.SIGKILL)
    elif fault.mode == "stuck":
        os.kill(os.getpid(), signal.SIGSTOP)
    elif fault.mode == "slow" or first:
        time.sleep(fault.values["delay"])
