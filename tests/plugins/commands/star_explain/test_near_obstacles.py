"""Starts and landings beside obstacles."""

from __future__ import annotations

import pytest

from tests.plugins.commands.star_explain.conftest import HALL, Warn

WORLD = f"""\
{HALL}obstacles:
  wall: {{box: {{centre: [2, 0], size: [0.2, 4]}}, height: [0, 1.5]}}
  beam: {{box: {{centre: [-2, 0], size: [0.2, 4]}}, height: [1.6, 2]}}
"""
MISSION = """\
star: 1
name: beside
world: hall.yaml
swarm: {cf1: {start: [0, 0, 0]}}
transport: {use: sim, profile: ideal, controller: ideal, noise: false}
localizer: flow
planner: straight
avoider: none
mission:
  - takeoff: {height: 0.8}
  - goto: {to: [0, 1, 0.8]}
  - land: {}
"""
ORCA = "avoider={use: orca, clearance: 0.3}"


@pytest.mark.parametrize(
    ("start", "goal", "changes", "warning"),
    [
        ("0, 0, 0", "0, 1, 0.8", (), ""),
        ("1.81, 0, 0", "0, 1, 0.8", (),
         "4:22: warning: cf1 starts 0.09 m from obstacle 'wall', nearer than 0.1 m: it may touch "
         "it as it takes off and lands [start-near-obstacle]"),
        ("1.75, 0, 0", "0, 1, 0.8", (), ""),
        ("1.75, 0, 0", "0, 1, 0.8", ("planner={use: visibility, clearance: 0.3}",),
         "cf1 starts 0.15 m from obstacle 'wall', nearer than 0.3 m"),
        ("1.75, 0, 0", "0, 1, 0.8", ("avoider={use: voronoi, radius: 0.2}",),
         "cf1 starts 0.15 m from obstacle 'wall', nearer than 0.2 m"),
        ("1.75, 0, 0", "0, 1, 0.8", ("avoider={use: orca, radius: 0.2}",),
         "cf1 starts 0.15 m from obstacle 'wall', nearer than 0.2 m"),
        ("1.75, 0, 0", "0, 1, 0.8", ("avoider={use: orca, radius: 0.2, clearance: 0.1}",), ""),
        ("-2, 0, 0", "0, 1, 0.8", (), ""),  # 0.8 m below the beam
        ("0, 0, 0", "1.72, 1, 0.8", (), ""),
        ("0, 0, 0", "1.72, 1, 0.8", (ORCA,),
         "12:11: warning: cf1 lands 0.25 m from obstacle 'wall', nearer than 0.3 m: it may touch "
         "it [landing-near-obstacle]"),
    ],
)  # fmt: skip
def test_starts_and_landings_beside_obstacles_are_warned_of(
    warn: Warn, start: str, goal: str, changes: tuple[str, ...], warning: str
) -> None:
    text = MISSION.replace("[0, 0, 0]", f"[{start}]").replace("[0, 1, 0.8]", f"[{goal}]")
    near = [text for text in warn(text, *changes, world=WORLD) if "-near-obstacle]" in text]
    assert len(near) == bool(warning)
    assert warning in "".join(near)


def test_virtual_obstacles_are_not_warned_of(warn: Warn) -> None:
    virtual = WORLD.replace("1.5]}", "1.5], virtual: true}")
    assert warn(MISSION.replace("[0, 0, 0]", "[2, 0, 0]"), world=virtual) == []
