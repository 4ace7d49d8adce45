"""Crazyswarm2's robots and trajectories."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from star_core import InputError, Registry, fly, load
from star_core.toolkit import actions
from tests.commands import command
from tests.plugins.formats.star_import.conftest import ROBOTS, Import

main = command("import")

Put = Callable[[str, str], str]
ORDER = range(8)
HEADER = "Duration," + ",".join(f"{axis}^{i}" for axis in ("x", "y", "z", "yaw") for i in ORDER)


def trajectory(way: float, duration: float) -> str:
    """There and back along y, at rest at both ends of either."""
    lines = [HEADER]
    for start, length in ((0.0, way), (way, -way)):
        y = [start, 0, 0, *(f * length / duration**k for f, k in ((10, 3), (-15, 4), (6, 5))), 0, 0]
        lines.append(",".join(map(str, [duration, *[0] * 8, *y, *[0] * 16])))
    return "\n".join(lines) + "\n"


def test_robots_become_agents_with_their_links(place: Put, take: Import) -> None:
    place("crazyflies.yaml", ROBOTS)
    take("crazyflies.yaml")
    agents = load(Path("imported/crazyflies.yaml"), Registry()).scene.agents
    assert [(a.name, a.start, a.uri) for a in agents] == [
        ("cf1", (-1.0, 0.0, 0.0), "radio://0/80/2M/E7E7E7E701"),
        ("cf2", (0.0, 0.0, 0.0), "radio://0/80/2M/E7E7E7E702"),
    ]


def test_what_is_left_out_of_robots_is_reported(place: Put, take: Import) -> None:
    place("crazyflies.yaml", ROBOTS + "all: {firmware_logging: {enabled: true}}\n")
    told = take("crazyflies.yaml")
    assert "crazyflies.yaml:4:8: cf3 is not enabled; ignored" in told
    assert "crazyflies.yaml:7:25: all: 'firmware_logging' is not supported; ignored" in told
    assert [line for line in told if "type a: voltage_critical 3.7 V has no effect" in line]


def test_agents_that_start_near_each_other_have_a_smaller_radius(place: Put, take: Import) -> None:
    place("crazyflies.yaml", ROBOTS.replace("[-1.0, 0.0, 0.0]", "[-0.3, 0.0, 0.0]"))
    told = take("crazyflies.yaml")
    assert (
        "crazyflies: agents start 0.3 m apart; the avoider's radius is 0.15 m instead of 0.2"
        in told
    )


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("[-1.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]",
         "crazyflies.yaml:3:8: as STAR reads it: 'cf2' starts 0.00 m from 'cf1', closer than twice "
         "avoider.radius (0.40 m) [too-close]"),
        ("initial_position: [-1.0, 0.0, 0.0]", "a: 1",
         "crazyflies.yaml:2:8: has no 'initial_position' [missing-option]"),
        ("[-1.0, 0.0, 0.0]", "[-1.0, 0.0]",
         "crazyflies.yaml:2:75: cf1 has 2 numbers, expected x, y and z [invalid-input]"),
        ("  cf1:", "  1cf:",
         "crazyflies.yaml:2:8: '1cf' cannot be an agent's name, expected a letter, then letters, "
         "digits, '_' and '-', and not 'all' [invalid-input]"),
        ("type: a}\n  cf2", "type: b}\n  cf2", "crazyflies.yaml:2:99: no type 'b' among a"
         " [invalid-input]"),
    ],
)  # fmt: skip
def test_robots_that_cannot_be_expressed_are_refused(
    place: Put, take: Import, old: str, new: str, expected: str
) -> None:
    place("crazyflies.yaml", ROBOTS.replace(old, new, 1))
    with pytest.raises(InputError) as raised:
        take("crazyflies.yaml")
    assert list(raised.value.problems) == [expected]


def test_an_agent_that_is_named_twice_is_refused(place: Put, take: Import) -> None:
    place("crazyflies.yaml", ROBOTS)
    with pytest.raises(InputError, match="--agent cf1=2,2: another agent is named 'cf1' too"):
        take("crazyflies.yaml", "--agent", "cf1=2,2")


def test_no_agent_enabled_is_refused(place: Put, take: Import) -> None:
    place("crazyflies.yaml", ROBOTS.replace("enabled: true", "enabled: false"))
    with pytest.raises(InputError, match=r"crazyflies\.yaml:2:3: no robot is enabled"):
        take("crazyflies.yaml")


def test_a_trajectory_is_copied_and_followed(place: Put, take: Import) -> None:
    place("eight.csv", trajectory(0.5, 4.0))
    told = take("eight.csv", "--agent", "cf1=0,0")
    assert (
        "eight.csv: durations in s, x, y and z in m, yaw in rad; flown by all, each from its "
        "position" in told
    )
    mission = load(Path("imported/eight.yaml"), Registry())
    assert [a.verb for a in actions(mission.steps)] == ["takeoff", "follow", "land"]
    assert Path("imported/paths/eight.csv").read_text("utf-8") == trajectory(0.5, 4.0)


def test_an_imported_trajectory_flies(place: Put, take: Import) -> None:
    place("eight.csv", trajectory(0.5, 2.0))
    take("eight.csv", "--agent", "cf1=0,0", "--agent", "cf2=1,0")
    summary = fly(load(Path("imported/eight.yaml"), Registry()), Registry())
    assert summary["outcome"] == "completed"


def test_excessively_fast_trajectories_suggest_a_timescale(place: Put, take: Import) -> None:
    place("eight.csv", trajectory(2.0, 4.0))
    with pytest.raises(InputError) as raised:
        take("eight.csv", "--agent", "cf1=0,0")
    (problem,) = raised.value.problems
    assert problem == (
        "eight.csv: as STAR reads it: eight.csv:2: 2.00 s after its start it flies 0.94 m/s, "
        "faster than limits.speed of 0.5 m/s; timescale: 1.88 would fit [out-of-range]"
    )
    take("eight.csv", "--agent", "cf1=0,0", "--timescale", "1.88")


def test_a_trajectory_that_is_not_there_is_reported(take: Import) -> None:
    with pytest.raises(InputError, match=r"no\.csv: no such file"):
        take("no.csv")


def test_every_voltage_of_a_battery_is_reported(place: Put, take: Import) -> None:
    both = "{voltage_critical: 3.7, voltage_warning: 3.8}"
    place("crazyflies.yaml", ROBOTS.replace("{voltage_critical: 3.7}", both))
    told = take("crazyflies.yaml")
    assert [line for line in told if "type a: voltage_critical 3.7 V has no effect" in line]
    assert [line for line in told if "type a: 'voltage_warning' is not supported; ignored" in line]


def test_numbers_that_are_in_no_file_are_reported(place: Put, take: Import) -> None:
    place("crazyflies.yaml", ROBOTS)
    limits = "limits.speed 0.5 m/s, limits.height 0.2 to 2 m"
    told = take("crazyflies.yaml")
    assert f"crazyflies: numbers not in the files: {limits}" in told
    up, go = '"takeoff", "wait", "all", "", ""', '"goto", "wait", "all", "", "0 0 1 0"'
    place("m.yaml", f"command_sequence: [{up}, {go}]")
    told = take("m.yaml", "crazyflies.yaml", "--force")
    assert (
        "m: numbers not in the files: limits.speed 0.2 m/s, limits.height 0.5 to 2 m, of goto: "
        "speed 0.1 m/s, within 0.2 m, spacing 0.4 m where several fly to one position" in told
    )


def test_missing_agents_are_reported_even_without_any_agent(place: Put) -> None:
    place("m.yaml", 'command_sequence: ["land", "wait", "cf2", "", ""]')
    with pytest.raises(InputError, match="no agent named 'cf2'; add its position: --agent"):
        main(["m.yaml"])
