"""The high-level commander: what it flies, and what it answers."""

from __future__ import annotations

import errno
import math
import struct
from typing import Any

import numpy as np
import pytest

from star_core import Supervisor
from star_fleet.packet import Port
from star_fleet.spiral import spiral
from tests.plugins.commands.star_fleet.conftest import Bench


def upload(bench: Any, data: bytes, offset: int = 0) -> None:
    for at in range(0, len(data), 24):
        head = struct.pack("<BI", 1, offset + at)
        (answer,) = bench.ask(Port.MEMORY, 2, head + data[at : at + 24])
        assert answer[5] == 0


def piece(duration: float, x: list[float] | None = None, z: list[float] | None = None) -> bytes:
    rows = [row + [0.0] * (8 - len(row)) for row in (x or [0.0], [0.0], z or [0.0], [0.0])]
    return struct.pack("<33f", *rows[0], *rows[1], *rows[2], *rows[3], duration)


def define(bench: Any, number: int = 1, count: int = 1, kind: int = 0, offset: int = 0) -> int:
    return int(bench.command("BBBBIB", 6, number, 1, kind, offset, count))


def begin(bench: Any, number: int = 1, scale: float = 1.0, **flags: bool) -> int:
    names = ("relative", "turned", "backwards")
    bits = [flags.get(name, False) for name in names]
    return int(bench.command("BBBBBBf", 13, 0, *bits, number, scale))


def test_a_take_off_rises_and_hovers(bench: Bench) -> None:
    assert bench.takeoff(0.8, 1.5) == 0
    bench.fly(1.0)
    assert Supervisor.COMMANDER_ACTIVE | Supervisor.FLYING in bench.state()
    assert Supervisor.COMMANDER_FINISHED not in bench.state()
    bench.fly(2.0)
    assert bench.position == pytest.approx([0, 0, 0.8], abs=0.02)
    assert Supervisor.COMMANDER_ACTIVE | Supervisor.COMMANDER_FINISHED in bench.state()


def test_a_second_take_off_is_refused(aloft: Bench) -> None:
    assert aloft.takeoff(1.5) == 1
    aloft.fly(2.0)
    assert aloft.position[2] == pytest.approx(0.8, abs=0.02)


def test_a_take_off_turns_to_its_yaw_in_radians(bench: Bench) -> None:
    bench.takeoff(yaw=1.0)
    bench.fly(3.0)
    assert bench.log("stateEstimate.yaw")[0] == pytest.approx(math.degrees(1.0), abs=1)


def test_landing_stops_the_motors_and_ends_two_seconds_later(aloft: Bench) -> None:
    assert aloft.land() == 0
    assert aloft.land() == 1
    aloft.fly(1.6)
    assert not aloft.turned
    assert Supervisor.COMMANDER_ACTIVE not in aloft.state()
    assert Supervisor.FLYING in aloft.state()
    aloft.fly(2.1)
    assert Supervisor.FLYING not in aloft.state()
    assert aloft.position[2] == pytest.approx(0.0, abs=0.01)
    assert aloft.takeoff() == 0


def test_a_go_to_reaches_its_place_and_yaw(aloft: Bench) -> None:
    assert aloft.go(0.5, -0.3, 1.0, 0.7) == 0
    aloft.fly(4.0)
    assert aloft.position == pytest.approx([0.5, -0.3, 1.0], abs=0.03)
    assert aloft.log("stateEstimate.yaw")[0] == pytest.approx(math.degrees(0.7), abs=1)


def test_a_relative_go_to_adds_to_the_goal_before(aloft: Bench) -> None:
    aloft.go(0.4, 0.0, 0.8, 0.0)
    aloft.fly(4.0)
    assert aloft.go(0.4, 0.2, 0.0, 0.0, relative=True) == 0
    aloft.fly(4.0)
    assert aloft.position == pytest.approx([0.8, 0.2, 0.8], abs=0.03)


def test_a_linear_go_to_has_one_speed(aloft: Bench) -> None:
    aloft.command("BBBBfffff", 12, 0, 0, 1, 1.0, 0.0, 0.8, 0.0, 4.0)
    aloft.fly(2.0)
    assert aloft.log("ctrltarget.x", "ctrltarget.vx") == pytest.approx((0.5, 0.25), abs=0.01)


