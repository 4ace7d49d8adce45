"""Trajectories of polynomial pieces: their files, and how ``follow`` flies them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import InputError, Limits, Obstacle, Status
from star_verbs.follow.files import read_trajectory
from star_verbs.follow.trajectory import PolynomialPath
from tests.plugins.tasks.conftest import fly, make, problems
from tests.plugins.tasks.trajectories import (
    HEADER,
    NOTHING,
    POLY7,
    WIDE,
    rest_to_rest,
    row,
    there_and_back,
    with_file,
)


@given(time=st.floats(-5, 15))
def test_trajectories_stay_between_their_start_and_end(time: float) -> None:
    line = (rest_to_rest(0.0, 1.0, 4.0), rest_to_rest(1.0, 2.0, 4.0))
    pieces = np.array([[x, NOTHING, NOTHING, NOTHING] for x in line])
    trajectory = PolynomialPath(np.array([4.0, 4.0]), pieces, [2, 3])
    point, _ = trajectory.at(np.array([time, -1.0, 9.0]))
    assert trajectory.length == 8.0
    assert -1e-9 <= point[0, 0] <= 3.0 + 1e-9
    assert point[1:, 0] == pytest.approx([0.0, 3.0])


@pytest.mark.parametrize("header", [HEADER.title(), f"# {HEADER}", f"{HEADER},"])
def test_headers_of_crazyswarm_numpy_and_others_are_read(tmp_path: Path, header: str) -> None:
    text = there_and_back().replace(HEADER, header)
    (tmp_path / "path.csv").write_text(text, encoding="utf-8")
    trajectory = read_trajectory(tmp_path / "path.csv", "path.csv", "poly7")
    assert trajectory.lines.tolist() == [2, 3]
    assert trajectory.length == 8.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "path.csv: has no piece, expected a header and one line per piece"),
        (
            f"{HEADER}\n{row(1.0, (float('nan'), *NOTHING[1:]))}\n",
            "path.csv:2: x^0 is 'nan', expected a finite number",
        ),
    ],
)
def test_problems_of_a_file_are_reported_with_their_line(
    tmp_path: Path, text: str, expected: str
) -> None:
    (tmp_path / "path.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as raised:
        read_trajectory(tmp_path / "path.csv", "path.csv", "poly7")
    assert raised.value.problems == (f"{expected} [invalid-trajectory]",)


def test_agents_fly_it_in_its_own_time_from_where_they_are(tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(way=1.0, duration=4.0), n=2)
    start = [[3.0, 2.0, 1.0], [3.0, 3.0, 1.2]]
    flown = fly(make("follow", room, (0, 1), **POLY7), room, start)
    assert flown.status is Status.SUCCESS
    assert flown.time == pytest.approx(8.0, abs=0.3)
    fastest = max(goals.velocity[0, 0] for goals in flown.goals)
    assert fastest == pytest.approx(15 / 8 * 1.0 / 4.0, abs=0.01)
    assert flown.track[80, 0] == pytest.approx([4.0, 2.0, 1.0], abs=0.1)
    assert flown.end[0] == pytest.approx(start[0], abs=0.15)
    apart = flown.track[:, 1] - flown.track[:, 0]
    assert apart == pytest.approx(np.broadcast_to([0.0, 1.0, 0.2], apart.shape), abs=0.02)


def test_a_timescale_of_2_takes_twice_as_long(tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(way=1.0, duration=4.0))
    flown = fly(make("follow", room, (0,), **POLY7, timescale=2.0), room, [[0.0, 0.0, 1.0]])
    assert flown.time == pytest.approx(16.0, abs=0.3)


def test_one_that_lies_in_the_map_is_flown_to_first(tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(z=1.0))
    task = make("follow", room, (0,), **POLY7, relative=False)
    flown = fly(task, room, [[0.0, 3.0, 1.0]])
    assert flown.status is Status.SUCCESS
    assert flown.end[0] == pytest.approx([0.0, 0.0, 1.0], abs=0.15)


def test_its_heading_is_flown(tmp_path: Path) -> None:
    turn = (0.0, 0.2, *NOTHING[2:])
    room = with_file(tmp_path, f"{HEADER}\n{row(5.0, yaw=turn)}\n")
    flown = fly(make("follow", room, (0,), **POLY7), room, [[0.0, 0.0, 1.0]])
    assert flown.yaw[-1][0] == pytest.approx(1.0, abs=0.1)


def test_it_waits_for_an_agent_that_lags(tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back())
    task = make("follow", room, (0,), **POLY7)
    held = lambda time: np.array([1.0 <= time < 11.0])  # noqa: E731 -- read with the call
    flown = fly(task, room, [[0.0, 0.0, 1.0]], stuck=held)
    assert flown.status is Status.SUCCESS
    assert flown.time > 15.0


def test_it_may_take_three_times_its_duration_and_5_s(tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(duration=4.0))
    task = make("follow", room, (0,), **POLY7, timescale=2.0)
    assert fly(task, room, [[0.0, 0.0, 1.0]], longest=0.1).limit == pytest.approx(3 * 16.0 + 5)


def test_one_that_would_lead_out_of_the_fence_from_here_fails(tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(way=1.0))
    flown = fly(make("follow", room, (0,), **POLY7), room, [[9.5, 0.0, 1.0]])
    assert flown.status is Status.FAILURE
    assert flown.reason.startswith("path.csv:2: 2.08 s after its start, [10.0")
    assert "is outside the fence" in flown.reason


def test_trajectories_over_the_speed_limit_suggest_a_timescale(tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(way=2.0, duration=4.0), limits=Limits(speed=0.5))
    ((path, message),) = problems("follow", room, (0,), **POLY7)
    assert path == ("file",)
    assert message == (
        "path.csv:2: 2.00 s after its start it flies 0.94 m/s, faster than limits.speed of "
        "0.5 m/s; timescale: 1.88 would fit"
    )
    assert problems("follow", room, (0,), **POLY7, timescale=1.88) == []
    assert problems("follow", room, (0,), **POLY7, timescale=1.87) != []


def test_trajectories_over_the_acceleration_suggest_a_timescale(tmp_path: Path) -> None:
    limits = Limits(speed=9.0, acceleration=1.0)
    room = with_file(tmp_path, there_and_back(way=1.0, duration=2.0), limits=limits)
    ((_, message),) = problems("follow", room, (0,), **POLY7)
    assert "accelerates by 1.44 m/s², more than limits.acceleration of 1 m/s²" in message
    assert message.endswith("; timescale: 1.21 would fit")  # sqrt(10 / sqrt(3) / 4) = 1.2014
    assert problems("follow", room, (0,), **POLY7, timescale=1.21) == []


def test_a_jump_of_the_velocity_is_reported_at_its_piece(tmp_path: Path) -> None:
    on, back = (0.0, 0.4, *NOTHING[2:]), (0.4, -0.4, *NOTHING[2:])
    room = with_file(tmp_path, f"{HEADER}\n{row(1.0, on)}\n{row(1.0, back)}\n")
    ((_, message),) = problems("follow", room, (0,), **POLY7)
    assert message == (
        "path.csv:3: 1.00 s after its start it changes its velocity by 0.80 m/s at once, more than "
        "0.5 m/s in a tick; timescale: 1.6 would fit"
    )


def test_trajectories_in_an_obstacle_are_reported_at_first_hit(tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(), limits=replace(WIDE, height=(0.0, 2.0)))
    post = Obstacle("post", (((0.5, -1.0), (0.7, -1.0), (0.7, 1.0), (0.5, 1.0)),), (0.0, 2.0))
    room = replace(room, world=replace(room.world, obstacles=(post,)))
    faults = problems("follow", room, (0,), **POLY7, relative=False)
    assert [message.split(": ")[0] for _, message in faults] == ["path.csv:2", "path.csv:3"]
    assert all("m from obstacle 'post'" in message for _, message in faults)


# Points with times

TIMED = "t,x,y,z\n0,0,0,1\n4,1,0,1\n6,1,1,1.2\n9,0,0,1\n"


def timed(**options: Any) -> dict[str, Any]:
    return {"file": "path.csv", "format": "timed", **options}


def test_timed_points_are_passed_at_their_times(tmp_path: Path) -> None:
    room = with_file(tmp_path, TIMED)
    flown = fly(make("follow", room, (0,), **timed()), room, [[0.0, 0.0, 1.0]])
    assert flown.status is Status.SUCCESS
    assert flown.time == pytest.approx(9.0, abs=0.3)
    period = flown.time / (len(flown.track) - 1)
    for time, point in ((4.0, [1.0, 0.0, 1.0]), (6.0, [1.0, 1.0, 1.2])):
        assert flown.track[round(time / period), 0] == pytest.approx(point, abs=0.15)


@given(
    st.lists(st.floats(0.01, 9.0), min_size=1, max_size=6),
    st.lists(st.tuples(*[st.floats(-5, 5)] * 3, st.floats(-400, 400)), min_size=7, max_size=7),
    st.floats(-10.0, 10.0),
)
def test_the_line_of_timed_points_is_smooth(
    steps: list[float], states: list[tuple[float, ...]], first: float
) -> None:
    times = np.concatenate([[0.0], np.cumsum(steps)])
    lines = [
        ",".join(map(repr, (first + float(t), *state)))
        for t, state in zip(times, states, strict=False)
    ]
    with TemporaryDirectory() as name:
        path = Path(name, "path.csv")
        path.write_text("\n".join(["t,x,y,z,yaw_deg", *lines]))
        line = read_trajectory(path, "path.csv", "timed")
    points = np.array(states)[: len(times), :3]
    assert line.at(times)[0] == pytest.approx(points, abs=1e-6)
    assert line.length == pytest.approx(times[-1])
    scale = np.abs(points).max() / min(steps) ** 2 + 1.0
    for quantity in (line.at, line.acceleration):  # on both sides of each point
        before, after = (quantity(times[1:-1] + side * 1e-9) for side in (-1, 1))
        for a, b in zip(before, after, strict=True):
            assert a == pytest.approx(b, abs=1e-4 * scale)
    assert line.at(times[[0, -1]])[1] == pytest.approx(0.0, abs=1e-6 * scale)
    yaw = line.yaw(times)
    assert yaw is not None
    expected = np.radians(np.array(states)[: len(times), 3])
    assert np.cos(yaw - expected) == pytest.approx(1.0)


@pytest.mark.parametrize(("column", "end"), [("", 0.0), (",yaw_deg", 1.0)])
def test_a_heading_is_flown_only_if_there_is_one(tmp_path: Path, column: str, end: float) -> None:
    first, last = (",0", f",{np.degrees(1.0)}") if column else ("", "")
    room = with_file(tmp_path, f"t,x,y,z{column}\n0,0,0,1{first}\n5,0,1,1{last}\n")
    flown = fly(make("follow", room, (0,), **timed()), room, [[0.0, 0.0, 1.0]])
    assert flown.yaw[-1][0] == pytest.approx(end, abs=0.1)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "path.csv: is empty, expected a header with columns t, x, y, z and, optionally, "),
        ("x,y,z\n0,0,1\n1,0,1\n", "path.csv:1: no column 't', expected t, x, y, z and"),
        ("t,x,y,z\n0,0,0,1\n", "path.csv: has 1 points, expected 2 to 1001"),
        ("t,x,y,z\n1,0,0,1\n1,1,0,1\n", "path.csv:3: t is 1 s after 1 s, expected it to rise"),
        ("t,x,y,z\n0,0,0,1\n1201,1,0,1\n", "path.csv:3: t is more than 1200 s after the first"),
        ("t,x,y,z\n0,0,0,1\nnan,1,0,1\n", "path.csv:3: t is 'nan', expected a finite number"),
    ],
)
def test_times_that_do_not_rise_are_refused(tmp_path: Path, text: str, fault: str) -> None:
    ((path, message),) = problems("follow", with_file(tmp_path, text), (0,), **timed())
    assert path == ("file",)
    assert message.startswith(fault)


def test_timed_points_that_are_too_fast_suggest_a_timescale(tmp_path: Path) -> None:
    room = with_file(tmp_path, TIMED, limits=Limits(speed=0.5))
    ((_, message),) = problems("follow", room, (0,), **timed())
    assert "faster than limits.speed of 0.5 m/s; timescale: " in message
    scale = float(message.split("timescale: ")[1].split()[0])
    assert problems("follow", room, (0,), **timed(timescale=scale)) == []


def test_times_in_waypoints_name_the_format(tmp_path: Path) -> None:
    ((_, message),) = problems("follow", with_file(tmp_path, TIMED), (0,), file="path.csv")
    assert message.startswith("path.csv:1: its points have times, 't'; add `format: timed`")


def test_timed_points_without_a_heading_are_not_flown_on_board(tmp_path: Path) -> None:
    faults = problems("follow", with_file(tmp_path, TIMED), (0,), **timed(on_board=True))
    assert (
        ("on_board",),
        "path.csv: has no column 'yaw_deg', which a flight on board needs",
    ) in faults
