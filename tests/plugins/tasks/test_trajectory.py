"""Trajectories of polynomial pieces: their files, and how ``follow`` flies them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import InputError, Limits, Obstacle, Scene, Status
from star_core.testing import scene
from star_verbs.follow.files import PIECE_COLUMNS, read_trajectory
from star_verbs.follow.trajectory import PolynomialPath

HEADER = ",".join(PIECE_COLUMNS)
WIDE = Limits(speed=2.0, acceleration=10.0)
NOTHING = (0.0,) * 8


def rest_to_rest(start: float, way: float, duration: float) -> list[float]:
    """The polynomial of fifth degree that stands still at both ends.

    Its greatest speed is 15/8 way / duration, its greatest acceleration 10/sqrt(3) way / duration².
    """
    third, fourth, fifth = (f * way / duration**k for f, k in ((10, 3), (-15, 4), (6, 5)))
    return [start, 0.0, 0.0, third, fourth, fifth, 0.0, 0.0]


def row(duration: float, x: Sequence[float], yaw: Sequence[float] = NOTHING) -> str:
    return ",".join(map(repr, [duration, *x, *NOTHING, *NOTHING, *yaw]))


def there_and_back(way: float = 1.0, duration: float = 4.0) -> str:
    out, back = rest_to_rest(0.0, way, duration), rest_to_rest(way, -way, duration)
    return f"{HEADER}\n{row(duration, out)}\n{row(duration, back)}\n"


def with_file(folder: Path, text: str, n: int = 1, limits: Limits = WIDE) -> Scene:
    (folder / "path.csv").write_text(text, encoding="utf-8")
    return replace(scene(n, limits=limits), folder=folder)


def faults(folder: Path, text: str) -> list[str]:
    (folder / "path.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as raised:
        read_trajectory(folder / "path.csv", "path.csv", "poly7")
    assert raised.value.code == "invalid-trajectory"
    return [problem.removesuffix(" [invalid-trajectory]") for problem in raised.value.problems]


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
    found = read_trajectory(tmp_path / "path.csv", "path.csv", "poly7")
    assert found.lines.tolist() == [2, 3]
    assert found.length == 8.0


STILL = row(1.0, NOTHING)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "path.csv: has no piece, expected a header and one line per piece"),
        (f"{HEADER}\n", "path.csv: has no piece, expected a header and one line per piece"),
        (f"{STILL}\n{STILL}\n",
         "path.csv:1: expected the header duration,x^0,…,yaw^7"),
        (f"{HEADER}\n1,2\n", "path.csv:2: has 2 values, expected 33"),
        (f"{HEADER}\n{STILL.replace('1.0', '-1.0')}\n",
         "path.csv:2: duration is -1 s, expected more than 0"),
        (f"{HEADER}\n{STILL.replace('1.0,0.0', '1.0,a')}\n",
         "path.csv:2: x^0 is 'a', expected a number"),
        (f"{HEADER}\n{row(1.0, (float('nan'), *NOTHING[1:]))}\n",
         "path.csv:2: x^0 is 'nan', expected a finite number"),
        (f"{HEADER}\n{STILL}\n{row(1.0, (0.3, *NOTHING[1:]))}\n",
         "path.csv:3: begins 0.30 m from the end of the previous piece, "
         "expected no more than 0.05 m"),
    ],
)  # fmt: skip
def test_problems_of_a_file_are_reported_with_their_line(
    tmp_path: Path, text: str, expected: str
) -> None:
    assert faults(tmp_path, text) == [expected]


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "path.csv").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"path\.csv: cannot be read as CSV in UTF-8"):
        read_trajectory(tmp_path / "path.csv", "path.csv", "poly7")


POLY7: dict[str, Any] = {"file": "path.csv", "format": "poly7"}


def test_it_is_flown_in_its_own_time_from_where_the_agent_is(
    make: Any, fly: Any, tmp_path: Path
) -> None:
    room = with_file(tmp_path, there_and_back(way=1.0, duration=4.0))
    flown = fly(make("follow", room, (0,), **POLY7), room, [[3.0, 2.0, 1.0]])
    assert flown.status is Status.SUCCESS
    assert flown.time == pytest.approx(8.0, abs=0.3)
    fastest = max(goals.velocity[0, 0] for goals in flown.goals)
    assert fastest == pytest.approx(15 / 8 * 1.0 / 4.0, abs=0.01)
    assert flown.track[80, 0] == pytest.approx([4.0, 2.0, 1.0], abs=0.1)
    assert flown.end[0] == pytest.approx([3.0, 2.0, 1.0], abs=0.15)


def test_a_timescale_of_2_takes_twice_as_long(make: Any, fly: Any, tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(way=1.0, duration=4.0))
    flown = fly(make("follow", room, (0,), **POLY7, timescale=2.0), room, [[0.0, 0.0, 1.0]])
    assert flown.time == pytest.approx(16.0, abs=0.3)


def test_one_that_lies_in_the_map_is_flown_to_first(make: Any, fly: Any, tmp_path: Path) -> None:
    text = there_and_back().replace(HEADER, "H")
    lifted = "\n".join(
        ",".join([*cells[:17], "1.0", *cells[18:]])
        for cells in (line.split(",") for line in text.splitlines()[1:])
    )
    room = with_file(tmp_path, f"{HEADER}\n{lifted}\n")
    task = make("follow", room, (0,), **POLY7, relative=False)
    flown = fly(task, room, [[0.0, 3.0, 1.0]])
    assert flown.status is Status.SUCCESS
    assert flown.end[0] == pytest.approx([0.0, 0.0, 1.0], abs=0.15)


def test_each_agent_flies_it_from_its_position(make: Any, fly: Any, tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(), n=2)
    start = [[0.0, 0.0, 1.0], [0.0, 1.0, 1.2]]
    flown = fly(make("follow", room, (0, 1), **POLY7), room, start)
    apart = flown.track[:, 1] - flown.track[:, 0]
    assert apart == pytest.approx(np.broadcast_to([0.0, 1.0, 0.2], apart.shape), abs=0.02)


def test_its_heading_is_flown(make: Any, fly: Any, tmp_path: Path) -> None:
    turn = (0.0, 0.2, *NOTHING[2:])
    room = with_file(tmp_path, f"{HEADER}\n{row(5.0, NOTHING, turn)}\n")
    flown = fly(make("follow", room, (0,), **POLY7), room, [[0.0, 0.0, 1.0]])
    assert flown.yaw[-1][0] == pytest.approx(1.0, abs=0.1)


def test_it_waits_for_an_agent_that_lags(make: Any, fly: Any, tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back())
    task = make("follow", room, (0,), **POLY7)
    held = lambda time: np.array([1.0 <= time < 11.0])  # noqa: E731 -- read with the call
    flown = fly(task, room, [[0.0, 0.0, 1.0]], stuck=held)
    assert flown.status is Status.SUCCESS
    assert flown.time > 15.0


def test_it_may_take_three_times_its_duration_and_5_s(make: Any, fly: Any, tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(duration=4.0))
    task = make("follow", room, (0,), **POLY7, timescale=2.0)
    assert fly(task, room, [[0.0, 0.0, 1.0]], longest=0.1).limit == pytest.approx(3 * 16.0 + 5)


def test_one_that_would_lead_out_of_the_fence_from_here_fails(
    make: Any, fly: Any, tmp_path: Path
) -> None:
    room = with_file(tmp_path, there_and_back(way=1.0))
    flown = fly(make("follow", room, (0,), **POLY7), room, [[9.5, 0.0, 1.0]])
    assert flown.status is Status.FAILURE
    assert flown.reason.startswith("path.csv:2: 2.08 s after its start, [10.0")
    assert "is outside the fence" in flown.reason


def test_a_good_trajectory_is_no_problem(problems: Any, tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back())
    assert problems("follow", room, (0,), **POLY7, timescale=1.0, relative=True) == []


def test_trajectories_over_the_speed_limit_suggest_a_timescale(
    problems: Any, tmp_path: Path
) -> None:
    room = with_file(tmp_path, there_and_back(way=2.0, duration=4.0), limits=Limits(speed=0.5))
    ((path, message),) = problems("follow", room, (0,), **POLY7)
    assert path == ("file",)
    assert message == (
        "path.csv:2: 2.00 s after its start it flies 0.94 m/s, faster than limits.speed of "
        "0.5 m/s; timescale: 1.88 would fit"
    )
    assert problems("follow", room, (0,), **POLY7, timescale=1.88) == []
    assert problems("follow", room, (0,), **POLY7, timescale=1.87) != []


def test_trajectories_over_the_acceleration_suggest_a_timescale(
    problems: Any, tmp_path: Path
) -> None:
    limits = Limits(speed=9.0, acceleration=1.0)
    room = with_file(tmp_path, there_and_back(way=1.0, duration=2.0), limits=limits)
    ((_, message),) = problems("follow", room, (0,), **POLY7)
    assert "accelerates by 1.44 m/s², more than limits.acceleration of 1 m/s²" in message
    assert message.endswith("; timescale: 1.21 would fit")  # sqrt(10 / sqrt(3) / 4) = 1.2014
    assert problems("follow", room, (0,), **POLY7, timescale=1.21) == []


def test_a_jump_of_the_velocity_is_reported_at_its_piece(problems: Any, tmp_path: Path) -> None:
    on, back = (0.0, 0.4, *NOTHING[2:]), (0.4, -0.4, *NOTHING[2:])
    room = with_file(tmp_path, f"{HEADER}\n{row(1.0, on)}\n{row(1.0, back)}\n")
    ((_, message),) = problems("follow", room, (0,), **POLY7)
    assert message == (
        "path.csv:3: 1.00 s after its start it changes its velocity by 0.80 m/s at once, more than "
        "0.5 m/s in a tick; timescale: 1.6 would fit"
    )


def test_one_that_is_longer_than_the_room_is_a_problem(problems: Any, tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back(way=21.0, duration=60.0))
    assert problems("follow", room, (0,), **POLY7) == [
        (("file",), "path.csv: spans 21.00 m along x, the fence only 20.00 m")
    ]


def test_trajectories_in_an_obstacle_are_reported_at_first_hit(
    problems: Any, tmp_path: Path
) -> None:
    room = with_file(tmp_path, there_and_back(), limits=replace(WIDE, height=(0.0, 2.0)))
    post = Obstacle("post", (((0.5, -1.0), (0.7, -1.0), (0.7, 1.0), (0.5, 1.0)),), (0.0, 2.0))
    room = replace(room, world=replace(room.world, obstacles=(post,)))
    found = problems("follow", room, (0,), **POLY7, relative=False)
    assert [message.split(": ")[0] for _, message in found] == ["path.csv:2", "path.csv:3"]
    assert all("m from obstacle 'post'" in message for _, message in found)


def test_options_of_paths_do_not_go_with_a_trajectory(problems: Any, tmp_path: Path) -> None:
    room = with_file(tmp_path, there_and_back())
    assert problems("follow", room, (0,), **POLY7, speed=0.4, heading="along") == [
        (("speed",), "'speed' does not go with 'format: poly7'"),
        (("heading",), "'heading' does not go with 'format: poly7'"),
    ]
    assert problems("follow", room, (0,), format="poly7") == [((), "'format: poly7' needs 'file'")]


# Points with times

TIMED = "t,x,y,z\n0,0,0,1\n4,1,0,1\n6,1,1,1.2\n9,0,0,1\n"


def timed(**options: Any) -> dict[str, Any]:
    return {"file": "path.csv", "format": "timed", **options}


def test_timed_points_are_passed_at_their_times(make: Any, fly: Any, tmp_path: Path) -> None:
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
def test_a_heading_is_flown_only_if_there_is_one(
    make: Any, fly: Any, tmp_path: Path, column: str, end: float
) -> None:
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
def test_times_that_do_not_rise_are_refused(
    problems: Any, tmp_path: Path, text: str, fault: str
) -> None:
    ((path, message),) = problems("follow", with_file(tmp_path, text), (0,), **timed())
    assert path == ("file",)
    assert message.startswith(fault)


def test_timed_points_that_are_too_fast_suggest_a_timescale(problems: Any, tmp_path: Path) -> None:
    room = with_file(tmp_path, TIMED, limits=Limits(speed=0.5))
    ((_, message),) = problems("follow", room, (0,), **timed())
    assert "faster than limits.speed of 0.5 m/s; timescale: " in message
    scale = float(message.split("timescale: ")[1].split()[0])
    assert problems("follow", room, (0,), **timed(timescale=scale)) == []


def test_times_in_waypoints_name_the_format(problems: Any, tmp_path: Path) -> None:
    ((_, message),) = problems("follow", with_file(tmp_path, TIMED), (0,), file="path.csv")
    assert message.startswith("path.csv:1: its points have times, 't'; add `format: timed`")


def test_timed_points_without_a_heading_are_not_flown_on_board(
    problems: Any, tmp_path: Path
) -> None:
    found = problems("follow", with_file(tmp_path, TIMED), (0,), **timed(on_board=True))
    assert (
        ("on_board",),
        "path.csv: has no column 'yaw_deg', which a flight on board needs",
    ) in found