def test_the_old_forms_are_understood(bench: Bench) -> None:
    assert bench.command("BBff", 1, 0, 0.6, 1.5) == 0
    bench.fly(3.0)
    assert bench.command("BBBfffff", 4, 0, 0, 0.3, 0.0, 0.6, 0.0, 1.5) == 0
    bench.fly(3.0)
    assert bench.position == pytest.approx([0.3, 0, 0.6], abs=0.03)
    assert bench.command("BBff", 2, 0, 0.0, 1.5) == 0
    bench.fly(2.0)
    assert not bench.turned


def test_a_mean_speed_may_be_given_instead_of_a_time(bench: Bench) -> None:
    assert bench.command("BBf?f?f", 9, 0, 0.8, 1, 0.0, 1, 0.4) == 0
    bench.fly(1.9)
    assert Supervisor.COMMANDER_FINISHED not in bench.state()
    bench.fly(1.5)
    assert bench.position[2] == pytest.approx(0.8, abs=0.02)
    bench.write("hlCommander.vland", "f", 0.0)
    assert bench.command("BBf?f?f", 10, 0, 0.0, 0, 0.0, 1, 0.0) == errno.ENOEXEC
    bench.write("hlCommander.vland", "f", 0.8)
    assert bench.command("BBf?f?f", 10, 0, 0.0, 0, 0.0, 1, 0.0) == 0
    bench.fly(1.2)
    assert not bench.turned


def test_a_stop_stops_the_motors_and_locks_nothing(aloft: Bench) -> None:
    assert aloft.command("BB", 3, 0) == 0
    aloft.fly(0.02)
    assert not aloft.turned
    aloft.fly(3.0)
    assert Supervisor.LOCKED not in aloft.state()


def test_only_its_groups_obey(bench: Bench) -> None:
    assert bench.command("BB", 0, 0b010) == 0
    (answer,) = bench.ask(Port.PARAMETERS, 3, b"\0hlCommander\0groupmask\0\x08\x02")
    assert answer[-1] == 0
    assert bench.command("BBff?f", 7, 0b101, 0.8, 0.0, 0, 1.5) == 0
    bench.fly(1.0)
    assert not bench.turned
    assert bench.command("BBff?f", 7, 0b110, 0.8, 0.0, 0, 1.5) == 0
    bench.fly(1.0)
    assert bench.turned


def test_what_is_unknown_or_cannot_be_flown_is_not_executed(aloft: Bench) -> None:
    assert aloft.command("B", 99) == errno.ENOEXEC
    assert aloft.command("BBBBffff", 12, 0, 0, 0, 1, 1, 1, 1) == errno.ENOEXEC
    assert aloft.go(math.nan, 0.0, 1.0, 0.0) == errno.ENOEXEC
    assert aloft.go(1e9, 0.0, 1.0, 0.0) == errno.ENOEXEC
    for duration in (0.0, -1.0, math.inf, 1e9):
        assert aloft.go(0.0, 0.0, 1.0, 0.0, duration=duration) == errno.ENOEXEC
    aloft.fly(1.0)
    assert aloft.position == pytest.approx([0, 0, 0.8], abs=0.02)


def test_an_uploaded_trajectory_is_flown_piece_by_piece(aloft: Bench) -> None:
    upload(aloft, piece(1.0, [0, 0.3], [0.8]) + piece(2.0, [0.3, 0.1], [0.8]))
    assert define(aloft, count=2) == 0
    assert begin(aloft) == 0
    aloft.fly(0.5)
    assert aloft.log("ctrltarget.x", "ctrltarget.vx") == pytest.approx((0.15, 0.3), abs=0.005)
    aloft.fly(1.0)
    assert aloft.log("ctrltarget.x", "ctrltarget.vx") == pytest.approx((0.35, 0.1), abs=0.005)
    assert Supervisor.COMMANDER_FINISHED not in aloft.state()
    aloft.fly(3.0)
    assert Supervisor.COMMANDER_FINISHED in aloft.state()
    assert aloft.position == pytest.approx([0.5, 0, 0.8], abs=0.03)


