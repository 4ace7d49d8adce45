"""The Multi-ranger deck."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from star_core import Fence, Obstacle, World
from star_fleet.decks import OPTIONAL
from star_fleet.packet import Port
from star_fleet.ranger import AXES, NO_ECHO, ZONES, Ranger

Start = Callable[..., Any]
SQUARE = (((1.0, -1.0), (2.0, -1.0), (2.0, 1.0), (1.0, 1.0)),)
ROOM = World(
    "room",
    Fence((-3, -3, 0), (3, 3, 3)),
    obstacles=(Obstacle("block", SQUARE, (0.0, 1.0)),),
    virtual=(Obstacle("ghost", (((-2.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)),), (0.0, 2.0)),),
)


@pytest.mark.parametrize(
    ("position", "expected"),
    [
        ((0.0, 0.0, 0.5), [1000, NO_ECHO, NO_ECHO, NO_ECHO, NO_ECHO]),
        ((0.0, 0.0, 1.1), [NO_ECHO] * 5),  # above the block
        ((1.5, 2.0, 0.5), [NO_ECHO, NO_ECHO, NO_ECHO, 1000, NO_ECHO]),
        ((2.7, 0.9, 0.5), [NO_ECHO, 700, NO_ECHO, NO_ECHO, NO_ECHO]),
        ((-3.1, 0.0, 0.5), [NO_ECHO] * 5),  # 4.1 m away, and nothing virtual is there
    ],
)
def test_it_measures_along_the_axes(position: tuple[float, ...], expected: list[int]) -> None:
    positions = np.tile(position, (len(AXES), 1))
    assert Ranger(ROOM).measure(positions, AXES).tolist() == expected


def test_it_sees_what_is_above_and_the_floor() -> None:
    shelf = World("shelf", ROOM.fence, obstacles=(Obstacle("shelf", SQUARE, (1.5, 1.6)),))
    ranger = Ranger(shelf)
    above = ranger.measure(
        np.array([[1.5, 0.0, 0.4], [0.5, 0.0, 0.4]]), np.array([[0, 0, 1.0]] * 2)
    )
    assert above.tolist() == [1100, NO_ECHO]
    slanted = ranger.measure(np.array([[0.0, 0.0, 0.3]]), np.array([[-0.4, 0.0, -0.3]]))
    assert slanted.tolist() == [500]


def test_zones_go_row_by_row_from_above_and_from_the_left() -> None:
    assert ZONES[0] == pytest.approx([1.0, 0.357, 0.357], abs=0.001)
    assert ZONES[7] == pytest.approx([1.0, -0.357, 0.357], abs=0.001)
    assert ZONES[63] == pytest.approx([1.0, -0.357, -0.357], abs=0.001)


def test_drones_carry_it_by_option(start: Start) -> None:
    equipped = start(world=ROOM, decks=[OPTIONAL["multi-ranger"]])
    for bench, expected in ((start(world=ROOM), (0, 0)), (equipped, (1000, NO_ECHO))):
        bench.fleet.simulator.drones[0]["position"] = 0.0, 0.0, 0.5
        assert bench.log("range.front", "range.back") == expected


def test_the_zones_of_its_forward_sensor_are_a_memory(start: Start) -> None:
    bench = start(world=ROOM, decks=[OPTIONAL["multi-ranger"]])
    bench.fleet.simulator.drones[0]["position"] = 0.0, 0.0, 0.5
    content = b""
    for address in range(0, 128, 16):
        (answer,) = bench.ask(Port.MEMORY, 1, struct.pack("<BIB", 7, address, 16))
        assert answer[5] == 0
        content += answer[6:]
    zones = np.reshape(struct.unpack("<64H", content), (8, 8))
    assert zones[3, 3] == pytest.approx(1000 * np.hypot(1, np.hypot(0.049, 0.049)), abs=2)
    assert (zones == zones[:, ::-1]).all()
    assert zones[7, 0] < zones[7, 3] + 100  # the block fills the field of view
