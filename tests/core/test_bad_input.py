"""Whatever a user gets wrong: exit status 2, lines that say where and what, and nothing flown."""

from __future__ import annotations

import errno
import io
import os
import re
import socket
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from star_core.commands.main import main
from tests.commands import position_and_code, problem_lines

WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
obstacles:
  pillar: {polygon: [[0.8, 0.8], [1.2, 0.8], [1.2, 1.2], [0.8, 1.2]], height: [0, 2]}
"""
MISSION = """\
star: 1
name: bad
world: worlds/room.yaml
seed: 7
swarm:
  cf1: {start: [-0.5, 0, 0]}
  cf2: {start: [0.5, 0, 0]}
groups: {pair: [cf1, cf2]}
transport: sim
localizer: flow
planner: straight
avoider: {use: orca, radius: 0.2}
mission:
  - takeoff: {height: 0.5}
  - hold: {for: 0.5}
  - land: {}
"""


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The mission and its world, in the folder that the tests stand in."""
    monkeypatch.chdir(tmp_path)
    Path("worlds").mkdir()
    Path("worlds/room.yaml").write_text(WORLD)
    Path("m.yaml").write_text(MISSION)


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., list[str]]:
    """Run ``star``, see that it refuses and leaves nothing behind, and return its errors."""

    def run(*arguments: str) -> list[str]:
        before = sorted(Path().rglob("*"))
        try:
            status = main(arguments)
        except SystemExit as error:  # argparse's way to return
            status = int(error.code or 0)
        out, err = capsys.readouterr()
        assert status == 2
        assert out == ""
        assert sorted(Path().rglob("*")) == before
        assert "Traceback" not in err
        return problem_lines(err)

    return run


def change(old: str, new: str, file: str = "m.yaml") -> None:
    """Write something else in the place of `old`, which is in the file once."""
    text = Path(file).read_text()
    assert text.count(old) == 1
    Path(file).write_text(text.replace(old, new))


def test_the_mission_that_is_spoilt_below_is_good(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "m.yaml"]) == 0
    assert capsys.readouterr() == ("m.yaml: 'bad' can be flown, with 2 agents\n", "")


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("mm.yaml", "no such file [file-not-found]"),
        ("worlds", "is a directory, expected a YAML file [unreadable-file]"),
        ("loop.yaml", f"cannot be read: {os.strerror(errno.ELOOP)} [unreadable-file]"),
    ],
)
def test_a_mission_that_cannot_be_read_reports_why(
    refused: Callable[..., list[str]], name: str, why: str
) -> None:
    Path("loop.yaml").symlink_to("loop.yaml")
    assert refused("run", name) == [f"{name}: {why}"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("seed: 7", "seed: [", "m.yaml:4:7 [invalid-yaml]"),
        ("seed: 7", "sead: 7", "m.yaml:4:1 [unknown-option]"),
        ("use: orca", "use: orka", "m.yaml:12:16 [unknown-plugin]"),
        ("for: 0.5", "agents: cf3", "m.yaml:15:20 [unknown-agent]"),
        ("hold: {for: 0.5}", "goto: {to: [2, 0, 1]}", "m.yaml:15:16 [unreachable-goal]"),
    ],
)
def test_a_mistake_of_any_kind_keeps_a_mission_from_flying(
    refused: Callable[..., list[str]], old: str, new: str, expected: str
) -> None:
    """The corpus has every mistake that `star check` reports."""
    change(old, new)
    assert [*map(position_and_code, refused("run", "m.yaml"))] == [expected]


def test_a_link_that_leads_out_of_the_folder_is_refused(
    refused: Callable[..., list[str]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    outside = tmp_path_factory.mktemp("outside") / "room.yaml"
    outside.write_text(WORLD)
    Path("link.yaml").symlink_to(outside)
    change("worlds/room.yaml", "link.yaml")
    assert [*map(position_and_code, refused("run", "m.yaml"))] == ["m.yaml:3:8 [file-not-found]"]


def test_a_world_that_is_a_socket_is_not_waited_for(refused: Callable[..., list[str]]) -> None:
    with socket.socket(socket.AF_UNIX) as plug:
        plug.bind("plug.yaml")
        change("worlds/room.yaml", "plug.yaml")
        (line,) = refused("run", "m.yaml")
    assert position_and_code(line) == "m.yaml:3:8 [unreadable-file]"


@pytest.mark.parametrize("name", ["loop.yaml", "w" * 300])
def test_a_world_that_no_path_leads_to_is_refused(
    refused: Callable[..., list[str]], name: str
) -> None:
    Path("loop.yaml").symlink_to("loop.yaml")
    change("worlds/room.yaml", name)
    (line,) = refused("run", "m.yaml")
    assert line.startswith(f"m.yaml:3:8: '{name}' is no path of a file: ")


LINE = re.compile(r"(m\.yaml|worlds/[^:]*|--set .*?)(:\d+:\d+)?: \S.*")
WORDS = b"""
    -1 0 1e308 1e-300 .nan .inf 18446744073709551615 2026-01-01 null true [] {} '' [[0,0]] ../ /
    all cf1 cf9 pair sim use: agents: file: parallel: repeat: land:{} ' " | > % @ ` &a *a !b <<: ---
    # ? : , - \0 \xff \xef\xbb\xbf \xe2\x80\xa8
""".split()


def answer(*arguments: str) -> tuple[int, list[str]]:
    """Check a mission, and return the exit status and what is printed of what is wrong."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = main(["check", "m.yaml", *arguments])
    assert bool(out.getvalue()) is (status == 0)
    return status, problem_lines(err.getvalue())


fuzz = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.mark.extended
@fuzz
@given(
    path=st.lists(
        st.sampled_from(["mission", "swarm", "cf1", "start", "avoider", "radius", "0", "x", ""]),
        max_size=5,
    ).map(".".join),
    value=st.sampled_from([word.decode(errors="replace") for word in WORDS]) | st.text(max_size=8),
)
def test_whatever_is_set_is_taken_or_refused_in_lines(path: str, value: str) -> None:
    status, lines = answer(f"--set={path}={value}")
    assert status == (2 if lines else 0)
    assert all(LINE.fullmatch(line) for line in lines), lines
