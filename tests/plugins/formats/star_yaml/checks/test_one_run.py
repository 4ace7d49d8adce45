"""One run reports mistakes of every kind, and nothing that only follows from them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.plugins.formats.star_yaml.problems import problems

WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
obstacles:
  shelf: {box: {centre: [-1, 0], size: [0.4, 0.4]}, height: [1.2, 1.6]}
"""
MISSION = """\
star: 1
name: m
world: room.yaml
limits: {speed: 0.5}
swarm:
  cf1: {start: [-1, 0, 0]}
  cf2: {start: [0, 0, 0]}
  cf3: {start: [1, 0, 0]}
groups: {pair: [cf1, cf2]}
transport: sim
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {height: 0.8}
  - goto: {agents: pair, to: [0, 1, 0.8]}
  - land: {}
"""


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("room.yaml").write_text(WORLD)


def mistakes(*changes: tuple[str, str], world: str = WORLD) -> list[str]:
    """Return the problems of the mission with these texts replaced."""
    mission = MISSION
    for old, new in changes:
        assert mission.count(old) == 1
        mission = mission.replace(old, new)
    Path("room.yaml").write_text(world)
    return problems(mission)


def test_one_run_reports_all_kinds_of_problems_in_file_order() -> None:
    locations = mistakes(
        ("speed: 0.5", "speed: fast"),  # schema
        ("[cf1, cf2]", "[cf1, cf9]"),  # reference
        ("takeoff: {height: 0.8}", "takeoff: {height: 1.4}"),  # feasibility: into the shelf
        (
            "goto: {agents: pair, to: [0, 1, 0.8]}",
            "goto: {agents: cf3, to: [0, 5, 0.8]}",
        ),  # feasibility
        ("  - land: {}", "  - land: {}\n  - goto: {by: [0, 0.2, 0]}\n  - lnad: {}"),
    )  # airborne state, schema
    assert locations == [
        "4:17 [wrong-type]",
        "9:22 [unknown-agent]",
        "15:5 [inside-obstacle]",
        "16:29 [unreachable-goal]",
        "18:5 [wrong-airborne-state]",
        "19:5 [unknown-verb]",
    ]


def test_references_are_checked_although_the_world_is_invalid() -> None:
    locations = mistakes(
        ("[cf1, cf2]", "[cf1, cf9]"),
        ("avoider: orca", "avoider: orka"),
        ("land: {}", "land: {agents: cf8}"),
        world=WORLD.replace("high: [2, 2, 2]", "high: [2, 2]"),
    )
    assert locations == [
        "9:22 [unknown-agent]",
        "13:10 [unknown-plugin]",
        "17:20 [unknown-agent]",
        "room.yaml:3:33 [wrong-length]",
    ]


def test_steps_are_checked_although_the_world_file_is_missing() -> None:
    locations = mistakes(("room.yaml", "rom.yaml"), ("  - takeoff: {height: 0.8}\n", ""))
    assert locations == ["3:8 [file-not-found]", "15:5 [wrong-airborne-state]"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("cf1: {start: [-1, 0, 0]}", "cf1: {start: here}"),
        ("cf1: {start: [-1, 0, 0]}", "cf1: {}"),
        ("cf1: {start: [-1, 0, 0]}", "cf1: 5"),
        ("cf1: {start: [-1, 0, 0]}", "cf1: {start: [-1, 0, 0], camra: aideck}"),
        ("groups: {pair: [cf1, cf2]}", "groups: {pair: cf1}"),
        ("groups: {pair: [cf1, cf2]}", "groups: [cf1, cf2]"),
        ("groups: {pair: [cf1, cf2]}", "groups: {pair: [cf1, cf22]}"),
        ("limits: {speed: 0.5}", "limits: {height: 1.8}"),
        ("limits: {speed: 0.5}", "limits: 0.5"),
        ("avoider: orca", "avoider: {use: orca, radius: wide}"),
        ("avoider: orca", "avoider:"),
        ("planner: straight", "planner: strait"),
        ("takeoff: {height: 0.8}", "takeof: {height: 0.8}"),
        ("takeoff: {height: 0.8}", "takeoff: {height: high}"),
        ("takeoff: {height: 0.8}", "takeoff: {hieght: 0.8}"),
        ("takeoff: {height: 0.8}", "takeoff: {agents: [cf1, cf2, cf4]}"),
        ("takeoff: {height: 0.8}", "takeoff"),
        ("takeoff: {height: 0.8}", "parallel: []"),
        ("takeoff: {height: 0.8}", "repeat: {steps: [takeoff: {}]}"),
        ("takeoff: {height: 0.8}", "each: {agent: cf1, steps: [takeoff: {}]}"),
        ("takeoff: {height: 0.8}", "include: {file: up.yaml}"),
    ],
)
def test_nothing_is_reported_that_follows_from_another_mistake(old: str, new: str) -> None:
    first = mistakes((old, new))
    assert len({problem.partition(":")[0] for problem in first}) == 1
    last = ("  - land: {}", "  - land: {}\n  - goto: {to: [0, 0, 0.8]}")
    assert mistakes((old, new), last) == [*first, "18:5 [wrong-airborne-state]"]
