"""The transport ``radio``: a swarm of Crazyflies, one link each."""

from __future__ import annotations

import logging
import struct
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from star_core import (
    Command,
    ContractError,
    Corrections,
    Mask,
    Order,
    PluginError,
    Scene,
    Setpoint,
    Supervisor,
    Telemetry,
    Trajectory,
    Truth,
)
from star_core.toolkit import GroundEvidence, Refusal, shortlist
from star_radio import budget, orders, preflight, profiles, report
from star_radio.broadcast import BroadcastCommands
from star_radio.connection import udp_links
from star_radio.connection.cflib_link import silence_cflib
from star_radio.connection.link import Link
from star_radio.connection.tables import Tables, user_cache
from star_radio.handover import WATCHDOG
from star_radio.inspection import Equipment
from star_radio.landings import Landings
from star_radio.options import RadioOptions
from star_radio.sensors import Sensors, connecting
from star_radio.steering import Velocities, WholeStates
from star_radio.takeoffs import Climb, Takeoffs
from star_radio.telemetry import TelemetryBuffer
from star_radio.trajectories import (
    DESCENT_MARGIN,
    TrajectoryMemory,
    come_down_time,
    rotation_error,
)
from star_radio.vehicle import CLOSING_POLL_PERIOD, Vehicle, close_all

log = logging.getLogger(__name__)

COMMANDER_STATES: Final = int(Supervisor.COMMANDER_ACTIVE | Supervisor.COMMANDER_FINISHED)
KEEP_ALIVE_PERIOD: Final = 0.2  # s, between resets of the emergency-stop watchdog, which is 1 s
FALL_TIME: Final = 1.0  # s, after the firmware's watchdog has stopped the motors
UNHEARD_TIME: Final = 10.0  # s, for which closing waits for the link of a drone to return
LANDING_TIME: Final = 30.0  # s, for which it waits for landings


COMMANDS: Final = {
    Order.TAKEOFF: "take off",
    Order.LAND: "land",
    Order.GOTO: "go to a position",
    Order.FOLLOW: "follow a trajectory",
    Order.STOP: "stop",
}


class _OnBoard(NamedTuple):
    """A climb or a trajectory that comes down at its end.

    Attributes:
        lasts: Until its end, s; infinite if it does not come down.
        after: From there to the ground, s.
    """

    lasts: float
    after: float

    @property
    def total(self) -> float:
        """From its start to the ground, s."""
        return self.lasts + self.after


