"""Crazyswarm2's robots and trajectories."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core import InputError, Registry, fly, load
from star_core.toolkit import Parallel, actions
from tests.plugins.formats.star_import.conftest import ROBOTS, Import, place, refusals

ORDER = range(8)
HEADER = "Duration," + ",".join(f"{axis}^{i}" for axis in ("x", "y", "z", "yaw") for i in ORDER)


def trajectory(way: float, duration: float) -> str:
    """There and back along y, at rest at both ends of either."""
    lines = [HEADER]
    for start, length in ((0.0, way), (way, -way)):
        y = [start, 0, 0, *(f * length / duration**k for f, k in ((10, 3), (-15, 4), (6, 5))), 0, 0]
        lines.append(",".join(map(str, [duration, *[0] * 8, *y, *[0] * 16])))
    return "\n".join(lines) + "\n"


def test_robots_become_agents_with_their_links(take: Import) -> None:
    place("crazyflies.yaml", ROBOTS)
    take("crazyflies.yaml")
    agents = load(Path("imported/crazyflies.yaml"), Registry()).scene.agents
    assert [(a.name, a.start, a.uri) for a in agents] == [
        ("cf1", (-1.0, 0.0, 0.0), "radio://0/80/2M/E7E7E7E701"),
        ("cf2", (0.0, 0.0, 0.0), "radio://0/80/2M/E7E7E7E702"),
    ]


def test_what_is_left_out_of_robots_is_reported(take: Import) -> None:
    place("crazyflies.yaml", ROBOTS + "all: {firmware_logging: {enabled: true}}\n")
    told = take("crazyflies.yaml")
    assert "ignored crazyflies.yaml:4:8: cf3: is not enabled" in told
    assert "ignored crazyflies.yaml:7:25: all.firmware_logging: is not supported" in told
    assert [line for line in told if "a: voltage_critical has no effect" in line]


def test_agents_that_start_near_each_other_have_a_smaller_radius(take: Import) -> None:
    place("crazyflies.yaml", ROBOTS.replace("[-1.0, 0.0, 0.0]", "[-0.3, 0.0, 0.0]"))
    told = take("crazyflies.yaml")
    radius = "the avoider's radius is 0.15 m instead of 0.2"
    assert f"changed crazyflies: agents start 0.3 m apart; {radius}" in told


def test_an_agent_that_is_named_twice_is_refused() -> None:
    place("crazyflies.yaml", ROBOTS)
    refused = refusals("crazyflies.yaml", "--agent", "cf1=2,2")
    assert refused == ["--agent cf1=2,2 [invalid-input]"]


def test_a_trajectory_is_copied_and_followed(take: Import) -> None:
    place("eight.csv", trajectory(0.5, 4.0))
    told = take("eight.csv", "--agent", "cf1=0,0")
    units = "durations are in s, positions in m, yaw in rad; relative to where an agent is"
    assert f"assumed paths: {units}" in told
    mission = load(Path("imported/eight.yaml"), Registry())
    assert [a.verb for a in actions(mission.steps)] == ["takeoff", "follow", "land"]
    assert Path("imported/paths/eight.csv").read_text("utf-8") == trajectory(0.5, 4.0)


def test_two_trajectories_of_one_name_are_refused() -> None:
    Path("other").mkdir()
    files = [place(name, trajectory(0.5, 4.0)) for name in ("eight.csv", "other/eight.csv")]
    assert refusals(*files, "--agent", "cf1=0,0") == ["other/eight.csv [invalid-input]"]


def test_excessively_fast_trajectories_suggest_a_timescale(take: Import) -> None:
    place("eight.csv", trajectory(2.0, 4.0))
    with pytest.raises(InputError) as raised:
        take("eight.csv", "--agent", "cf1=0,0")
    (problem,) = raised.value.problems
    assert problem == (
        "eight.csv: as STAR reads it: eight.csv:2: 2.00 s after its start it flies 0.94 m/s, "
        "faster than limits.speed of 0.5 m/s; timescale: 1.88 would fit [out-of-range]"
    )
    take("eight.csv", "--agent", "cf1=0,0", "--timescale", "1.88")


@pytest.mark.parametrize("name", ["no.csv", "no.yaml"])
def test_a_file_that_is_not_there_is_reported(name: str) -> None:
    assert refusals(name) == [f"{name} [invalid-input]"]


def test_every_voltage_of_a_battery_is_reported(take: Import) -> None:
    both = "{voltage_critical: 3.7, voltage_warning: 3.8}"
    place("crazyflies.yaml", ROBOTS.replace("{voltage_critical: 3.7}", both))
    told = take("crazyflies.yaml")
    assert [line for line in told if "a: voltage_critical has no effect" in line]
    assert [line for line in told if "types.battery.voltage_warning: is not supported" in line]


def test_numbers_that_are_in_no_file_are_reported(take: Import) -> None:
    place("crazyflies.yaml", ROBOTS)
    told = take("crazyflies.yaml")
    assert "assumed limits: speed 0.5 m/s, heights 0.2 to 2 m: no config.yaml" in told
    up, go = '"takeoff", "wait", "all", "", ""', '"goto", "wait", "all", "", "0 0 1 0"'
    place("m.yaml", f"command_sequence: [{up}, {go}]")
    told = take("m.yaml", "crazyflies.yaml", "--force")
    assert "assumed limits: speed 0.2 m/s, heights 0.5 to 2 m: no config.yaml" in told


def test_trajectories_of_agents_are_flown_at_once(take: Import) -> None:
    place("crazyflies.yaml", ROBOTS)
    place("one.csv", trajectory(0.5, 4.0))
    place("two.csv", trajectory(0.4, 4.0))
    chosen = ("--trajectory", "cf1=one.csv", "--trajectory", "cf2=two.csv")
    take("crazyflies.yaml", *chosen, "--acceleration", "1.5")
    mission = load(Path("imported/crazyflies.yaml"), Registry())
    assert mission.scene.limits.acceleration == 1.5
    _, both, _ = mission.steps
    assert isinstance(both, Parallel)
    assert [(step.rows, step.written["file"]) for step in actions([both])] == [
        ((0,), "paths/one.csv"),
        ((1,), "paths/two.csv"),
    ]
    assert fly(mission, Registry())["outcome"] == "completed"


@pytest.mark.parametrize(
    ("option", "problem"),
    [
        ("cf9=one.csv", "--trajectory cf9 [unknown-agent]"),
        ("cf1", "--trajectory cf1 [invalid-input]"),
        ("cf1=no.csv", "--trajectory cf1=no.csv [file-not-found]"),
    ],
)
def test_trajectories_of_no_agent_are_refused(option: str, problem: str) -> None:
    place("crazyflies.yaml", ROBOTS)
    place("one.csv", trajectory(0.5, 4.0))
    assert refusals("crazyflies.yaml", "--trajectory", option) == [problem]


def with_gap(gap: float) -> str:
    """Two pieces along y, the second of which begins `gap` m beyond the end of the first."""
    header, first, second = trajectory(0.5, 4.0).splitlines()
    cells = second.split(",")
    cells[9] = str(float(cells[9]) + gap)
    return "\n".join([header, first, ",".join(cells)]) + "\n"


def test_gaps_are_bridged_on_request(take: Import) -> None:
    place("gap.csv", with_gap(0.3))
    assert refusals("gap.csv", "--agent", "cf1=0,0") == ["gap.csv [invalid-trajectory]"]
    notes = take("gap.csv", "--agent", "cf1=0,0", "--bridge-gaps")
    assert "changed gap.csv: gaps are bridged by 1 pieces more" in notes
    mission = load(Path("imported/gap.yaml"), Registry())
    _, _, bridge, _ = Path("imported/paths/gap.csv").read_text("utf-8").splitlines()
    time, *coefficients = map(float, bridge.split(","))
    y = coefficients[8:16]
    assert time == 1.5
    assert y[0] == pytest.approx(0.5)
    assert sum(c * time**k for k, c in enumerate(y)) == pytest.approx(0.8)
    assert y[1] == pytest.approx(0.0, abs=1e-6)
    assert sum(k * c * time ** (k - 1) for k, c in enumerate(y)) == pytest.approx(0, abs=1e-6)
    assert fly(mission, Registry())["outcome"] == "completed"


def test_pieces_that_a_drone_cannot_hold_are_refused_by_name(take: Import) -> None:
    header, *pieces = trajectory(0.2, 2.0).splitlines()
    place("long.csv", "\n".join([header, *(pieces * 16)]) + "\n")
    agent = ("--agent", "cf1=0,0")
    assert refusals("long.csv", *agent, "--on-board") == ["long.csv [invalid-trajectory]"]
    take("long.csv", *agent)
    place("short.csv", trajectory(0.2, 2.0))
    take("short.csv", *agent, "--on-board")
    (step,) = [s for s in actions(load(Path("imported/short.yaml"), Registry()).steps)
               if s.verb == "follow"]  # fmt: skip
    assert step.written["on_board"]
