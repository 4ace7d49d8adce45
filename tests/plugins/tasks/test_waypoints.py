"""Files of waypoints."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core import InputError
from star_verbs.follow.files import read_waypoints


def written(folder: Path, text: str) -> str:
    (folder / "path.csv").write_text(text, encoding="utf-8")
    return "path.csv"


def faults(folder: Path, file: str) -> list[str]:
    with pytest.raises(InputError) as raised:
        read_waypoints(folder / file, file)
    assert raised.value.code == "invalid-trajectory"
    return [problem.removesuffix(" [invalid-trajectory]") for problem in raised.value.problems]


def test_points_are_read_with_the_lines_they_stand_on(tmp_path: Path) -> None:
    path = read_waypoints(tmp_path / written(tmp_path, "x,y,z\n0,0,1\n\n1,2.5,1\n"), "path.csv")
    assert path.point == ((0.0, 0.0, 1.0), (1.0, 2.5, 1.0))
    assert path.line == (2, 4)
    assert path.yaw_deg == ()


def test_columns_may_stand_in_any_order_with_a_heading(tmp_path: Path) -> None:
    path = read_waypoints(
        tmp_path / written(tmp_path, "\ufeffyaw_deg, z, y, x\r\n90,1,2,3\r\n0,1,2,4\r\n"),
        "path.csv",
    )
    assert path.point == ((3.0, 2.0, 1.0), (4.0, 2.0, 1.0))
    assert path.yaw_deg == (90.0, 0.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x,y,z\n0,0,1\n1,a,1\n", ["path.csv:3: y is 'a', expected a number"]),
        ("x,y,z\n0,0,1\n1,nan,1\n", ["path.csv:3: y is 'nan', expected a finite number"]),
        ("x,y,z\n0,0,1\n1,,inf\n", [
            "path.csv:3: y is '', expected a number",
            "path.csv:3: z is 'inf', expected a finite number",
        ]),
        ("x,y,z\n0,0\n1,1,1\n", ["path.csv:2: has 2 values, expected 3"]),
        ("x,y\n0,0\n", ["path.csv:1: no column 'z', expected x, y, z and, optionally, yaw_deg"]),
        ("x,y,z,yaw\n", [
            "path.csv:1: unknown column 'yaw', expected x, y, z and, optionally, yaw_deg"
        ]),
        ("x,y,z,x\n", ["path.csv:1: column 'x' is given 2 times"]),
        ("", [
            "path.csv: is empty, expected a header with columns x, y, z and, optionally, yaw_deg"
        ]),
        ("x,y,z\n0,0,1\n", ["path.csv: has 1 points, expected at least 2 that differ"]),
        ("x,y,z\n0,0,1\n0,0,1\n", ["path.csv: has 2 points, expected at least 2 that differ"]),
    ],
)  # fmt: skip
def test_problems_are_reported_with_their_line(
    tmp_path: Path, text: str, expected: list[str]
) -> None:
    assert faults(tmp_path, written(tmp_path, text)) == expected


def test_every_invalid_line_is_reported(tmp_path: Path) -> None:
    messages = faults(tmp_path, written(tmp_path, "x,y,z\n0,0,b\n1,1,1\n0,c,0\n"))
    assert [message.split(":")[1] for message in messages] == ["2", "4"]


@pytest.mark.parametrize("data", [b"\xff\xfe\x00", b'x,y,z\n"0,1,2\n'])
def test_a_file_that_is_not_csv_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "path.csv").write_bytes(data)
    with pytest.raises(InputError, match=r"^path.csv: cannot be .* \[unreadable-file\]$"):
        read_waypoints(tmp_path / "path.csv", "path.csv")


def test_a_file_of_many_megabytes_is_not_read(tmp_path: Path) -> None:
    written(tmp_path, "x,y,z\n" + "0,0,1\n" * 200_000)
    with pytest.raises(InputError, match=r"path.csv: has more than 1 MB \[unreadable-file\]"):
        read_waypoints(tmp_path / "path.csv", "path.csv")
