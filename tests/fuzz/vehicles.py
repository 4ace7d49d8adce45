"""Targets: datagrams to simulated Crazyflies.

No crash, at most one answer of at most 31 bytes, and no effect of what is refused.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from star_core.testing import scene
from star_fleet.memory import Memory, Stations, Stored, Tester
from star_fleet.packet import MAX_PAYLOAD, Port, is_null, join, split
from star_fleet.server import Fleet
from star_fleet.setpoints import decode, fixes
from tests.fuzz.harness import Draw, Target, Try
from tests.simulators import ideal_fleet

GOOD: Final = [
    join(Port.SETPOINT, 0, struct.pack("<Bffff", 8, 0.1, 0.0, 0.0, 0.0)),
    join(Port.SETPOINT, 0, struct.pack("<Bffff", 10, 0.1, 0.0, 0.0, 0.8)),
    join(Port.SETPOINT, 0, struct.pack("<B9hI3h", 6, *range(9), 7 << 20, 1, 2, 3)),
    join(Port.SETPOINT, 1, b"\0\0\0\0\0"),
    join(Port.ATTITUDE, 0, struct.pack("<fffH", 1.0, 2.0, 3.0, 30000)),
    join(Port.HIGH_LEVEL, 0, struct.pack("<BBff?f", 7, 0, 0.8, 0.0, 1, 2.0)),
    join(Port.HIGH_LEVEL, 0, struct.pack("<BBBBfffff", 12, 0, 1, 0, 0.1, 0, 0, 0, 2.0)),
    join(Port.HIGH_LEVEL, 0, struct.pack("<BBBBfffff", 11, 0, 0, 1, 3.0, 0.5, 0.5, 0.1, 3.0)),
    join(Port.HIGH_LEVEL, 0, struct.pack("<BBBBIB", 6, 1, 1, 0, 0, 2)),
    join(Port.HIGH_LEVEL, 0, struct.pack("<BBBBBBf", 13, 0, 1, 1, 0, 1, 1.0)),
    join(Port.MEMORY, 2, struct.pack("<BI24s", 1, 0, b"\x3f" * 24)),
    join(Port.MEMORY, 1, struct.pack("<BIB", 1, 0, 24)),
    join(Port.MEMORY, 2, struct.pack("<BI24s", 2, 0x1100, b"\x3f" * 24)),
    join(Port.LOG, 1, struct.pack("<BBBHBH", 6, 1, 7, 3, 7, 9)),
    join(Port.LOG, 1, b"\x03\x01\x02"),
    join(Port.PARAMETERS, 2, struct.pack("<HB", 40, 1)),
    join(Port.PARAMETERS, 3, b"\0locSrv\0extPosStdDev\0\x06\0\0\0\0"),
    join(Port.LOCALISATION, 0, struct.pack("<fff", 0.1, 0.2, 0.3)),
    join(Port.LOCALISATION, 1, struct.pack("<B7f", 8, 0.1, 0.2, 0.3, 0, 0, 0, 1)),
    join(Port.LOCALISATION, 2, struct.pack("<BhhhBhhh", 8, 1, 2, 3, 9, 4, 5, 6)),
    join(Port.SUPERVISOR, 1, b"\x01\x01"),
    join(Port.PLATFORM, 1, b"\0"),
    join(Port.LINK, 0, b"ping"),
]
STRIDE: Final = 1001  # coprime to the number of ports, channels and lengths
LONG: Final = 64  # bytes of a datagram that are received


def spoiled(draw: Draw) -> bytes:
    """Return a datagram: random, or a good one with some bytes changed, cut off or added."""
    if draw.random() < 0.3:
        return draw.randbytes(draw.randrange(40))
    packet = bytearray(draw.choice(GOOD))
    for _ in range(draw.randrange(4)):
        packet[draw.randrange(len(packet))] = draw.randrange(256)
    if draw.random() < 0.3:
        del packet[draw.randrange(len(packet)) :]
    if draw.random() < 0.2:
        packet += draw.randbytes(draw.randrange(20))
    return bytes(packet[:LONG])


@contextmanager
def datagrams(_folder: Path) -> Iterator[Try]:
    """A vehicle that is given datagrams, and one beside it that is given none."""
    with flying() as fleet:
        streamed: list[bytes] = []
        fleet.listen(0, streamed.append)
        position = fleet.simulator.drones["position"][1].copy()
        before, number = firmware_state(fleet), 0

        def attempt(draw: Draw) -> str:
            nonlocal before, number
            packet = spoiled(draw)
            answers = answered(fleet, packet)
            after, number = firmware_state(fleet), number + 1
            was_refused = refused(packet, answers)
            if was_refused:
                assert after == before, packet.hex()
            before = after
            if number % 20 == 0:
                fleet.advance()
                assert all(len(packet) <= 1 + MAX_PAYLOAD for packet in streamed)
                streamed.clear()
                if number % 500 == 0:
                    fleet.simulator.drones["locked"] = 0  # or nothing would fly for long
                assert_whole(fleet)
                assert abs(fleet.simulator.drones["position"][1] - position).max() < 0.1
                before = firmware_state(fleet)
            return "refused" if was_refused else "taken"

        yield attempt


@contextmanager
def grid(_folder: Path) -> Iterator[Try]:
    """Every port, channel and length, with random payloads."""
    with flying() as fleet:
        number = 0

        def attempt(draw: Draw) -> str:
            nonlocal number
            number += 1
            head, length = divmod(STRIDE * number % (64 * (MAX_PAYLOAD + 1)), MAX_PAYLOAD + 1)
            packet = join(head >> 2 & 15, head & 3, draw.randbytes(length))
            answers = answered(fleet, packet)
            if number % 100 == 0:
                fleet.advance()
                assert_whole(fleet)
            return "answered" if answers else "not answered"

        yield attempt


@contextmanager
def flying() -> Iterator[Fleet]:
    """Two vehicles, of which the first is in the air."""
    fleet = ideal_fleet(scene(2), noise=True)
    try:
        takeoff = struct.pack("<BBff?f", 7, 0, 0.8, 0.0, 0, 1.5)
        fleet.handle(0, join(Port.HIGH_LEVEL, 0, takeoff))
        for _ in range(200):
            fleet.advance()
        assert fleet.simulator.drones["position"][0, 2] > 0.5
        yield fleet
    finally:
        fleet.close()


def answered(fleet: Fleet, packet: bytes) -> list[bytes]:
    """Give the first vehicle a datagram, and return its answers."""
    answers = fleet.handle(0, packet)
    assert len(answers) <= 1
    assert all(1 <= len(answer) <= 1 + MAX_PAYLOAD for answer in answers)
    return answers


def assert_whole(fleet: Fleet) -> None:
    """See that both vehicles are still simulated, and that the first one answers."""
    for name in ("position", "velocity", "attitude", "believed_position", "believed_velocity"):
        assert np.isfinite(fleet.simulator.drones[name]).all(), name
    echo = join(Port.LINK, 0, b"ping")
    assert fleet.handle(0, echo) == [echo]


ANSWERS: Final = {
    Port.PARAMETERS, Port.MEMORY, Port.LOG, Port.HIGH_LEVEL, Port.SUPERVISOR, Port.PLATFORM
}  # fmt: skip
ERROR: Final = {
    (Port.HIGH_LEVEL, 0): 4,
    (Port.MEMORY, 1): 6,
    (Port.MEMORY, 2): 6,
}  # its place in answers


def refused(packet: bytes, answers: list[bytes]) -> bool:
    """Whether a datagram was certainly refused, by the protocol and its answer."""
    parts = split(packet)
    if parts is None or is_null(packet) or parts[0] not in set(Port):
        return True
    port, channel, payload = parts
    silent = channel == 1 and payload[:1] in {b"\3", b"\4"}  # emergency stop, and its watchdog
    if port == Port.SETPOINT:
        return channel > 1 or (channel == 0 and decode(payload) is None)
    if port == Port.LOCALISATION:
        return not silent and not list(fixes(channel, payload))
    if port in ANSWERS and not answers:
        return not (port == Port.SUPERVISOR and silent)
    at = ERROR.get((Port(port), channel))
    return at is not None and any(answers[0][at : at + 1])


def firmware_state(fleet: Fleet) -> tuple[Any, ...]:
    """All that the first vehicle and its firmware keep, but for its clients."""
    vehicle = fleet.vehicles[0]
    return (
        fleet.simulator.drones[0].tobytes(),
        tuple(content(entry.memory) for entry in vehicle._memories._memories),
        tuple(vehicle._parameters._values),
        dict(vehicle._parameters._stored),
        repr(vehicle._log._blocks),
        repr(vehicle._guidance._demand),
        vehicle._guidance._stamp,
        vehicle._high_level.plan(fleet.time),
        dict(vehicle._high_level._defined),
        vehicle.supervisor.state,
        vehicle.supervisor.armed,
    )


def content(memory: Memory) -> object:
    """What a client can change in a memory."""
    if isinstance(memory, Stored):
        return bytes(memory.content)
    if isinstance(memory, Stations):
        return [bytes(page.content) for page in memory._pages.values()]
    return memory.errors if isinstance(memory, Tester) else None


TARGETS: Final = (
    Target("datagrams to a drone", 1_500, 100_000, datagrams),
    Target("every port, channel and length", 1984, 10 * 1984, grid),
)