def test_a_trajectory_is_flown_backwards_and_slower(aloft: Bench) -> None:
    upload(aloft, piece(1.0, [0, 0.3], [0.8]) + piece(1.0, [0.3, 0.1], [0.8]))
    define(aloft, count=2)
    assert begin(aloft, scale=2.0, backwards=True) == 0
    aloft.fly(1.0)
    assert aloft.log("ctrltarget.x", "ctrltarget.vx") == pytest.approx((0.35, -0.05), abs=0.005)


def test_relative_trajectories_start_at_the_current_pose(aloft: Bench) -> None:
    aloft.go(0.5, 0.2, 0.8, math.pi / 2)
    aloft.fly(4.0)
    upload(aloft, piece(2.0, [3.0, 0.2], [1.0]), offset=264)
    define(aloft, offset=264)
    assert begin(aloft, relative=True, turned=True) == 0
    aloft.fly(4.0)
    assert aloft.position == pytest.approx([0.5, 0.6, 0.8], abs=0.04)


def test_a_compressed_trajectory_is_flown(aloft: Bench) -> None:
    data = struct.pack("<hhhh", 0, 0, 800, 0) + struct.pack("<BHh", 1, 2000, 500)
    upload(aloft, data + struct.pack("<BH", 0, 0))
    assert define(aloft, kind=1, count=3) == 0
    assert begin(aloft, scale=2.0) == errno.ENOEXEC
    assert begin(aloft, backwards=True) == errno.ENOEXEC
    assert begin(aloft) == 0
    aloft.fly(1.0)
    assert aloft.log("ctrltarget.x", "ctrltarget.vx") == pytest.approx((0.25, 0.25), abs=0.005)
    aloft.fly(2.5)
    assert aloft.position == pytest.approx([0.5, 0, 0.8], abs=0.03)


def test_missing_trajectories_are_accepted_but_not_flown(aloft: Bench) -> None:
    assert begin(aloft, number=5) == 0
    assert begin(aloft, number=200) == 0
    aloft.fly(1.0)
    assert aloft.position == pytest.approx([0, 0, 0.8], abs=0.02)


def test_a_trajectory_outside_the_memory_is_not_executed(aloft: Bench) -> None:
    assert define(aloft, number=10) == errno.ENOEXEC
    define(aloft, count=32)
    assert begin(aloft) == errno.ENOEXEC
    define(aloft, kind=7)
    assert begin(aloft) == 0


@pytest.mark.parametrize(
    ("sideways", "clockwise", "end", "turn"),
    [
        (0, 1, (0.0, -1.0), -math.pi),
        (0, 0, (0.0, 1.0), math.pi),
        (1, 1, (1.0, 0.0), -math.pi),
        (1, 0, (-1.0, 0.0), math.pi),
    ],
)
def test_half_a_turn_of_a_spiral_ends_across(
    sideways: int, clockwise: int, end: tuple[float, float], turn: float
) -> None:
    start = np.array([0.0, 0.0, 0.5, 0.0])
    piece = spiral(start, bool(sideways), bool(clockwise), math.pi, 0.5, 0.5, 0.2, 3.0)
    assert piece.at(0.0)[0] == pytest.approx(start)
    pose, rate, _ = piece.at(3.0)
    assert pose == pytest.approx([*end, 0.7, turn])
    assert np.hypot(*rate[:2]) == pytest.approx(0.5 * math.pi / 3.0)
    arc = np.array([piece.at(t)[0][:2] for t in np.linspace(0.0, 3.0, 31)])
    radius = np.hypot(*(arc - np.array(end) / 2).T)
    assert np.abs(radius - 0.5).max() < 0.06  # one polynomial for half a turn


def test_a_spiral_is_flown_and_one_without_a_duration_refused(aloft: Bench) -> None:
    spiral_of = "BBBBfffff"
    assert aloft.command(spiral_of, 11, 0, 0, 1, math.pi, 0.4, 0.4, 0.0, 0.0) == errno.ENOEXEC
    assert aloft.command(spiral_of, 11, 0, 0, 1, math.pi, 0.4, 0.4, 0.1, 4.0) == 0
    aloft.fly(4.0)
    aloft.let_go()
    assert np.linalg.norm(aloft.position - [0.0, -0.8, 0.9]) < 0.2
