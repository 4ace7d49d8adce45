"""The transport ``radio``: a swarm of Crazyflies, each over its own link."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
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
    Supervisor,
    Telemetry,
    Trajectory,
    Truth,
)
from star_radio import commands, orders, report
from star_radio.carried import Carried, misfit
from star_radio.datagrams import Datagrams
from star_radio.link import Link
from star_radio.manner import Manner
from star_radio.quiet import hush
from star_radio.steering import Steering
from star_radio.telemetry import Gatherer
from star_radio.together import faults
from star_radio.vehicle import Vehicle

if TYPE_CHECKING:
    from star_radio.decks import Decks
    from star_radio.mocap import MotionCapture
    from star_radio.shouts import Shouts

log = logging.getLogger(__name__)

ON_ITS_WAY: Final = int(Supervisor.COMMANDER_ACTIVE | Supervisor.COMMANDER_FINISHED)
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

    No call waits for a drone but `connect`, `upload` and `close`: what has to be confirmed is asked
    again in `wait`, and what stays unconfirmed is logged.

    Args:
        scene: Agents, each with the address of its link.
        manner: How drones are to be connected.
        rules: What to do when something is wrong.
        steering: How setpoints are put to them.
        decks: Cameras.
        mocap: Ground truth.
        shouts: Broadcasts.
        datagrams: Where links over UDP are heard; cflib hears them if not given.

    Attributes:
        vehicles: The drone of each row.
    """

    def __init__(
        self,
        scene: Scene,
        manner: Manner,
        rules: Rules,
        steering: Steering,
        *,
        decks: Decks | None = None,
        mocap: MotionCapture | None = None,
        shouts: Shouts | None = None,
        datagrams: Datagrams | None = None,
    ) -> None:
        hush()
        self._scene = scene
        self._manner, self._rules, self._steering = manner, rules, steering
        self._decks, self._mocap, self._shouts = decks, mocap, shouts
        self._datagrams = datagrams
        self.vehicles = tuple(
            Vehicle(agent.name, Link(agent.uri or "", agent.name, datagrams))
            for agent in scene.agents
        )
        self._carried = Carried()
        self._setting_out: set[int] = set()  # rows told to follow, that have not said they do
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
        if self._shouts is not None:
            self._shouts.disband()
        absent = faults(dict(enumerate(self.vehicles)), self._connect)
        self._there[:] = [row not in absent for row in range(len(self.vehicles))]
        if self._decks is not None and (self._rules.without or not absent):
            self._decks.greet(self._manner.patience)
        if not absent:
            return
        count = f"{len(absent)} of {len(self.vehicles)}"
        said = f"cannot reach {count} agents: {'; '.join(absent.values())}"
        if not self._there.any():
            raise PluginError(said)
        if not self._rules.without:
            raise PluginError(
                f"{said}; 'absent: fly-without' flies without them in a mission that has "
                "'safety: {link_lost: {}}'"
            )
        log.warning("radio: %s: flying without", said)

    def upload(self, trajectories: Sequence[Trajectory]) -> None:
        """Upload trajectories to every drone, all drones at the same time.

        Raises:
            PluginError: They do not fit, or drones refuse; the message names every one.
        """
        self._carried = Carried(trajectories)
        present = {row: self.vehicles[row] for row in np.flatnonzero(self._there).tolist()}
        agents = self._scene.agents
        refused = faults(present, lambda row, one: self._carried.upload(one, agents[row].yaw))
        if refused:
            raise PluginError(
                f"cannot upload trajectories to {len(refused)} of {len(present)} agents: "
                f"{'; '.join(refused.values())}"
            )

    def wait(self, until: float) -> float:
        now = time.monotonic()
        if self._began is None:
            self._began = now
        for row in np.flatnonzero(self._there).tolist():
            if row in self._setting_out and self._follows(row):
                self._setting_out.discard(row)
                self.vehicles[row].confirm()  # told again, it would begin again from where it is
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

        A trajectory begins where the drone is when the order comes, and turned as it was uploaded:
        what the drone is off its beginning stays, and its heading's drift.

        Raises:
            ContractError: A trajectory was not uploaded.
        """
        rows = [(i, row) for i, row in enumerate(command.agent.tolist()) if self._there[row]]
        self._setting_out.difference_update(command.agent.tolist())
        if command.trajectory is not None:
            rows = [(i, row) for i, row in rows if self._can_follow(row, float(command.yaw[i]))]
            self._setting_out.update(row for _i, row in rows if not self._follows(row))
        if command.order is Order.ARM:
            for _i, row in rows:
                self.vehicles[row].arm()
            return
        packets = {
            row: commands.packet(command, i, self.vehicles[row].version, self._carried)
            for i, row in rows
        }
        calm = not any(self.vehicles[row].steered for row in packets)
        if self._shouts is not None:
            self._shouts.void(packets)
        for row in packets:
            if command.order is Order.TAKEOFF:
                self.vehicles[row].arm()
            self.vehicles[row].let_go()
        # another dongle may overtake a setpoint, which would cancel what it orders, but not a stop
        loud = calm or command.order is Order.STOP
        shouted = self._shouts.order(packets) if self._shouts and loud else {}
        for row, packet in (packets | shouted).items():
            vehicle = self.vehicles[row]
            vehicle.order(packet, commands.WORDS[command.order], sent=row in shouted)
            if command.order is Order.STOP and self._rules.latch:
                vehicle.lock()

    def correct(self, corrections: Corrections) -> None:
        """Tell estimators where they are, each after the deviations that it is to weigh it with."""
        rows = [(i, row) for i, row in enumerate(corrections.agent.tolist()) if self._there[row]]
        deviations = corrections.position_deviation, corrections.attitude_deviation
        for i, row in rows:
            self.vehicles[row].weigh(*(float(deviation[i]) for deviation in deviations))
        shouted = self._shouts.correct(corrections) if self._shouts else ()
        turned = np.isfinite(corrections.attitude_deviation)
        for i, row in rows:
            if row not in shouted:
                attitude = corrections.attitude[i].tolist() if turned[i] else None
                self.vehicles[row].correct(corrections.position[i].tolist(), attitude)

    def send(self, setpoint: Setpoint) -> Setpoint:
        """Fly the active rows that are there; the answer has no others active.

        Raises:
            ContractError: A velocity or a yaw that should be flown is not finite.
        """
        finite = np.isfinite(setpoint.velocity).all(axis=1) & np.isfinite(setpoint.yaw)
        if not finite[setpoint.active].all():
            rows = np.flatnonzero(setpoint.active & ~finite)
            raise ContractError(f"the setpoint of {self._scene.named(rows)} is not finite")
        active = setpoint.active & self._there
        sent = setpoint
        if active.sum() != setpoint.active.sum():
            sent = Setpoint(setpoint.velocity, setpoint.yaw, active)
        versions = [vehicle.version for vehicle in self.vehicles]
        packets = self._steering.packets(sent, self._gatherer.last, versions)
        if self._shouts is not None:
            self._shouts.void(row for row in packets if not self.vehicles[row].steered)
        for row, packet in packets.items():  # all at once, as nearly as can be
            self.vehicles[row].steer(packet)
        return sent

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

    def _can_follow(self, row: int, yaw: float) -> bool:
        """Whether a trajectory turned by `yaw`, rad, lies as uploaded; if not, it is refused."""
        words = misfit(yaw, self._scene.agents[row].yaw)
        if words:
            log.warning("radio: %s %s", self.vehicles[row].name, words)
            self._refusals.append(Refusal(row, words))
        return not words

    def _follows(self, row: int) -> bool:
        """Whether a drone has reported that its commander is on the way."""
        state = self._gatherer.last[row, report.STATE]
        return not np.isnan(state) and int(state) & ON_ITS_WAY == Supervisor.COMMANDER_ACTIVE

    def _connect(self, row: int, vehicle: Vehicle) -> None:
        """Connect one drone, or leave no link to it open."""
        groups = None if self._shouts is None else self._shouts.masks.get(row)
        try:
            vehicle.connect(self._manner, groups)
        except Exception:
            vehicle.link.close()
            raise
