"""Whatever comes over the link: no crash, no long answer, and no harm from what is malformed."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from star_fleet.packet import Port, is_null, join, split
from star_fleet.setpoints import decode, fixes

Start = Callable[..., Any]

FEW = 6_000
MANY = 100_000

GOOD = [
    join(Port.SETPOINT, 0, struct.pack("<Bffff", 8, 0.1, 0.0, 0.0, 0.0)),
    join(Port.SETPOINT, 0, struct.pack("<Bffff", 10, 0.1, 0.0, 0.0, 0.8)),
    join(Port.SETPOINT, 0, struct.pack("<B9hI3h", 6, *range(9), 7 << 20, 1, 2, 3)),
    join(Port.SETPOINT, 1, b"\0\0\0\0\0"),
    join(Port.ATTITUDE, 0, struct.pack("<fffH", 1.0, 2.0, 3.0, 30000)),
    join(Port.HIGH_LEVEL, 0, struct.pack("<BBff?f", 7, 0, 0.8, 0.0, 1, 2.0)),
    join(Port.HIGH_LEVEL, 0, struct.pack("<BBBBfffff", 12, 0, 1, 0, 0.1, 0, 0, 0, 2.0)),
    join(Port.HIGH_LEVEL, 0, struct.pack("<BBBBIB", 6, 1, 1, 0, 0, 2)),
    join(Port.HIGH_LEVEL, 0, struct.pack("<BBBBBBf", 13, 0, 1, 1, 0, 1, 1.0)),
    join(Port.MEMORY, 2, struct.pack("<BI24s", 1, 0, b"\x3f" * 24)),
    join(Port.MEMORY, 1, struct.pack("<BIB", 1, 0, 24)),
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
WHOLE = {Port.ATTITUDE, Port.HIGH_LEVEL, Port.LOCALISATION, Port.LOG}  # less is nothing


def spoiled(rng: random.Random) -> bytes:
    """Return a datagram: random, or a good one with some bytes changed, cut off or added."""
    if rng.random() < 0.3:
        return rng.randbytes(rng.randrange(40))
    packet = bytearray(rng.choice(GOOD))
    for _ in range(rng.randrange(4)):
        packet[rng.randrange(len(packet))] = rng.randrange(256)
    if rng.random() < 0.3:
        del packet[rng.randrange(len(packet)) :]
    if rng.random() < 0.2:
        packet += rng.randbytes(rng.randrange(20))
    return bytes(packet)


def assert_nothing_breaks(bench: Any, datagrams: int) -> None:
    """Give a vehicle spoiled datagrams, and see that it and the one beside it are whole."""
    rng = random.Random(1)  # noqa: S311 -- the same each time
    for i in range(datagrams):
        for answer in bench.fleet.handle(0, spoiled(rng)):
            assert 1 <= len(answer) <= 31
        if i % 20 == 0:
            bench.fleet.advance()
        if i % 500 == 0:
            bench.fleet.simulator.drones["locked"] = 0  # or nothing would fly for long
    for name in ("position", "velocity", "attitude", "believed_position", "believed_velocity"):
        assert np.isfinite(bench.fleet.simulator.drones[name]).all(), name
    assert all(len(packet) <= 31 for packet in bench.streamed[0])
    assert bench.fleet.handle(0, join(Port.LINK, 0, b"ping")) == [join(Port.LINK, 0, b"ping")]
    assert bench.fleet.simulator.drones["position"][1] == pytest.approx([0.5, 0, 0], abs=0.1)


def test_no_datagram_breaks_a_vehicle_or_is_answered_at_length(start: Start) -> None:
    assert_nothing_breaks(start(2, noise=True), FEW)


@pytest.mark.campaign
def test_none_of_very_many_datagrams_breaks_a_vehicle(start: Start) -> None:
    assert_nothing_breaks(start(2, noise=True), MANY)


ANSWERS = {
    Port.PARAMETERS, Port.MEMORY, Port.LOG, Port.HIGH_LEVEL, Port.SUPERVISOR, Port.PLATFORM
}  # fmt: skip
ERROR = {(Port.HIGH_LEVEL, 0): 4, (Port.MEMORY, 1): 6, (Port.MEMORY, 2): 6}  # its place in answers


def refused(packet: bytes, answers: list[bytes]) -> bool:
    """Whether a datagram was certainly refused, by what the protocol says of it and its answer."""
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


def known(bench: Any) -> tuple[Any, ...]:
    """All that the first vehicle and its firmware keep, but for who listens."""
    vehicle = bench.fleet.vehicles[0]
    return (
        bench.fleet.simulator.drones[0].tobytes(),
        tuple(bytes(memory) for _kind, memory in vehicle._memories._memories),
        tuple(vehicle._parameters._values),
        dict(vehicle._parameters._stored),
        repr(vehicle._log._blocks),
        repr(vehicle._guidance._demand),
        vehicle._guidance._stamp,
        vehicle._high_level.plan(bench.fleet.time),
        dict(vehicle._high_level._defined),
        vehicle.supervisor.state,
        vehicle.supervisor.armed,
    )


def assert_what_is_refused_changes_nothing(bench: Any, datagrams: int) -> int:
    """Give a vehicle in flight spoiled datagrams, and return how many of them it refused."""
    bench.takeoff()
    bench.fly(2.0)
    rng = random.Random(2)  # noqa: S311 -- the same each time
    count = 0
    before = known(bench)
    for i in range(datagrams):
        packet = spoiled(rng)
        answers = bench.fleet.handle(0, packet)
        after = known(bench)
        if refused(packet, answers):
            count += 1
            assert after == before, packet.hex()
        before = after
        if i % 20 == 0:
            bench.fleet.advance()
            before = known(bench)
    return count


def test_what_is_refused_changes_nothing(start: Start) -> None:
    assert assert_what_is_refused_changes_nothing(start(), FEW // 2) > FEW // 8


@pytest.mark.campaign
def test_none_of_very_many_refused_datagrams_changes_anything(start: Start) -> None:
    assert assert_what_is_refused_changes_nothing(start(), MANY) > MANY // 4


@pytest.mark.parametrize("packet", [packet for packet in GOOD if packet[0] >> 4 in WHOLE])
def test_what_is_cut_off_changes_nothing(start: Start, packet: bytes) -> None:
    bench = start()
    bench.takeoff()
    bench.fly(2.0)
    before = bench.fleet.simulator.drones[0].copy()
    for length in range(1, len(packet)):
        bench.fleet.handle(0, packet[:length])
    assert bench.fleet.simulator.drones[0] == before
