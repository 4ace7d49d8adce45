"""Whatever comes over the link: no crash, no long answer, and no harm from what is malformed."""

from __future__ import annotations

import os
import random
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from star_sim.fleet.packet import Port, join

Start = Callable[..., Any]

FEW = 6_000
MANY = 100_000  # with STAR_FUZZ set

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


def test_no_datagram_breaks_a_vehicle_or_is_answered_at_length(start: Start) -> None:
    bench = start(2, noise=True)
    rng = random.Random(1)  # noqa: S311 -- the same each time
    for i in range(MANY if "STAR_FUZZ" in os.environ else FEW):
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


@pytest.mark.parametrize("packet", [packet for packet in GOOD if packet[0] >> 4 in WHOLE])
def test_what_is_cut_off_changes_nothing(start: Start, packet: bytes) -> None:
    bench = start()
    bench.takeoff()
    bench.fly(2.0)
    before = bench.fleet.simulator.drones[0].copy()
    for length in range(1, len(packet)):
        bench.fleet.handle(0, packet[:length])
    assert bench.fleet.simulator.drones[0] == before
