"""A fleet that is driven packet by packet, with no socket between and no clock on the wall."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, TypeAlias

import pytest

from star_core import Array, Supervisor, World
from star_core.testing import scene
from star_fleet.packet import NULL, Port, join
from star_fleet.parameters import CONTENTS as PARAMETERS
from star_fleet.variables import FORMAT, VARIABLES
from tests.simulators import ideal_fleet


def place(address: str) -> tuple[str, int]:
    """Return the host and the port of an address, with a scheme or without."""
    host, _, port = address.rpartition("://")[2].rpartition(":")
    return host, int(port)


def received(client: socket.socket, size: int) -> bytes:
    """Return the next bytes of a connection, so many."""
    data = b""
    while len(data) < size:
        piece = client.recv(size - len(data))
        assert piece, "it hung up"
        data += piece
    return data


LOG_NUMBER = {entry.name: i for i, entry in enumerate(VARIABLES)}


class Bench:
    """A fleet, its simulated clock, and everything that its vehicles streamed."""

    def __init__(
        self, n: int = 1, *, noise: bool = False, world: World | None = None, **options: Any
    ) -> None:
        room = scene(n) if world is None else replace(scene(n), world=world)
        self.fleet = ideal_fleet(room, noise=noise, **options)
        self.streamed: list[list[bytes]] = [[] for _ in range(n)]
        for row, packets in enumerate(self.streamed):
            self.fleet.listen(row, packets.append)

    def ask(self, port: int, channel: int, payload: bytes, row: int = 0) -> list[bytes]:
        """Send a packet; return the payloads of the answers."""
        answers = self.fleet.handle(row, join(port, channel, payload))
        assert all(answer[0] & 0xF3 == join(port, channel, b"")[0] for answer in answers)
        return [answer[1:] for answer in answers]

    def command(self, form: str, *values: Any, row: int = 0) -> int:
        """Give an order to the high-level commander; return its errno."""
        (answer,) = self.ask(Port.HIGH_LEVEL, 0, struct.pack("<" + form, *values), row)
        assert answer[:3] == struct.pack("<" + form, *values)[:3].ljust(3, b"\0")
        return answer[3]

    def takeoff(self, height: float = 0.8, duration: float = 1.5, yaw: float = 0.0) -> int:
        return self.command("BBff?f", 7, 0, height, yaw, 0, duration)

    def land(self, duration: float = 1.5) -> int:
        return self.command("BBff?f", 8, 0, 0.0, 0.0, 1, duration)

    def go(self, *target: float, duration: float = 2.0, relative: bool = False) -> int:
        return self.command("BBBBfffff", 12, 0, relative, 0, *target, duration)

    def setpoint(self, form: str, *values: Any, row: int = 0) -> None:
        assert self.ask(Port.SETPOINT, 0, struct.pack("<" + form, *values), row) == []

    def let_go(self) -> None:
        assert self.ask(Port.SETPOINT, 1, struct.pack("<BI", 0, 0)) == []

    def fly(self, seconds: float, form: str = "", *values: Any, polled: bool = True) -> None:
        """Let time pass, sending a setpoint 20 times a second if there is one.

        Null packets are sent 100 times a second, as a Crazyradio polls, unless it is not `polled`.
        """
        for cycle in range(round(seconds * 100)):
            for row in range(len(self.streamed) if polled else 0):
                self.fleet.handle(row, NULL)
            if form and cycle % 5 == 0:
                self.setpoint(form, *values)
            self.fleet.advance()

    def write(self, name: str, form: str, value: float) -> list[bytes]:
        number = PARAMETERS.number[name]
        return self.ask(Port.PARAMETERS, 2, struct.pack("<H" + form, number, value))

    def log(self, *names: str, row: int = 0) -> tuple[Any, ...]:
        """Return the values of variables, in one block that is sent once."""
        payload = b"".join(
            struct.pack("<BH", VARIABLES[LOG_NUMBER[name]].code, LOG_NUMBER[name]) for name in names
        )
        assert self.ask(Port.LOG, 1, b"\x06\xff" + payload, row) == [b"\x06\xff\0"]
        assert self.ask(Port.LOG, 1, b"\x03\xff\0", row) == [b"\x03\xff\0"]
        self.fleet.advance()
        assert self.ask(Port.LOG, 1, b"\x02\xff", row) == [b"\x02\xff\0"]
        (packet,) = (p for p in self.streamed[row] if p[:2] == b"\x52\xff")
        self.streamed[row].clear()
        form = "".join(FORMAT[VARIABLES[LOG_NUMBER[name]].code] for name in names)
        return struct.unpack("<" + form, packet[5:])

    def state(self) -> Supervisor:
        """The supervisor's answers on its port."""
        (answer,) = self.ask(Port.SUPERVISOR, 0, b"\x0c")
        assert answer[0] == 0x8C
        return Supervisor(int.from_bytes(answer[1:], "little") & 0x3FF)

    @property
    def position(self) -> Array:
        """True, less where the first vehicle started."""
        drone = self.fleet.simulator.drones[0]
        place: Array = drone["position"] - drone["origin"]
        return place

    @property
    def turned(self) -> bool:
        """Whether any motor runs."""
        return bool(self.fleet.simulator.drones["mode"][0])

    def close(self) -> None:
        self.fleet.close()


Start: TypeAlias = Callable[..., Bench]


@pytest.fixture
def start() -> Iterator[Start]:
    made = []

    def make(n: int = 1, **options: Any) -> Bench:
        made.append(Bench(n, **options))
        return made[-1]

    yield make
    for bench in made:
        bench.close()


@pytest.fixture
def bench(start: Start) -> Bench:
    """A fleet of one vehicle, on the floor."""
    return start()


@pytest.fixture
def aloft(bench: Bench) -> Bench:
    """A fleet of one vehicle, which hovers at 0.8 m."""
    assert bench.takeoff() == 0
    bench.fly(3.0)
    return bench
