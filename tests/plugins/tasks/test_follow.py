"""The verb ``follow``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import Array, Limits, Obstacle, Scene, Status
from star_core.testing import scene
from tests.plugins.tasks import trajectories
from tests.plugins.tasks.conftest import fly, make, problems

BOX: dict[str, Any] = {"path": "box", "size": 2.0, "centre": [0.0, 0.0, 0.8]}
CIRCLE = BOX | {"path": "circle"}
EIGHT = BOX | {"path": "figure8", "size": 4.0}
CORNER = [[-1.0, -1.0, 0.8]]


def with_file(folder: Path, n: int, text: str) -> Scene:
    return trajectories.with_file(folder, text, n, Limits())


def off_box(track: Array) -> Array:
    """How far (T, 3) points are from a box of 2 m about the origin, m."""
    off: Array = np.abs(np.abs(track[:, :2]).max(axis=1) - 1.0)
    return off


def test_an_agent_flies_the_box_at_the_speed() -> None:
    room = scene(1)
    flown = fly(make("follow", room, (0,), **BOX, speed=0.4), room, CORNER)
    assert flown.status is Status.SUCCESS
    assert flown.limit == pytest.approx(3 * 8.0 / 0.4 + 5)
    assert flown.time == pytest.approx(8.0 / 0.4, abs=0.5)
    assert off_box(flown.track[:, 0]).max() < 0.05
    assert np.abs(flown.end - CORNER).max() < 0.15


def test_it_flies_to_the_start_first() -> None:
    room = scene(1)
    flown = fly(make("follow", room, (0,), **BOX), room, [[-1.0, -4.0, 0.8]])
    near = np.linalg.norm(flown.track[:, 0] - CORNER[0], axis=1) < 0.15
    before = flown.goals[int(near.argmax()) - 1]
    assert before.position[0].tolist() == CORNER[0]
    assert flown.status is Status.SUCCESS


def test_the_number_of_laps_is_flown() -> None:
    room = scene(1)
    once = fly(make("follow", room, (0,), **CIRCLE), room, [[1.0, 0.0, 0.8]])
    thrice = fly(make("follow", room, (0,), **CIRCLE, laps=3), room, [[1.0, 0.0, 0.8]])
    assert thrice.time == pytest.approx(3 * once.time, abs=1.0)


def test_the_goal_moves_with_a_feed_forward_along_the_path() -> None:
    room = scene(1)
    flown = fly(make("follow", room, (0,), **CIRCLE), room, [[1.0, 0.0, 0.8]])
    middle, after = flown.goals[100], flown.goals[101]
    moved = (after.position - middle.position) / room.period
    assert np.linalg.norm(middle.velocity[0]) == pytest.approx(0.3)
    assert middle.velocity[0] == pytest.approx(moved[0], abs=0.01)


def test_no_agent_exceeds_the_limit() -> None:
    room = scene(1)
    flown = fly(make("follow", room, (0,), **CIRCLE, speed=3.0), room, [[1.0, 0.0, 0.8]])
    steps = np.linalg.norm(np.diff(flown.track[:, 0], axis=0), axis=1) / room.period
    assert flown.status is Status.SUCCESS
    assert steps.max() <= 0.5 + 1e-9


def test_the_point_waits_for_an_agent_that_lags() -> None:
    room = scene(1)
    task = make("follow", room, (0,), **CIRCLE)
    held = [[1.0, 0.0, 0.8]]
    flown = fly(task, room, held, stuck=lambda time: np.array([5.0 <= time < 25.0]))
    lag = [
        np.linalg.norm(goals.position[0] - position[0])
        for goals, position in zip(flown.goals, flown.position, strict=True)
    ]
    assert max(lag) < 0.6
    assert flown.status is Status.SUCCESS


def test_the_point_waits_while_its_agent_is_not_located() -> None:
    room = scene(1)
    task = make("follow", room, (0,), **CIRCLE)
    located = lambda time: np.array([not 5.0 <= time < 25.0])  # noqa: E731 -- read with the call
    flown = fly(task, room, [[1.0, 0.0, 0.8]], located=located)
    assert flown.goals[110].position.tolist() == flown.goals[490].position.tolist()
    assert flown.status is Status.SUCCESS


def test_several_agents_stay_evenly_apart() -> None:
    room = scene(2)
    task = make("follow", room, (0, 1), **CIRCLE)
    flown = fly(task, room, [[-1.0, 0.0, 0.8], [1.0, 0.0, 0.8]])
    apart = np.linalg.norm(flown.track[:, 0] - flown.track[:, 1], axis=1)
    assert flown.status is Status.SUCCESS
    assert apart.min() > 1.9
    assert flown.end[0] == pytest.approx([-1.0, 0.0, 0.8], abs=0.15)


def test_when_one_agent_lags_all_wait() -> None:
    room = scene(2)
    task = make("follow", room, (0, 1), **CIRCLE)
    start = [[-1.0, 0.0, 0.8], [1.0, 0.0, 0.8]]
    flown = fly(task, room, start, stuck=lambda time: np.array([5.0 <= time < 25.0, False]))
    apart = np.linalg.norm(flown.track[:, 0] - flown.track[:, 1], axis=1)
    assert apart.min() > 1.5
    assert flown.status is Status.SUCCESS


@pytest.mark.parametrize("n", [2, 3, 4])
def test_no_two_agents_meet_at_the_crossing_of_the_figure_8(n: int) -> None:
    room = scene(n)
    begin = make("follow", room, tuple(range(n)), **EIGHT)
    start = fly(begin, room, [[i - 1.5, -2.0, 0.8] for i in range(n)], longest=0.1)
    starts = start.goals[0].position
    flown = fly(make("follow", room, tuple(range(n)), **EIGHT), room, starts)
    apart = np.linalg.norm(flown.track[:, :, None] - flown.track[:, None], axis=3)
    assert apart[:, *np.triu_indices(n, 1)].min() > 0.6


def test_looking_along_turns_with_the_path_but_not_too_fast() -> None:
    room = scene(1)
    flown = fly(make("follow", room, (0,), **BOX, heading="along"), room, CORNER)
    yaw = np.array([goals.yaw[0] for goals in flown.goals])
    turned = np.abs((np.diff(yaw) + np.pi) % (2 * np.pi) - np.pi)
    assert turned.max() <= np.radians(60) * room.period + 1e-9
    assert yaw[60] == pytest.approx(0.0)  # along the first side
    assert np.degrees(yaw[200]) == pytest.approx(90.0)  # along the second


def test_a_file_is_flown_with_its_heading(tmp_path: Path) -> None:
    room = with_file(tmp_path, 1, "x,y,z,yaw_deg\n0,0,1,0\n2,0,1,0\n2,1,1.5,90\n")
    flown = fly(make("follow", room, (0,), file="path.csv"), room, [[0.0, 0.0, 1.0]])
    assert flown.status is Status.SUCCESS
    assert flown.end[0] == pytest.approx([2.0, 1.0, 1.5], abs=0.15)
    assert np.degrees(flown.yaw[-1]) == pytest.approx([90.0], abs=10)


def test_agents_fly_a_file_side_by_side(tmp_path: Path) -> None:
    room = with_file(tmp_path, 2, "x,y,z\n0,0,1\n0,2,1\n")
    task = make("follow", room, (0, 1), file="path.csv", spacing=0.8)
    flown = fly(task, room, [[0.5, 0.0, 1.0], [-0.5, 0.0, 1.0]])
    assert flown.status is Status.SUCCESS
    assert flown.end == pytest.approx(np.array([[0.4, 2.0, 1.0], [-0.4, 2.0, 1.0]]), abs=0.15)


def test_a_route_that_the_remaining_agents_cannot_fly_fails() -> None:
    room = scene(1)
    task = make("follow", room, (0,), **BOX | {"centre": [9.5, 0.0, 0.8]})
    flown = fly(task, room, CORNER)
    assert flown.status is Status.FAILURE
    assert flown.reason.startswith("box: [10.5, -1, 0.8] is outside the fence")


def test_points_shifted_into_an_obstacle_are_reported_with_shift(tmp_path: Path) -> None:
    pillar = Obstacle("pillar", (((0.7, 0.9), (1.1, 0.9), (1.1, 1.1), (0.7, 1.1)),), (0.0, 2.0))
    room = with_file(tmp_path, 2, "x,y,z\n0.5,-1,0.8\n0.5,1,0.8\n0,2,0.8\n")
    room = replace(room, world=replace(room.world, obstacles=(pillar,)))
    faults = problems("follow", room, (0, 1), file="path.csv")
    assert faults == [
        (
            ("file",),
            "path.csv:3, shifted by [0.3, 0, 0] for one of 2 agents: "
            "[0.8, 1, 0.8] is inside obstacle 'pillar'",
        )
    ]


def test_options_of_trajectories_do_not_go_with_waypoints() -> None:
    options = {"file": "path.csv", "timescale": 2.0, "on_board": True}
    assert problems("follow", scene(1), (0,), **options) == [
        ((option,), f"'{option}' goes with 'format: timed' or 'poly7' only")
        for option in ("timescale", "on_board")
    ]


def test_unreachable_waypoints_are_reported_with_their_line(tmp_path: Path) -> None:
    room = with_file(tmp_path, 1, "x,y,z\n0,0,1\n0,0,2\n0,1,2\n0,0,1\n0,0,0.1\n")
    assert problems("follow", room, (0,), file="path.csv") == [
        (("file",), f"path.csv:{line}: {point} is outside the heights to fly at, from 0.2 to 1.8 m")
        for line, point in ((3, "[0, 0, 2]"), (6, "[0, 0, 0.1]"))
    ]


def test_every_agents_own_line_is_looked_at(tmp_path: Path) -> None:
    room = with_file(tmp_path, 2, "x,y,z\n9.8,0,1\n9.8,1,1\n")
    assert len(problems("follow", room, (0, 1), file="path.csv")) == 1
    assert problems("follow", room, (0,), file="path.csv") == []
