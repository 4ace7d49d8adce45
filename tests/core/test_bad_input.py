"""Whatever a user gets wrong: exit status 2, lines that say where and what, and nothing flown."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from star_core.commands.main import main
from tests.commands import problem_lines

MISSIONS = Path(__file__).parents[2] / "missions"
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
BOMB = "a0: &a0 [x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 10)
)


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


# What is no mission at all


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", "1:1: the file is empty, expected a map such as `star: 1`"),
        (b"- star: 1\n", "1:1: the file holds a list, expected a map such as `star: 1`"),
        (b"star: 1\nname: [\n", "2:7: '[' is not closed; add ']'"),
        (b"star: 1\n\tname: x\n", "2:1: a tab stands here; YAML is indented with spaces"),
        (BOMB.encode(), "1:5: anchor '&a0' is refused; write the value out"),
        (b"a: !!python/name:os.system\n", "1:4: tag 'tag:yaml.org,2002:python/name:os.system' is"),
        (b"star: 1\nname: a\nstar: 1\n", "3:1: key 'star' is already there at line 1, column 1; "),
        (b"seed: .nan\n", "1:7: .nan is not a plain, finite decimal number"),
        (b"rate: -.inf\n", "1:7: -.inf is not a plain, finite decimal number"),
        (b"a: " + b"[" * 40 + b"]" * 40, "1:35: nested deeper than 32 levels"),
        (b"".join(b" " * i + b"-\n" for i in range(1200)), "1:1: the maps and lists are nested"),
        (b"star: 1\nname: caf\xe9\n", "2:10: byte 0xe9 is not UTF-8; save the file as UTF-8"),
        (MISSION.encode("utf-16"), "1:1: byte 0xff is not UTF-8; save the file as UTF-8"),
        (MISSION.encode("utf-16-le"), "1:2: character '\\x00' is refused; it cannot be printed"),
        (b"star: 1\n" + b"# x\n" * 250_000, "1:1: the file has more than 1 MB; split it, or "),
        (b"\x1f\x8b\x08\x00gzip", "1:2: byte 0x8b is not UTF-8; save the file as UTF-8"),
    ],
    ids=lambda value: "" if isinstance(value, bytes) else value.partition(": ")[2][:30],
)  # fmt: skip
@pytest.mark.parametrize("command", ["run", "check"])
def test_a_file_that_is_no_mission_is_refused_at_its_place(
    refused: Callable[..., list[str]], command: str, content: bytes, line: str
) -> None:
    Path("m.yaml").write_bytes(content)
    assert refused(command, "m.yaml")[0].startswith(f"m.yaml:{line}")


# What is no file


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


# One mistake in a mission

# What is changed, and what is answered; "..." stands for what depends on what is installed.
MISTAKES = """
- hold: {for: 0.5}  ->  - {hold: {for: 0.5}, land: {}}
    15:5: a step has one verb, this one has 2: 'hold', 'land'; write each as its own step
takeoff:  ->  take_off:
    14:5: unknown verb 'take_off'; did you mean 'takeoff'?
use: orca  ->  use: orka
    12:16: no avoider named 'orka'; did you mean 'orca'?
transport: sim  ->  transport: bluetooth
    9:12: no transport named 'bluetooth'; installed: ...
planner: straight  ->  planner: os.path:join
    11:10: no planner named 'os.path:join'; installed: ...
for: 0.5  ->  agents: cf3
    15:20: no agent or group named 'cf3'; did you mean 'cf2'?
for: 0.5  ->  agents: [cf1, pears]
    15:26: no agent or group named 'pears'; did you mean 'pair'?
[cf1, cf2]  ->  [cf1, cf9]
    8:22: no agent named 'cf9'; did you mean 'cf2'?
height: 0.5  ->  height: high
    14:23: takeoff: height: 'high' is a string, expected a number
height: 0.5  ->  height: 0.5 m
    14:23: takeoff: height: '0.5 m' is a string, expected a number: Height to climb to, ...
