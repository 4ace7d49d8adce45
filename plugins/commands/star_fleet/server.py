"""The fleet: all drones of a scene in one simulation, each with its own UDP port."""

from __future__ import annotations

import contextlib
import selectors
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, Final, Self, TypeAlias

import numpy as np

from star_core import Agent, Frames, Image, InputError, PoseFixes, Scene
from star_core.toolkit import Fault
from star_fleet.conditions import NONE, Condition, Conditions, prepare, with_receivers
from star_fleet.craft import Craft
from star_fleet.decks import AI_DECK, Deck, Equipment
from star_fleet.link_faults import NO_FAULTS, Direction, FaultyLinks
from star_fleet.memory import geometries
from star_fleet.ports import Client, Ports
from star_fleet.ranger import ZONES, Ranger, seen_along
from star_fleet.supervisor import PERIOD
from star_fleet.variables import Readings
from star_fleet.vehicle import LINK_TIMEOUT, Vehicle
from star_sim.airframe import CYCLE
from star_sim.transport import Simulator

PORT: Final = 19850  # where clients look first
ADDRESS: Final = 0xE7E7E7E700  # of the radio of the vehicle in row -1
MAX_LATE: Final = 0.25  # s, that are caught up with; of more the clock lets go
BOOT_TIME: Final = 1.0  # s
BOOT: Final = range(3)  # updates of a supervisor until a vehicle that stands well is ready to fly
DRAIN: Final = 0.5  # s, after which unread packets are discarded

SIMULATED: Final = ("motor", "battery", "flow", "gyro", "ranger", "positioning")
INJECTED: Final = (*SIMULATED, "link", "firmware")
"""Components of the faults that `Fleet.inject` takes."""

_SUPERVISE: Final = round(PERIOD / CYCLE)
_DRAIN: Final = round(DRAIN / CYCLE)


Capture: TypeAlias = Callable[[PoseFixes, float], object]
"""Receives what the positioning system has measured, in each cycle, and the time, s."""

Watcher: TypeAlias = tuple[Callable[[Image, float], object], Callable[[], bool]]
"""Receives an image and the time of its exposure, s; and whether it needs images."""


