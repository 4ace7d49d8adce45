"""The transport ``radio``: a swarm of Crazyflies, each over its own link."""

from __future__ import annotations

import logging
import struct
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from star_core import (
    Command,
    ContractError,
    Corrections,
    Frames,
    Order,
    PluginError,
    Refusal,
    Scene,
    Setpoint,
    Telemetry,
    Truth,
)
from star_radio import orders, report
from star_radio.datagrams import Datagrams
from star_radio.heading import yaw_rate
from star_radio.link import Link
from star_radio.quiet import hush
from star_radio.tables import Tables
from star_radio.telemetry import Gatherer
from star_radio.vehicle import Manner, Vehicle

if TYPE_CHECKING:
    from star_radio.decks import Decks
    from star_radio.mocap import MotionCapture
    from star_radio.shouts import Shouts

log = logging.getLogger(__name__)

FEED: Final = 0.2  # s between two packets that keep the emergency-stop watchdog, of 1 s, asleep


class Rules(NamedTuple):
    """What to do when something is wrong.

    Attributes:
        without: Whether to fly without those that are absent.
        latch: Whether a stop locks the drone until it is switched off and on.
        watchdog: Whether drones lock when they hear nothing for 1 s.
    """

    without: bool = False
    latch: bool = False
    watchdog: bool = False