class Radio:
    """Crazyflies over any link that cflib has a driver for.

    Only `connect`, `upload` and `close` block on a drone: packets that need a confirmation are
    repeated in `wait`, and unconfirmed ones are logged.

    Attributes:
        vehicles: The drone of each row.
        connected: (N,) which of them are connected, and did not reboot.
        began: The computer's clock at mission time 0, s; None before the first `wait`.
        progress: Of `connect`.
        landings: Landings in place, without the mission.

    Raises:
        PluginError: The motion-capture system or the dongle for broadcasts is not available.
    """

    def __init__(self, scene: Scene, options: RadioOptions) -> None:
        silence_cflib()
        uris = [agent.uri or "" for agent in scene.agents]
        self._scene, self._options = scene, options
        self._tables = Tables(Path(options.cache) if options.cache else user_cache())
        self._report_period = options.report_period or budget.report_period(uris, options.mode)
        self._sensors = Sensors(scene, options)
        self._broadcasts: BroadcastCommands | None = None
        if options.broadcast is not None:
            self._broadcasts = BroadcastCommands(scene, options.broadcast)
        self._steering: Velocities | WholeStates = Velocities(len(uris), scene.period)
        if options.setpoints == "full-state":
            self._steering = WholeStates(len(uris), scene.period)
        self._udp_links = udp_links.UdpLinks() if options.udp == "sockets" else None
        self.vehicles = tuple(
            Vehicle(agent.name, Link(agent.uri or "", agent.name, self._udp_links))
            for agent in scene.agents
        )
        self._memory = TrajectoryMemory()
        self._takeoffs = Takeoffs(self.vehicles)
        self._on_board: dict[int, _OnBoard] = {}  # what comes down at its end, by row
        self._awaiting_start: set[int] = set()  # rows commanded to follow, not yet reported active
        self.connected = np.zeros(len(self.vehicles), np.bool_)
        self._refusals: list[Refusal] = []
        self._telemetry = TelemetryBuffer(self.vehicles, in_map=scene.reports_in_map)
        self._ground = GroundEvidence(len(self.vehicles))
        self.landings = Landings(self.vehicles, self._ground, self.cancel)
        self.began: float | None = None
        self._kept_alive = -np.inf  # s, last reset of the watchdog
        self.progress = connecting(len(self.vehicles), self.settling)

    def connect(self, *, shown: bool = True) -> None:
        """Open all links in parallel; the progress is `shown` on stderr.

        Raises:
            PluginError: Agents cannot be reached, or cannot fly; the message lists each with its
                reason.
        """
        if self._broadcasts is not None:
            self._broadcasts.clear_groups()
        with self.progress if shown else nullcontext():
            absent = _faults(dict(enumerate(self.vehicles)), self._connect)
        self.connected[:] = True
        self._leave_out(absent, "reach", "agents-unreachable")
        self._leave_out(_faults(self._present(), self._check), "fly", "agents-unfit")
        self._sensors.connect()

    def _leave_out(self, faults: Mapping[int, str], what: str, code: str) -> None:
        """Fly without agents that have faults, by row, if that is allowed and others are left."""
        self.connected[[*faults]] = False
        if not faults:
            return
        text = f"cannot {what} {len(faults)} of {len(self.vehicles)} agents: "
        text += shortlist(faults.values(), "; ")
        if not self.connected.any():
            raise PluginError(text, code)
        if self._options.absent != "fly-without":
            raise PluginError(
                f"{text}; to fly without them, set 'absent: fly-without' in a mission with "
                "'safety: {link_lost: {}}'",
                code,
            )
        log.warning("radio: %s: flying without them", text)

    def _check(self, _row: int, vehicle: Vehicle) -> None:
        """Refuse a drone that cannot fly, by the checks of ``star preflight``."""
        findings = [
            *preflight.fitness(
                vehicle.name,
                Equipment.read(vehicle),
                vehicle.stream.newest.state,
                camera=vehicle.name in self._options.cameras,
                settled=True,  # `connect` has waited for it
                flow_deck=self._scene.flow_deck if self._scene.reports_in_map else None,
            )
        ]
        for finding in findings:
            if finding.severity is preflight.Severity.WARNING:
                text = f"{finding.check}: {finding.text}: {finding.remedy}"
                log.warning("radio: %s: %s", vehicle.name, text)
        if text := preflight.errors(findings):
            vehicle.link.close()
            raise PluginError(text, "agents-unfit")

    def upload(self, trajectories: Sequence[Trajectory]) -> None:
        """Upload trajectories to all drones in parallel.

        Raises:
            PluginError: They do not fit, or drones refuse; the message lists each such drone.
        """
        depth = self._scene.limits.height[1] + DESCENT_MARGIN if self._options.descent else None
        self._memory = TrajectoryMemory(trajectories, depth)
        full = self._memory.size > profiles.AT or len(self._memory) > profiles.NUMBER
        if self._options.descent and (full or self._memory.depth is None):
            log.warning(
                "radio: the trajectories fill the memories of the agents: without a link they "
                "hover after %s until their batteries are empty",
                "take-offs and trajectories" if self._memory.depth is None else "take-offs",
            )
        if full:
            for vehicle in self.vehicles:
                vehicle.take_off_memory = None
        present, agents = self._present(), self._scene.agents
        refused = _faults(
            present, lambda row, vehicle: self._memory.upload(vehicle.upload, agents[row].yaw)
        )
        if refused:
            raise PluginError(
                f"cannot upload trajectories to {len(refused)} of {len(present)} agents: "
                f"{shortlist(refused.values(), '; ')}",
                "refused-request",
            )

    def wait(self, until: float) -> float:
        now = time.monotonic()
        if self.began is None:
            self.began = now
        self._take_off(now)
        for row, vehicle in enumerate(self.vehicles):
            if not (self.connected[row] or vehicle.rebooted):
                continue
            if row in self._awaiting_start:
                self._note_start(row, vehicle, now)
            for failure in vehicle.retry(now):
                log.warning("radio: %s %s", vehicle.name, failure.text)
                if failure.refused:
                    self._refusals.append(Refusal(row, failure.text))
            if vehicle.rebooted and self.connected[row]:
                log.warning("radio: %s rebooted", vehicle.name)
                self.connected[row] = False
        if self._options.watchdog and now - self._kept_alive >= KEEP_ALIVE_PERIOD:
            self._kept_alive = now
            for vehicle in self._present().values():
                vehicle.link.post(orders.keep_alive(vehicle.version))
        time.sleep(max(0.0, self.began + until - time.monotonic()))
        return time.monotonic() - self.began

    def receive(self) -> Telemetry:
        began = time.monotonic() if self.began is None else self.began
        refusals, self._refusals = tuple(self._refusals), []
        telemetry = self._telemetry.gather(began, self._sensors.frames(began), refusals)
        self._ground.observe(time.monotonic(), telemetry)
        return telemetry

    def aloft(self) -> Mask:
        """Return which drones may be in the air, by what was received and sent so far: (N,)."""
        now = time.monotonic()
        fell = np.array([vehicle.rebooted for vehicle in self.vehicles]) & ~self._ground.heard(now)
        last = np.array([vehicle.steered_at for vehicle in self.vehicles])  # also of a landing
        fed = self._ground.assumed_down(now) & (now - last < WATCHDOG + FALL_TIME)
        aloft: Mask = (~self._ground.down(now) | fed) & ~fell
        return aloft

    def heard(self) -> Mask:
        """Return which drones have reported lately: (N,)."""
        return self._ground.heard(time.monotonic())

    def assumed_down(self) -> list[int]:
        """Return the rows of drones that are down although no report shows it."""
        return np.flatnonzero(self._ground.assumed_down(time.monotonic())).tolist()

    def describe(self, rows: Iterable[int]) -> str:
        """Return what is known of drones that may be in the air, for messages."""
        now = time.monotonic()
        names = self._scene.names
        texts = (f"{names[row]} {self._ground.describe(row, now)}" for row in rows)
        return shortlist(texts, "; ")

    def command(self, command: Command) -> None:
        """Send a command to the connected agents and repeat it until it is confirmed.

        A trajectory starts at the drone's position when the command arrives, with the orientation
        it was uploaded with: an initial offset and the heading drift are not corrected.

        Raises:
            ContractError: A trajectory was not uploaded.
        """
        rows = [(i, row) for i, row in enumerate(command.agent.tolist()) if self.connected[row]]
        if command.order is Order.ARM:
            for _i, row in rows:
                self.vehicles[row].arm()
            return
        self.cancel(command.agent.tolist())
        if command.order in {Order.TAKEOFF, Order.GOTO, Order.FOLLOW}:
            self._telemetry.lands_by[command.agent] = np.inf
        if command.trajectory is not None:
            rows = [(i, row) for i, row in rows if self._can_follow(row, float(command.yaw[i]))]
            for i, row in rows:
                self._await_trajectory(row, command.trajectory, float(command.duration[i]))
        packets = {row: self._packet(command, i, self.vehicles[row].version) for i, row in rows}
        now = time.monotonic()
        for i, row in rows:
            until = now + command.duration[i : i + 1]
            self._ground.commanded(now, command.order, np.array([row]), until)
        if command.order is Order.TAKEOFF:
            for row in packets:
                self.vehicles[row].arm()
            if self._options.descent:
                climbs = {row: self._climb(command, i, packets[row]) for i, row in rows}
                self._takeoffs.prepare(climbs, now)
                return
        self._give(command.order, packets)

    def cancel(self, rows: Sequence[int]) -> None:
        """Forget what drones were commanded to fly: a take-off that has not begun does not begin.

        What a drone flies already it goes on flying, until another command takes over.
        """
        self._awaiting_start.difference_update(rows)
        self._takeoffs.drop(rows)
        self._telemetry.over_at[rows] = np.inf

    def _await_trajectory(self, row: int, trajectory: Trajectory, duration: float) -> None:
        """Expect a drone to start a trajectory of `duration`, s."""
        now, after = time.monotonic(), self._memory.descent_time(trajectory, duration)
        flight = _OnBoard(duration if np.isfinite(after) else np.inf, after)
        self._on_board[row] = flight
        self._telemetry.lands_by[row] = now + flight.total
        if self._follows(row):
            self._telemetry.over_at[row] = now + flight.lasts
        else:
            self._awaiting_start.add(row)

    def _note_start(self, row: int, vehicle: Vehicle, now: float) -> None:
        """Note at `now`, s, whether a drone has started what comes down, or may start it yet."""
        if self._follows(row):
            self._awaiting_start.discard(row)
            vehicle.confirm()  # a repeated command would restart it from here
            self._takeoffs.drop([row])
            self._telemetry.over_at[row] = now + self._on_board[row].lasts
        elif vehicle.repeats:
            self._telemetry.lands_by[row] = now + self._on_board[row].total

    def _give(self, order: Order, packets: Mapping[int, bytes]) -> None:
        """Send a command to drones, with the packet of each row."""
        steered = any(self.vehicles[row].steered for row in packets)
        if self._broadcasts is not None:
            self._broadcasts.void(packets)
        # A broadcast, sent by another dongle, may overtake a setpoint, which would then cancel the
        # command; only a stop cannot be cancelled.
        may_broadcast = not steered or order is Order.STOP
        broadcast = self._broadcasts.order(packets) if self._broadcasts and may_broadcast else {}
        for row, packet in {**packets, **broadcast}.items():
            vehicle = self.vehicles[row]
            once = order is Order.TAKEOFF and row in self._awaiting_start
            vehicle.order(packet, COMMANDS[order], sent=row in broadcast, once=once)
            if order is Order.STOP and self._options.stop == "lock":
                vehicle.lock()

    def _climb(self, command: Command, i: int, packet: bytes) -> Climb:
        """Return how row `i` of a take-off is flown."""
        row = int(command.agent[i])
        memory, last = self.vehicles[row].take_off_memory, self._telemetry.last[row]
        state = int(np.nan_to_num(last[report.STATE]))
        if memory is None or state & Supervisor.FLYING:  # it may fly what is in its memory
            return Climb(packet)
        duration = float(command.duration[i])
        rise = float(command.position[i, 2] - last[report.Z])
        self._on_board[row] = _OnBoard(duration, come_down_time(rise + DESCENT_MARGIN))
        return Climb(packet, profiles.profile(rise, float(last[report.YAW]), duration), memory)

    def _take_off(self, now: float) -> None:
        """Start the take-offs that are due at `now`, s, and those that did not start."""
        climbs = self._takeoffs.due(now)
        bounded = {row for row, climb in climbs.items() if climb.profile is not None}
        self._awaiting_start |= bounded
        for row in bounded:
            self._telemetry.lands_by[row] = now + self._on_board[row].total
        starts = {row: profiles.start(self.vehicles[row].version) for row in bounded}
        if climbs:
            packets = {row: starts.get(row, climb.order) for row, climb in climbs.items()}
            self._give(Order.TAKEOFF, packets)
        missed = self._takeoffs.missed(now)
        for row in missed:
            packet = profiles.start(self.vehicles[row].version)
            self.vehicles[row].order(packet, COMMANDS[Order.TAKEOFF], once=True)
        if begun := [*climbs, *missed]:
            until = np.full(len(begun), now)
            self._ground.commanded(now, Order.TAKEOFF, np.array(begun), until)

    def set_parameters(self, rows: Sequence[int], values: Mapping[str, float]) -> None:
        """Set parameters of the connected agents, and repeat that until it is confirmed."""
        faults: dict[str, list[str]] = {}
        for vehicle in (self.vehicles[row] for row in rows if self.connected[row]):
            for name, value in values.items():
                try:
                    vehicle.begin_setting(name, value)
                except PluginError as error:
                    faults.setdefault(error.message, []).append(vehicle.name)
        for text, names in faults.items():
            log.warning("radio: %s: %s", shortlist(names), text)

    def correct(self, corrections: Corrections) -> None:
        """Send pose corrections to the estimators, preceded by changed standard deviations."""
        rows = [(i, row) for i, row in enumerate(corrections.agent.tolist()) if self.connected[row]]
        deviations = corrections.position_deviation, corrections.attitude_deviation
        for i, row in rows:
            self.vehicles[row].set_noise(*(float(deviation[i]) for deviation in deviations))
        broadcast = self._broadcasts.correct(corrections) if self._broadcasts else ()
        has_attitude = np.isfinite(corrections.attitude_deviation)
        for i, row in rows:
            if row not in broadcast:
                attitude = corrections.attitude[i].tolist() if has_attitude[i] else None
                self.vehicles[row].correct(corrections.position[i].tolist(), attitude)

    def send(self, setpoint: Setpoint) -> Setpoint:
        """Send the active rows that are connected; only these are active in the return value."""
        finite = np.isfinite(setpoint.velocity).all(axis=1) & np.isfinite(setpoint.yaw)
        if not finite[setpoint.active].all():
            rows = np.flatnonzero(setpoint.active & ~finite)
            raise ContractError(f"the setpoint of {self._scene.named(rows)} is not finite")
        active = setpoint.active & self.connected
        sent = setpoint
        if active.sum() != setpoint.active.sum():
            sent = replace(setpoint, active=active)
        versions = [vehicle.version for vehicle in self.vehicles]
        packets = self._steering.packets(sent, self._telemetry.last, versions)
        if self._broadcasts is not None:
            self._broadcasts.void(row for row in packets if not self.vehicles[row].steered)
        for row, packet in packets.items():  # in quick succession
            self.vehicles[row].steer(packet)
        self._ground.steered(time.monotonic(), active)
        return sent

    def truth(self) -> Truth | None:
        return None if self.began is None else self._sensors.truth(self.began)

    def close(self) -> None:
        """Land flying drones, end the reports and close the links, all drones in parallel.

        Without a guardian, which does that otherwise, it waits until they are down: at most
        `LANDING_TIME`, and `UNHEARD_TIME` for drones that are not heard.
        """
        self.cancel(range(len(self.vehicles)))
        try:
            for row, vehicle in enumerate(self.vehicles):
                if vehicle.airborne and not vehicle.lands:
                    self.landings.land(row, float(self._telemetry.last[row, report.Z]))
            close_all(self.vehicles, Vehicle.begin_closing)
            if not self._options.guardian:
                self._await_landings()
        finally:
            self._close()

    def _await_landings(self) -> None:
        """Command landings again until all drones are down, or for too long."""
        began, warned = time.monotonic(), False
        while (aloft := self.aloft()).any():
            passed, heard = time.monotonic() - began, self.heard()
            lost, rows = not (aloft & heard).any(), np.flatnonzero(aloft).tolist()
            limit = min(UNHEARD_TIME if lost else LANDING_TIME, self._options.landing_timeout)
            if passed >= limit:
                log.warning("radio: no longer commanded to land: %s", self.describe(rows))
                return
            if lost and not warned:
                warned = True
                names = self._scene.named(rows)
                log.warning("radio: %s may be in the air: landing for %g s", names, limit)
            self.wait(0.0)
            self.landings.repeat(self.receive(), aloft)
            time.sleep(CLOSING_POLL_PERIOD)

    def _close(self) -> None:
        """End the reports and close the links."""
        close_all(self.vehicles, Vehicle.end_reports)
        with ThreadPoolExecutor(len(self.vehicles)) as pool:
            list(pool.map(Link.close, [vehicle.link for vehicle in self.vehicles]))
        for resource in (self._udp_links, self._sensors, self._broadcasts):
            if resource is not None:
                resource.close()

    def _present(self) -> dict[int, Vehicle]:
        """Return the connected drones by row."""
        return {row: self.vehicles[row] for row in np.flatnonzero(self.connected).tolist()}

    def _packet(self, command: Command, i: int, version: int) -> bytes:
        """Return the packet of row `i` of a command."""
        position, yaw = command.position[i].tolist(), float(command.yaw[i])
        duration = float(command.duration[i])
        match command.order:
            case Order.TAKEOFF:
                return orders.takeoff(position[2], duration)
            case Order.LAND:
                return orders.land(position[2], duration)
            case Order.GOTO:
                return orders.go_to(position, yaw, duration, version)
            case Order.FOLLOW:
                return self._memory.start(command.trajectory, duration, version)
            case _:
                return orders.stop()

    def _can_follow(self, row: int, yaw: float) -> bool:
        """Whether a trajectory turned by `yaw`, rad, matches the uploaded one; else refuse it."""
        text = rotation_error(yaw, self._scene.agents[row].yaw)
        if text:
            log.warning("radio: %s %s", self.vehicles[row].name, text)
            self._refusals.append(Refusal(row, text))
        return not text

    def _follows(self, row: int) -> bool:
        """Whether a drone has reported that its high-level commander is active."""
        state = self._telemetry.last[row, report.STATE]
        return not np.isnan(state) and int(state) & COMMANDER_STATES == Supervisor.COMMANDER_ACTIVE

    def settling(self) -> str:
        """Return whose estimators `connect` waits for."""
        names = [vehicle.name for vehicle in self.vehicles if vehicle.settling]
        return f"waiting for estimators to settle: {shortlist(names)}" if names else ""

    def _connect(self, row: int, vehicle: Vehicle) -> None:
        """Connect one drone; close its link on failure."""
        masks = {} if self._broadcasts is None else self._broadcasts.masks
        try:
            vehicle.connect(
                self._options,
                self._tables,
                self._report_period,
                masks.get(row, orders.MISSION),
                in_map=self._scene.reports_in_map,
            )
        except Exception:
            vehicle.link.close()
            raise
        self.progress.done += 1


def _faults(
    vehicles: Mapping[int, Vehicle], act: Callable[[int, Vehicle], object]
) -> dict[int, str]:
    """Run a function for many drones in parallel; return failures by row: ``name (reason)``."""

    def fault(row: int) -> str | None:
        vehicle = vehicles[row]
        try:
            act(row, vehicle)
        except PluginError as error:
            return f"{vehicle.name} ({error})"
        except (IndexError, struct.error) as error:
            return f"{vehicle.name} ({vehicle.link.uri} sent an invalid answer: {error})"
        return None

    with ThreadPoolExecutor(len(vehicles)) as pool:
        results = pool.map(fault, vehicles)
        return {row: why for row, why in zip(vehicles, results, strict=True) if why is not None}