class Fleet:
    """Serves the drones of a scene as CRTP over UDP, in real time.

    Each agent has the port `port` plus its row, or a free one if `port` is 0. Its stream is sent to
    the client of the last received packet; it ends `link_timeout` after the last packet of any.

    ``with Fleet(scene) as fleet:`` serves in a thread of its own.

    Args:
        scene: Agents, world and seed.
        host: Address to serve at.
        port: Of the first agent.
        speed: Simulated seconds per second.
        arms_itself: Whether vehicles arm themselves, as those with brushed motors do.
        feed_forward: Whether a vehicle that follows a plan or holds a position uses the velocity
            and acceleration of its reference; the controller ``pid`` never does.
        link_timeout: Time without a packet after which a vehicle deletes its log blocks, as the
            firmware does by its radio, s of the client's clock: simulated time divided by `speed`.
            Infinite for none; a link over TCP has none.
        conditions: Conditions of drones before the flight, by row; they last.
        decks: Decks that all drones carry beside those of the mission.
        simulator: Further arguments of `Simulator`. A controller ``pid`` or ``mellinger`` flies
            until a client sets the parameter ``stabilizer.controller``. Delay and loss of the
            profile's radio link have no effect: see `links`.

    Attributes:
        simulator: What flies; the truth is there.
        links: The UDP links; ``links.faults[row]``, which hold in both directions, may be replaced
            at any time. A delay is rounded up to whole cycles of 10 ms.
        vehicles: The firmware of each row.

    Raises:
        PluginError: A port is not available; it is named.
    """

    def __init__(  # noqa: PLR0913
        self,
        scene: Scene,
        *,
        host: str = "127.0.0.1",
        port: int = PORT,
        speed: float = 1.0,
        arms_itself: bool = True,
        feed_forward: bool = True,
        link_timeout: float = LINK_TIMEOUT,
        conditions: Conditions = MappingProxyType({}),
        decks: Sequence[Deck] = (),
        **simulator: Any,
    ) -> None:
        self.simulator = Simulator(scene, **simulator, needs_images=self.watched)
        if self.simulator.cascades is not None:  # a client may select Mellinger's in flight
            self.simulator.leads = np.zeros((len(scene.agents), 3))
        if not feed_forward:
            self.simulator.drones["feed_forward"] = 0.0
        self._agents, self._arms_itself = scene.agents, arms_itself
        self._decks, self._stations = decks, geometries(scene.world)
        self._ranger = Ranger(scene.world)
        self._link_timeout = link_timeout * speed  # s, simulated
        self._speed = speed
        self._conditions = with_receivers(conditions, scene)
        prepare(self.simulator.drones, conditions)
        self.vehicles = [self._started(row) for row in range(len(scene.agents))]
        self._boots_until = np.zeros(len(scene.agents))  # s
        self.links = FaultyLinks(len(scene.agents), scene.seed)
        self.slipped = 0.0
        """Seconds that the simulation has fallen behind real time, on a slow machine."""
        self.busy = 0.0
        """Seconds spent other than waiting for packets or time."""
        self._faults: list[Fault] = []
        self._watchers: dict[int, list[Watcher]] = {}
        self._captures: list[Capture] = []
        self._saw = False
        self._cycle = 0
        self._info = np.zeros(len(scene.agents), np.int64)
        self._lock = threading.RLock()
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        self._streams: list[list[Callable[[bytes], object]]] = [[] for _ in scene.agents]
        try:
            self._ports = Ports(scene, host, port)
        except BaseException:
            self.simulator.close()
            raise
        self.simulator.connect()
        for _ in BOOT:
            self._supervise(0.0)

    @property
    def addresses(self) -> list[str]:
        """Address of each agent, as the ``uri`` in a mission."""
        return self._ports.addresses

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.simulator.time

    def handle(self, row: int, packet: bytes, *, tcp: bool = False) -> list[bytes]:
        """Give a packet to the vehicle in a row, from any thread, and return its answers.

        Args:
            row: Of the vehicle.
            packet: CRTP packet; a null packet, too, keeps the link alive.
            tcp: Whether it came over TCP, where a link has no timeout.
        """
        with self._lock:
            if self.simulator.time < self._boots_until[row]:
                return []
            return self.vehicles[row].handle(packet, self.simulator.time, tcp=tcp)

    def inject(self, faults: Sequence[Fault]) -> None:
        """Inject faults of drones, links and firmware; their times are simulated ones.

        Raises:
            InputError: A fault is of another kind.
        """
        for fault in faults:
            only_reported = fault.component == "battery" and "charge" not in fault.values
            slow = fault.component == "link" and fault.mode == "slow"
            if fault.component not in INJECTED or only_reported or slow:
                text = f"star fleet simulates no fault {fault.mode!r} of {fault.component!r}"
                raise InputError(text, "invalid-option")
        self._faults = [fault for fault in faults if fault.component not in SIMULATED]
        self.simulator.inject([fault for fault in faults if fault.component in SIMULATED])

    def _apply_faults(self, now: float) -> None:
        """Set the faults of the links, and reboot vehicles whose time has come."""
        links = [NO_FAULTS] * len(self.vehicles)
        for fault in self._faults:
            rows = fault.rows(now)
            if fault.component == "link":
                for row in rows:
                    links[row] = links[row].with_fault(fault)
            elif rows:
                self._faults.remove(fault)
                for row in rows:
                    self.reboot(row)
                break  # the others come in the next cycle
        self.links.faults[:] = links

    def reboot(self, row: int) -> None:
        """Restart a vehicle's firmware, from any thread, as a brownout in flight does.

        Its motors stop, its log blocks, parameters and trajectories are gone, its clock and its
        estimator begin anew, and it answers nothing for `BOOT_TIME`.
        """
        with self._lock:
            self._boots_until[row] = self.simulator.time + BOOT_TIME
            self.vehicles[row] = self._started(row)
            Craft(self.simulator, row).restart()

    def listen(self, row: int, send: Callable[[bytes], object]) -> None:
        """Call `send` with every packet that a vehicle streams, in addition to its UDP client."""
        self._streams[row].append(send)

    def watch(
        self, row: int, show: Callable[[Image, float], object], enabled: Callable[[], bool]
    ) -> None:
        """Call `show` with every image of a vehicle's camera and the time of its exposure, s.

        No images are rendered while `enabled` returns false.
        """
        with self._lock:
            self._watchers.setdefault(row, []).append((show, enabled))

    def capture(self, receive: Capture) -> None:
        """Call `receive` in each cycle with what the simulator's positioning system measured."""
        with self._lock:
            self._captures.append(receive)

    def watched(self, row: int) -> bool:
        """Whether the images of a vehicle's camera are needed."""
        return any(enabled() for _, enabled in self._watchers.get(row, ()))

    def advance(self) -> None:
        """Advance by one cycle of 10 ms."""
        with self._lock:
            if self._faults:
                self._apply_faults(self.simulator.time)
            self.simulator.wait((self._cycle + 1) * CYCLE)
            self._cycle += 1
            now = self.simulator.time
            if self._cycle % _SUPERVISE == 0:
                self._supervise(now)
            readings = Readings(
                self.simulator, self._info, self.vehicles, self._ranger, self._conditions
            )
            streamed = [vehicle.advance(readings, now) for vehicle in self.vehicles]
            self._measure(now)
            saw, self._saw = self._saw, any(map(self.watched, self._watchers))
            frames = Frames.none()
            if self._saw or self._cycle % _DRAIN == 0:
                heard = self.simulator.receive().frames
                frames = heard if saw else frames  # converted to the time of the receiver
        for row, packets in enumerate(streamed):
            if packets:
                self._stream(row, packets)
        self.links.deliver(self.simulator.time)
        for row, taken, image in zip(
            frames.agent.tolist(), frames.taken.tolist(), frames.image, strict=True
        ):
            conditions = self._conditions.get(row, NONE)
            if Condition.NO_IMAGES in conditions:
                continue
            shown = np.zeros_like(image) if Condition.DARK_IMAGES in conditions else image
            for show, _ in self._watchers.get(row, ()):
                show(shown, taken)

    def _measure(self, now: float) -> None:
        """Pass on what the positioning system has measured."""
        fixes = self.simulator.fixes() if self._captures else PoseFixes.none()
        for receive in self._captures:
            receive(fixes, now)

    def serve(self, until: float | None = None) -> None:
        """Answer packets and let time pass, until `until`, s of simulated time, or `stop`."""
        with selectors.DefaultSelector() as selector:
            for row, each in enumerate(self._ports.sockets):
                selector.register(each, selectors.EVENT_READ, row)
            began = time.monotonic() - self.simulator.time / self._speed
            woke = time.monotonic()
            while not self._stopped.is_set() and (until is None or self.simulator.time < until):
                behind = woke - began - self.simulator.time / self._speed
                if behind > MAX_LATE:
                    began += behind
                    self.slipped += behind
                elif behind * self._speed >= CYCLE:
                    self.advance()
                due = began + (self.simulator.time + CYCLE) / self._speed
                slept = time.monotonic()
                ready = selector.select(max(0.0, due - slept))
                self.busy += slept - woke
                woke = time.monotonic()
                for key, _ in ready:
                    self._receive(key.data)

    def stop(self) -> None:
        """End `serve`, from any thread."""
        self._stopped.set()

    def close(self) -> None:
        """Stop serving and close the ports. Safe to call twice."""
        self.stop()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        self._ports.close()
        self.simulator.close()

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self.serve, name="fleet", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def _started(self, row: int) -> Vehicle:
        """Return the firmware of an agent's vehicle as it is after a boot."""
        agent, conditions = self._agents[row], self._conditions.get(row, NONE)
        has_camera = agent.camera is not None and Condition.NO_AI_DECK not in conditions
        decks = [*self._decks, AI_DECK] if has_camera else self._decks
        return Vehicle(
            Craft(self.simulator, row),
            row,
            address(agent, row),
            arms_itself=self._arms_itself,
            booted=self.simulator.time,
            link_timeout=self._link_timeout,
            conditions=conditions,
            equipment=Equipment(decks, self._stations, partial(self._zones, row)),
        )

    def _zones(self, row: int) -> list[int]:
        drone = self.simulator.drones[row]
        return [int(each) for each in seen_along(self._ranger, drone, ZONES)]

    def _supervise(self, now: float) -> None:
        drones = self.simulator.drones
        columns = (
            drones["tumbled"].tolist(),
            drones["crashed"].tolist(),
            (now - drones["motors_time"]).tolist(),
        )
        conditions = zip(self.vehicles, *columns, strict=True)
        for row, (vehicle, tumbled, crashed, resting) in enumerate(conditions):
            vehicle.supervise(now, tumbled=tumbled != 0, crashed=crashed != 0, resting=resting)
            self._info[row] = vehicle.info

    def _receive(self, row: int) -> None:
        """Take one packet from the port of a row."""
        for packet, client in self._ports.receive(row):
            self.links.send(
                row,
                Direction.TO_VEHICLE,
                self.simulator.time,
                partial(self._answer, row, packet, client),
            )

    def _answer(self, row: int, packet: bytes, client: Client) -> None:
        for answer in self.handle(row, packet):
            self._send(row, answer, client)

    def _stream(self, row: int, packets: list[bytes]) -> None:
        for send in self._streams[row]:
            for packet in packets:
                send(packet)
        if (client := self._ports.client(row)) is not None:
            for packet in packets:
                self._send(row, packet, client)

    def _send(self, row: int, packet: bytes, client: Client) -> None:
        deliver = partial(self._ports.send, row, packet, client)
        self.links.send(row, Direction.TO_CLIENT, self.simulator.time, deliver)


def address(agent: Agent, row: int) -> int:
    """Return an agent's address on the radio: that of its ``radio://`` URI, or one by its row."""
    last = (agent.uri or "").partition("?")[0].rpartition("/")[2]
    if (agent.uri or "").startswith("radio://") and len(last) == 10:  # noqa: PLR2004 -- hex digits
        with contextlib.suppress(ValueError):
            return int(last, 16)
    return ADDRESS + row + 1