- land: {}  ->  - land: []
    16:11: land: this is a list, expected a map; write it `land: {}`
[-0.5, 0, 0]  ->  [-0.5, 0]
    6:16: swarm.cf1.start: has 2 numbers, expected 3
height: 0.5  ->  height: -0.5
    14:23: takeoff: height: -0.5 is not possible here, expected more than 0
height: 0.5  ->  height: 5
    14:23: 5 m is outside the heights to fly at, from 0.2 to 1.8 m
seed: 7  ->  seed: 7.5
    4:7: seed: 7.5 is not a whole number
radius: 0.2  ->  radus: 0.2
    12:22: avoider 'orca': unknown option 'radus'; did you mean 'radius'?
seed: 7  ->  sead: 7
    4:1: unknown key 'sead'; did you mean 'seed'?
hold: {for: 0.5}  ->  goto: {agents: cf1, to: [5, 0, 1]}
    15:29: [5, 0, 1] is outside the fence, from [-2, -2, 0] to [2, 2, 2]
hold: {for: 0.5}  ->  goto: {to: [2, 0, 1]}
    15:16: position 2 of 2: [2.3, 0, 1] is outside the fence, from [-2, -2, 0] to [2, 2, 2]
hold: {for: 0.5}  ->  goto: {agents: cf1, to: [1, 1, 1]}
    15:29: [1, 1, 1] is inside obstacle 'pillar'
hold: {for: 0.5}  ->  goto: {}
    15:11: expected 'to' or 'by'
[-0.5, 0, 0]  ->  [-5, 0, 0]
    6:16: start [-5, 0, 0] is outside the fence, from [-2, -2, 0] to [2, 2, 2]
[-0.5, 0, 0]  ->  [1, 1, 0]
    6:16: start [1, 1, 0] is inside obstacle 'pillar'
[0.5, 0, 0]  ->  [-0.3, 0, 0]
    7:16: 'cf2' starts 0.20 m from 'cf1', closer than twice avoider.radius (0.40 m)
worlds/room.yaml  ->  ../room.yaml
    3:8: '../room.yaml' is outside the mission's folder; name a file inside it
worlds/room.yaml  ->  /etc/passwd
    3:8: '/etc/passwd' is an absolute path; write it from the mission's folder: paths/file.csv
worlds/room.yaml  ->  worlds
    3:8: 'worlds' is no file; name a file in the mission's folder
worlds/room.yaml  ->  worlds/rom.yaml
    3:8: no file 'worlds/rom.yaml' in the mission's folder; did you mean 'worlds/room.yaml'?
hold: {for: 0.5}  ->  follow: {file: ../path.csv}
    15:20: '../path.csv' is outside the mission's folder; name a file inside it
hold: {for: 0.5}  ->  follow: {file: /etc/passwd}
    15:20: '/etc/passwd' is an absolute path; write it from the mission's folder: paths/file.csv
hold: {for: 0.5}  ->  follow: {file: worlds}
    15:20: 'worlds' is no file; name a file in the mission's folder
hold: {for: 0.5}  ->  follow: {file: path.csv}
    15:20: no file 'path.csv' in the mission's folder
hold: {for: 0.5}  ->  each: {agents: cf3, steps: [hold: {}]}
    15:20: no agent or group named 'cf3'; did you mean 'cf2'?
hold: {for: 0.5}  ->  each: {steps: [hold: {agents: cf1}]}
    15:35: a step of 'each' is for every agent by itself; name the agents in 'each'
hold: {for: 0.5}  ->  each: {steps: [goto: {to: [5, 0, 1]}]}
    15:31: [5, 0, 1] is outside the fence, from [-2, -2, 0] to [2, 2, 2]
hold: {for: 0.5}  ->  wait: {}
    15:5: wait: missing option 'until'
hold: {for: 0.5}  ->  wait: {until: {elapse: 3}}
    15:20: wait: until: unknown option 'elapse'; did you mean 'elapsed'?