class Radio:
    """Crazyflies over whatever links cflib has drivers for.

    No call waits for a drone but `connect` and `close`: what has to be confirmed is asked again in
    `wait`, and what stays unconfirmed is logged.

    Args:
        scene: Agents, each with the address of its link.
        tables: Of contents, kept from one flight to the next.
        manner: How drones are to be connected.
        rules: What to do when something is wrong.
        decks: Cameras.
        mocap: Ground truth.
        shouts: Broadcasts.
        datagrams: Where links over UDP are heard; cflib hears them if not given.

    Attributes:
        vehicles: The drone of each row, for what no contract has: trajectories, whole states.
    """

    def __init__(
        self,
        scene: Scene,
        tables: Tables,
        manner: Manner,
        rules: Rules,
        *,
        decks: Decks | None = None,
        mocap: MotionCapture | None = None,
        shouts: Shouts | None = None,
        datagrams: Datagrams | None = None,
    ) -> None:
        hush()
        self._scene = scene
        self._tables, self._manner = tables, manner
        self._rules = rules
        self._decks, self._mocap, self._shouts = decks, mocap, shouts
        self._datagrams = datagrams
        self.vehicles = tuple(
            Vehicle(agent.name, Link(agent.uri or "", agent.name, datagrams))
            for agent in scene.agents
        )
        self._there = np.zeros(len(self.vehicles), np.bool_)
        self._refusals: list[Refusal] = []
        self._gatherer = Gatherer(self.vehicles)
        self._began: float | None = None  # s of the computer's clock, at mission time 0
        self._fed = -np.inf  # s, when the watchdog was fed

    def connect(self) -> None:
        """Open every link, all at the same time.

        Raises:
            PluginError: Agents cannot be reached; the message names every one and says why.
        """
        with ThreadPoolExecutor(len(self.vehicles)) as pool:
            faults = list(pool.map(self._connect, self.vehicles))
        self._there[:] = [fault is None for fault in faults]
        absent = [
            f"{vehicle.name} ({fault})"
            for vehicle, fault in zip(self.vehicles, faults, strict=True)
            if fault is not None
        ]
        if not absent:
            return
        said = f"cannot reach {len(absent)} of {len(faults)} agents: {'; '.join(absent)}"
        if not self._rules.without:
            raise PluginError(f"{said}; 'absent: fly-without' flies without them")
        if not self._there.any():
            raise PluginError(said)
        log.warning("radio: %s: flying without", said)

    def wait(self, until: float) -> float:
        now = time.monotonic()
        if self._began is None:
            self._began = now
        for row in np.flatnonzero(self._there).tolist():
            for trouble in self.vehicles[row].chase(now):
                log.warning("radio: %s %s", self.vehicles[row].name, trouble.words)
                if trouble.refused:
                    self._refusals.append(Refusal(row, trouble.words))
        if self._rules.watchdog and now - self._fed >= FEED:
            self._fed = now
            for vehicle in self._present():
                vehicle.link.post(orders.keep_alive(vehicle.version))
        time.sleep(max(0.0, self._began + until - time.monotonic()))
        return time.monotonic() - self._began

    def receive(self) -> Telemetry:
        began = time.monotonic() if self._began is None else self._began
        frames = Frames.none() if self._decks is None else self._decks.frames(began)
        refusals, self._refusals = tuple(self._refusals), []
        return self._gatherer.gather(began, frames, refusals)

    def command(self, command: Command) -> None:
        """Give an order to those that are there, and see to it that it is confirmed.

        Raises:
            ContractError: A duration is not positive, or a target is not finite.
        """
        _check(command)
        rows = [(i, row) for i, row in enumerate(command.agent.tolist()) if self._there[row]]
        if command.order is Order.ARM:
            for _i, row in rows:
                self.vehicles[row].arm()
            return
        packets = {row: _packet(command, i, self.vehicles[row].version) for i, row in rows}
        shouted = self._shouts.order(packets) if self._shouts else ()
        for row, packet in packets.items():
            vehicle = self.vehicles[row]
            if command.order is Order.TAKEOFF:
                vehicle.arm()
            vehicle.order(packet, WORDS[command.order], sent=row in shouted)
            if command.order is Order.STOP and self._rules.latch:
                vehicle.lock()

    def correct(self, corrections: Corrections) -> None:
        """Send poses to estimators, each after the deviations that it is to be weighed with."""
        shouted = self._shouts.correct(corrections) if self._shouts else ()
        for i, row in enumerate(corrections.agent.tolist()):
            if self._there[row]:
                self.vehicles[row].correct(
                    corrections.position[i].tolist(),
                    corrections.attitude[i].tolist(),
                    float(corrections.position_deviation[i]),
                    float(corrections.attitude_deviation[i]),
                    sent=row in shouted,
                )

    def send(self, setpoint: Setpoint) -> Setpoint:
        """Fly the active rows that are there; the answer has no others active.

        A velocity setpoint has no heading but a yaw rate: see `star_radio.heading`.

        Raises:
            ContractError: A velocity or a yaw that should be flown is not finite.
        """
        finite = np.isfinite(setpoint.velocity).all(axis=1) & np.isfinite(setpoint.yaw)
        if not finite[setpoint.active].all():
            rows = np.flatnonzero(setpoint.active & ~finite)
            raise ContractError(f"the setpoint of {self._scene.named(rows)} is not finite")
        active = setpoint.active & self._there
        rates = yaw_rate(setpoint.yaw, self._gatherer.last[:, report.YAW]).tolist()
        velocities = setpoint.velocity.tolist()
        packed = [
            (vehicle, orders.velocity(velocities[row], rates[row], vehicle.version))
            for row, vehicle in enumerate(self.vehicles)
            if active[row]
        ]
        for vehicle, packet in packed:  # all at once, as nearly as can be
            vehicle.steer(packet)
        if active.sum() == setpoint.active.sum():
            return setpoint
        return Setpoint(setpoint.velocity, setpoint.yaw, active)

    def truth(self) -> Truth | None:
        if self._mocap is None or self._began is None:
            return None
        return self._mocap.truth(self._began)

    def close(self) -> None:
        """Let every drone go, all at the same time."""
        with ThreadPoolExecutor(len(self.vehicles)) as pool:
            list(pool.map(Vehicle.close, self.vehicles))
        for part in (self._datagrams, self._decks, self._mocap, self._shouts):
            if part is not None:
                part.close()

    def _present(self) -> list[Vehicle]:
        return [self.vehicles[row] for row in np.flatnonzero(self._there).tolist()]

    def _connect(self, vehicle: Vehicle) -> str | None:
        """Connect one drone; say why it cannot be reached, None if it can."""
        try:
            vehicle.connect(self._tables, self._manner)
        except PluginError as error:
            fault = str(error)
        except (IndexError, struct.error) as error:
            fault = f"{vehicle.link.uri} answers what is no answer: {error}"
        else:
            return None
        vehicle.link.close()
        return fault


WORDS: Final = {
    Order.TAKEOFF: "take off",
    Order.LAND: "land",
    Order.GOTO: "go to a place",
    Order.STOP: "stop",
}


def _packet(command: Command, i: int, version: int) -> bytes:
    """Return the packet of one row of a command."""
    position = command.position[i].tolist()
    duration = float(command.duration[i])
    make: Callable[[], bytes] = {
        Order.TAKEOFF: lambda: orders.takeoff(position[2], duration),
        Order.LAND: lambda: orders.land(position[2], duration),
        Order.GOTO: lambda: orders.go_to(position, float(command.yaw[i]), duration, version),
        Order.STOP: orders.stop,
    }[command.order]
    return make()


def _check(command: Command) -> None:
    if command.order in {Order.ARM, Order.STOP}:
        return
    if not (command.duration > 0).all():
        raise ContractError(f"Command.duration must be positive, got {command.duration!r}")
    turning = command.order is Order.GOTO
    used = command.position if turning else command.position[:, 2]
    if not np.isfinite(used).all():
        raise ContractError(f"Command.position must be finite, got {command.position!r}")
    if turning and not np.isfinite(command.yaw).all():
        raise ContractError(f"Command.yaw must be finite, got {command.yaw!r}")
