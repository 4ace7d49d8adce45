"""The verb ``follow`` where agents fly the trajectory by their own commanders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import star_core
from star_core import Array, Order, Registry, Scene, Status, Tick, hookimpl, load
from tests.plugins.mission_files import write_mission
from tests.plugins.tasks.conftest import fly, make, problems
from tests.plugins.tasks.trajectories import HEADER, NOTHING, POLY7, row, there_and_back, with_file

pytestmark = pytest.mark.ideal_world

ON_BOARD = POLY7 | {"on_board": True}
WAY, HALF = 1.0, 4.0  # m along x and back, s each, as `there_and_back` has them


@pytest.fixture
def room(tmp_path: Path) -> Scene:
    return with_file(tmp_path, there_and_back(), 2)


HERE = [[3.0, 2.0, 1.0], [3.0, 3.5, 1.2]]


def test_all_are_ordered_at_once_with_the_files_pieces(room: Scene) -> None:
    task = make("follow", room, (0, 1), **ON_BOARD, timescale=2.0)
    flown = fly(task, room, HERE)
    (command,) = flown.commands
    assert command.order is Order.FOLLOW
    assert command.agent.tolist() == [0, 1]
    assert command.position.tolist() == HERE  # where the file's origin lies
    assert command.yaw.tolist() == [0.0, 0.0]
    assert command.duration.tolist() == [16.0, 16.0]
    assert task.trajectories == (command.trajectory,)
    assert command.trajectory.duration.tolist() == [HALF, HALF]
    assert command.trajectory.coefficients[1, 0, 0] == WAY
    assert flown.status is Status.SUCCESS


def test_in_the_map_the_frames_lie_side_by_side(room: Scene) -> None:
    room = replace(room, limits=replace(room.limits, height=(-1.0, 2.0)))
    room = replace(room, world=replace(room.world, fence=replace(room.world.fence, low=(-9,) * 3)))
    task = make("follow", room, (0, 1), **ON_BOARD, relative=False, spacing=1.0)
    flown = fly(task, room, [[1.0, 0.0, 0.5], [-1.0, 0.0, 0.5]])
    (command,) = flown.commands
    assert np.abs(command.position[0] - command.position[1]).max() == pytest.approx(1.0)
    assert command.position[0, 0] > command.position[1, 0]
    before = next(i for i, goals in enumerate(flown.goals) if goals.velocity.any())
    assert np.linalg.norm(flown.track[before] - command.position, axis=1).max() <= 0.15


def test_what_is_led_off_board_orders_nothing(room: Scene) -> None:
    task = make("follow", room, (0, 1), **POLY7)
    assert fly(task, room, HERE).commands == []
    assert task.trajectories == ()


def test_equal_files_are_one_trajectory(room: Scene) -> None:
    first, second = (make("follow", room, (i,), **ON_BOARD, timescale=1.0 + i) for i in range(2))
    assert first.trajectories == second.trajectories


def test_the_points_move_in_the_commanders_time(room: Scene) -> None:
    flown = fly(make("follow", room, (0, 1), **ON_BOARD), room, HERE)
    goals = np.array([table.position[0, 0] - HERE[0][0] for table in flown.goals])
    begun = next(i for i, table in enumerate(flown.goals) if table.velocity.any()) - 1
    u = np.clip((np.arange(len(goals)) - begun) * room.period / HALF, 0, 2)
    x = np.where(u < 1, smooth(u), WAY - smooth(u - 1))
    assert goals == pytest.approx(x, abs=1e-9)


def smooth(u: Array) -> Array:
    return WAY * (10 * u**3 - 15 * u**4 + 6 * u**5)


def test_a_flight_on_board_waits_for_late_agents_at_its_end_only(room: Scene) -> None:
    held = lambda time: np.array([1.0 <= time < 12.0, False])  # noqa: E731 -- read with the call
    flown = fly(make("follow", room, (0, 1), **ON_BOARD), room, HERE, stuck=held)
    at_turn = flown.goals[round(HALF / room.period)].position[:, 0]
    assert at_turn == pytest.approx([4.0, 4.0], abs=0.01)
    assert flown.status is Status.SUCCESS


def test_they_look_where_it_begins_before_they_set_out(tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(yaw=(2.0, *NOTHING[1:])), 2)
    task = make("follow", room, (0,), **ON_BOARD)
    flown = fly(task, room, HERE)
    begun = next(i for i, goals in enumerate(flown.goals) if goals.velocity.any())
    assert abs(flown.yaw[begun][0] - 2.0) < np.radians(16)
    assert flown.status is Status.SUCCESS


def test_a_replacement_is_steered_to_the_reference(room: Scene) -> None:
    task = make("follow", room, (0,), **ON_BOARD)
    fly(task, room, HERE, longest=2.0)
    task.on_agent_replaced(0, 1)
    flown = fly(task, room, HERE, longest=0.2)
    assert flown.commands == []
    assert flown.goals[0].active.tolist() == [False, True]


@pytest.mark.parametrize(("pieces", "fits"), [(31, True), (32, False)])
def test_more_pieces_than_a_crazyflie_holds_are_a_problem(
    tmp_path: Path, pieces: int, *, fits: bool
) -> None:
    room = with_file(tmp_path, "\n".join([HEADER, *[row(HALF)] * pieces]))
    message = (
        "path.csv has 32 pieces of 132 bytes, 4224 bytes in all; a Crazyflie has 4096 bytes for "
        "trajectories: 31 pieces at most"
    )
    expected = [] if fits else [(("on_board",), message)]
    assert problems("follow", room, (0,), **ON_BOARD) == expected
    assert problems("follow", room, (0,), **POLY7) == []


# Whole missions in the simulator, without noise

SWARM = "{cf1: {start: [0, 0, 0], yaw_deg: 120}, cf2: {start: [0.5, 1, 0], yaw_deg: -60}}"
ALONE = """\
  - takeoff: {agents: cf1, height: 0.8}
  - follow: {agents: cf1, file: path.csv, format: poly7, timescale: 1.5, on_board: true}
  - land: {agents: cf1}
