"""How many simulated Crazyflies one process serves in real time.

``python benchmarks/fleet.py`` prints a table, with ``--json`` one JSON object. The fleet runs in
this process; all clients run in another one: plain UDP sockets that download both tables of
contents, have log blocks streamed, take off, and send a velocity setpoint 20 times and an echo 10
times a second. ``load`` is the share of the time in which the fleet's loop did not wait, and holds
what else the machine did; ``cpu`` is the processor time of this process over the clock's. There is
no peer: real time is what it is measured against.
"""

from __future__ import annotations

import math
import multiprocessing
import selectors
import socket
import statistics
import struct
import time
from multiprocessing.connection import Connection
from typing import Any

from printed import command_line, show
from sim import grid

from star_fleet.packet import Port, join
from star_fleet.server import Fleet
from star_fleet.variables import VARIABLES
from star_sim import ideal_world

FLIGHT = 12.0  # s
FLEETS = ((10, 1), (30, 10), (30, 1), (100, 10))  # drones, and period of their logs in 10 ms
ALOFT = 0.4  # m
BLOCKS = (
    (
        "stateEstimate.x",
        "stateEstimate.y",
        "stateEstimate.z",
        "stateEstimate.vx",
        "stateEstimate.vy",
    ),
    ("stateEstimate.vz", "stateEstimate.yaw", "gyro.z", "pm.vbat", "supervisor.info"),
)
NUMBER = {entry.name: i for i, entry in enumerate(VARIABLES)}


class Clients:
    """All clients, one after the other: what one does is too little to need a thread."""

    def __init__(self, addresses: list[str], log_period: int) -> None:
        self._log_period = log_period  # 10 ms
        self._selector = selectors.DefaultSelector()
        self._sockets = []
        self.samples = 0
        self.waits: list[float] = []  # s, of the echoes
        for uri in addresses:
            host, _, port = uri.removeprefix("udp://").rpartition(":")
            client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            client.connect((host, int(port)))
            client.settimeout(5.0)
            self._sockets.append(client)
            self._selector.register(client, selectors.EVENT_READ)

    def connect(self) -> None:
        """Download the tables, and start the log blocks."""
        for each in self._sockets:
            ask(each, join(Port.LINK, 1, b"\0"))
            ask(each, join(Port.PLATFORM, 1, b"\0"))
            for port in (Port.LOG, Port.PARAMETERS):
                (count,) = struct.unpack_from("<H", ask(each, join(port, 0, b"\x03")), 2)
                for i in range(count):
                    ask(each, join(port, 0, struct.pack("<BH", 2, i)))
        for each in self._sockets:
            for number, names in enumerate(BLOCKS):
                variables = b"".join(
                    struct.pack("<BH", VARIABLES[NUMBER[name]].code, NUMBER[name]) for name in names
                )
                ask(each, join(Port.LOG, 1, bytes([6, number]) + variables))
                ask(each, join(Port.LOG, 1, bytes([3, number, self._log_period])))

    def fly(self, seconds: float) -> None:
        """Take off, and fly in circles."""
        for each in self._sockets:
            each.settimeout(0)
            each.send(join(Port.HIGH_LEVEL, 0, struct.pack("<BBff?f", 7, 0, 0.8, 0.0, 1, 1.5)))
        self._hear(2.0)
        self.samples = 0
        began = time.monotonic()
        for tick in range(round(seconds * 20)):
            angle = tick / 20
            setpoint = struct.pack("<Bffff", 8, 0.3 * math.cos(angle), 0.3 * math.sin(angle), 0, 0)
            for each in self._sockets:
                each.send(join(Port.SETPOINT, 0, setpoint))
                if tick % 2 == 0:
                    each.send(join(Port.LINK, 0, struct.pack("<Bd", 0, time.monotonic())))
            self._hear(began + (tick + 1) / 20 - time.monotonic())

    def _hear(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0:
            for key, _ in self._selector.select(remaining):
                packet = key.fileobj.recv(64)  # type: ignore[union-attr]
                if packet[0] == Port.LOG << 4 | 2:
                    self.samples += 1
                elif packet[0] == Port.LINK << 4:
                    (sent,) = struct.unpack_from("<d", packet, 2)
                    self.waits.append(time.monotonic() - sent)


def ask(client: socket.socket, packet: bytes) -> bytes:
    """Send a packet and return the answer to it, whatever else comes."""
    client.send(packet)
    while (answer := client.recv(64))[0] & 0xF3 != packet[0] & 0xF3:
        pass
    return answer


def run_clients(pipe: Connection, addresses: list[str], log_period: int) -> None:
    """Connect, say so, fly, and say what was heard."""
    clients = Clients(addresses, log_period)
    began = time.monotonic()
    clients.connect()
    pipe.send(time.monotonic() - began)
    clients.fly(FLIGHT)
    pipe.send((clients.samples, clients.waits))


def load(n: int, log_period: int) -> dict[str, float]:
    """Figures of `n` vehicles with two log blocks each at a period in 10 ms."""
    ours, theirs = multiprocessing.Pipe()
    with Fleet(grid(n, 1.0), port=0, **ideal_world(speed=1.0)) as fleet:
        run = multiprocessing.get_context("spawn").Process(
            target=run_clients, args=(theirs, fleet.addresses, log_period)
        )
        run.start()
        connected = ours.recv()
        time.sleep(3.0)  # they take off
        busy, slipped, cpu = fleet.busy, fleet.slipped, time.process_time()
        began = time.monotonic()
        samples, waits = ours.recv()
        passed = time.monotonic() - began
        busy, slipped = fleet.busy - busy, fleet.slipped - slipped
        cpu = time.process_time() - cpu
        run.join()
        aloft = int((fleet.simulator.drones["position"][:, 2] > ALOFT).sum())
    name = f"n{n}_log{100 // log_period}hz"
    return {
        f"connect_s_{name}": connected,
        f"load_{name}": busy / passed,
        f"cpu_{name}": cpu / passed,
        f"clock_slipped_s_{name}": slipped,
        f"flying_{name}": aloft,
        f"samples_of_expected_{name}": samples / (2 * n * 100 / log_period * FLIGHT),
        f"echo_ms_median_{name}": 1e3 * statistics.median(waits),
        f"echo_ms_p99_{name}": 1e3 * statistics.quantiles(waits, n=100)[98],
    }


def main() -> None:
    options = command_line(__doc__).parse_args()
    figures: dict[str, Any] = {}
    for n, log_period in FLEETS:
        figures |= load(n, log_period)
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