hold: {for: 0.5}  ->  wait: {until: {elapsed: 3, found: 1}}
    15:19: wait: until: has 2 keys, expected 1; write `{all: [{elapsed: 3}, {found: 1}]}`...
hold: {for: 0.5}  ->  wait: {until: {found: 1}}
    15:27: 1 is more than the 0 targets of the world
hold: {for: 0.5}  ->  wait: {until: {near: {agent: cf9, within: 1}}}
    15:34: no agent named 'cf9'; did you mean 'cf2'?
seed: 7  ->  safety: {battery_lo: {}}
    4:10: safety: unknown key 'battery_lo'; did you mean 'battery_low'?
seed: 7  ->  safety: {battery_low: {then: sleep}}
    4:30: safety.battery_low.then: 'sleep' is not possible here; expected one of: hold, land, stop
"""
LINES = [line.strip() for line in MISTAKES.strip().splitlines()]


@pytest.mark.parametrize(("changed", "line"), list(zip(LINES[::2], LINES[1::2], strict=True)))
def test_a_mistake_in_a_mission_is_one_line_with_its_place(
    refused: Callable[..., list[str]], changed: str, line: str
) -> None:
    change(*changed.split("  ->  "))
    (found,) = refused("run", "m.yaml")
    beginning, open_ended, _ = f"m.yaml:{line}".partition("...")
    assert found.startswith(beginning) if open_ended else found.rpartition(" [")[0] == beginning


def test_a_link_that_leads_out_of_the_folder_is_refused(
    refused: Callable[..., list[str]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    outside = tmp_path_factory.mktemp("outside") / "room.yaml"
    outside.write_text(WORLD)
    Path("link.yaml").symlink_to(outside)
    change("worlds/room.yaml", "link.yaml")
    assert refused("run", "m.yaml") == [
        "m.yaml:3:8: 'link.yaml' is outside the mission's folder; name a file inside it"
        " [file-not-found]"
    ]


def test_a_world_that_is_a_socket_is_not_waited_for(refused: Callable[..., list[str]]) -> None:
    with socket.socket(socket.AF_UNIX) as plug:
        plug.bind("plug.yaml")
        change("worlds/room.yaml", "plug.yaml")
        assert refused("run", "m.yaml") == [
            "m.yaml:3:8: 'plug.yaml' is no file; name a file in the mission's folder"
            " [unreadable-file]"
        ]


@pytest.mark.parametrize("name", ["loop.yaml", "w" * 300])
def test_a_world_that_no_path_leads_to_is_refused(
    refused: Callable[..., list[str]], name: str
) -> None:
    Path("loop.yaml").symlink_to("loop.yaml")
    change("worlds/room.yaml", name)
    (line,) = refused("run", "m.yaml")
    assert line.startswith(f"m.yaml:3:8: '{name}' is no path of a file: ")


def test_a_mistake_in_a_world_is_reported_in_the_worlds_own_file(
    refused: Callable[..., list[str]],
) -> None:
    change("height: [0, 2]", "height: [2, 0]", "worlds/room.yaml")
    assert refused("run", "m.yaml") == [
        "worlds/room.yaml:5:79: obstacle 'pillar' has its foot at 2 m, not below its top at 0 m"
        " [empty-range]"
    ]


# All at once


def test_every_mistake_is_reported_in_the_order_of_the_file(
    refused: Callable[..., list[str]],
) -> None:
    change("name: bad", "name: b/d")
    change("use: orca", "use: orka")
    change("takeoff:", "takeof:")
    change("- land: {}", "- land")
    places = [line.split(": ")[0] for line in refused("check", "m.yaml")]
    assert places == ["m.yaml:2:7", "m.yaml:12:16", "m.yaml:14:5", "m.yaml:16:5"]


def test_mission_and_world_problems_are_reported_at_once(refused: Callable[..., list[str]]) -> None:
    change("seed: 7", "sead: 7")
    change("fence:", "fense:", "worlds/room.yaml")
    files = {line.split(":")[0] for line in refused("check", "m.yaml")}
    assert files == {"m.yaml", "worlds/room.yaml"}