"""
CROSSED = """\
  - takeoff: {height: 0.8}
  - parallel:
    - follow: {agents: cf1, file: path.csv, format: poly7, on_board: true}
    - goto: {agents: cf2, to: [0.5, -1, 0.8], speed: 0.4}
  - land: {}
"""


class Watch:
    """Keeps every tick."""

    def __init__(self) -> None:
        self.ticks: list[Tick] = []

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self.ticks.append(tick)


def flown_mission(folder: Path, steps: str) -> tuple[dict[str, Any], list[Tick]]:
    (folder / "path.csv").write_text(there_and_back(), encoding="utf-8")
    path = write_mission(
        folder,
        steps,
        limits="{speed: 1.0}",
        transport="{use: sim, noise: false}",
        avoider="orca",
        swarm=SWARM,
    )
    registry = Registry(watch := Watch())
    return star_core.fly(load(path, registry), registry), watch.ticks


def test_on_board_polynomials_do_not_depend_on_heading(tmp_path: Path) -> None:
    summary, ticks = flown_mission(tmp_path, ALONE)
    assert summary["outcome"] == "completed", summary["reason"]
    on_board = [tick for tick in ticks if tick.doing == "follow cf1" and not tick.sent.active.any()]
    begun, start = on_board[0].time, on_board[0].truth.position[0]  # type: ignore[union-attr]
    for tick in on_board:
        assert tick.truth is not None
        u = min((tick.time - begun) / (1.5 * HALF), 2.0)
        x = smooth(np.array(u)) if u < 1 else WAY - smooth(np.array(u - 1))
        assert tick.truth.position[0] - start == pytest.approx([x, 0, 0], abs=0.02)
    assert on_board[-1].time - begun == pytest.approx(2 * 1.5 * HALF, abs=0.11)


def test_others_make_way_for_an_agent_that_flies_on_board(tmp_path: Path) -> None:
    summary, ticks = flown_mission(tmp_path, CROSSED)
    assert summary["outcome"] == "completed", summary["reason"]
    assert summary["collisions"] == {"agent_agent": 0, "agent_obstacle": 0}
    straight = [tick.truth.position[0, 1] for tick in ticks if tick.doing.startswith("follow")]  # type: ignore[union-attr]
    aside = [tick.truth.position[1, 0] - 0.5 for tick in ticks if "goto" in tick.doing]  # type: ignore[union-attr]
    assert np.abs(straight).max() < 0.02
    assert np.abs(aside).max() > 0.05
