"""What ``star check`` warns of where margins for uncertain positions leave no room to pass."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pytest

from star_core import Registry
from star_core.formats import check_file
from star_explain.jam import crowd
from tests.plugins.commands.star_explain.conftest import Warn

Lanes: TypeAlias = Callable[..., list[str]]

WORLD = "star: 1\nname: hall\nfence: {low: [-20, -20, 0], high: [20, 20, 3]}\n"
MISSION = """\
star: 1
name: lanes
world: hall.yaml
swarm:
SWARM
transport: sim
localizer: flow
planner: straight
avoider: orca
groups: {west: [WEST], east: [EAST]}
mission:
  - takeoff: {height: 0.8}
  - hold: {for: 30}
  - parallel:
      - goto: {agents: west, by: [12, 0, 0]}
      - goto: {agents: east, by: [-12, 0, 0]}
  - land: {}
"""


@pytest.fixture
def warnings(warn: Warn) -> Lanes:
    """Return the warnings of two blocks that fly through each other, lane beside lane."""

    def warned(*changes: str, pitch: float = 0.75, lanes: int = 6) -> list[str]:
        groups: dict[str, list[str]] = {"west": [], "east": []}
        swarm = []
        for lane in range(lanes):
            side, sign = ("west", -1) if lane % 2 else ("east", 1)
            for row in range(6):
                groups[side].append(f"{side}{lane}_{row}")
                start = f"[{sign * (6 + row)}, {pitch * lane:g}, 0]"
                swarm.append(f"  {groups[side][-1]}: {{start: {start}}}")
        text = MISSION.replace("SWARM", "\n".join(swarm))
        for side, names in groups.items():
            text = text.replace(side.upper(), ", ".join(names))
        messages = warn(text, *changes, world=WORLD)
        return [text for text in messages if "margins-exceed-paths" in text]

    return warned


def test_lanes_narrower_than_the_margins_are_warned_of(warnings: Lanes) -> None:
    (text,) = warnings()
    assert text.split(": warning: ")[0].endswith("m.yaml:42:12")
    assert "they keep 1.20 m apart from about" in text


@pytest.mark.parametrize(
    "change", ["limits.uncertainty_margin=0", "transport.noise=false", "avoider={use: none}"]
)
def test_exact_positions_and_smaller_distances_are_not(warnings: Lanes, change: str) -> None:
    assert warnings(change) == []


def test_wide_lanes_are_not(warnings: Lanes) -> None:
    assert warnings(pitch=2.0) == []


def test_more_than_a_hundred_agents_are_compared(warnings: Lanes) -> None:
    assert len(warnings(lanes=18)) == 1


def test_an_agent_between_two_that_come_cannot_make_way() -> None:
    position = np.array([[0.0, 0, 1], [0.2, 0.7, 1], [0.2, -0.8, 1], [5, 5, 1]])
    velocity = np.array([[0.5, 0, 0], [-0.5, 0, 0], [-0.5, 0, 0], [0, 0, 0]])
    airborne, margin = np.ones(4, np.bool_), np.full(4, 0.4)
    moving, distance, kept = crowd(position, velocity, airborne, margin, 0.4, 0.6)
    assert moving == 3
    assert distance == pytest.approx([np.hypot(0.2, 0.8)])
    assert kept == pytest.approx([1.2])
    assert len(crowd(position, 0.5 + 0 * velocity, airborne, margin, 0.4, 0.6)[1]) == 0
    assert len(crowd(position, velocity, airborne, 0 * margin, 0.4, 0.6)[1]) == 0


@pytest.mark.parametrize(
    ("changes", "warned"),
    [
        (["avoider=voronoi"], True),
        (["avoider=potential"], True),
        (["avoider=orca"], False),
        (["avoider=none"], False),
        (["avoider=voronoi", "limits.uncertainty_margin=0"], False),
        (["avoider=voronoi", "transport.noise=false"], False),
        (
            [
                "avoider=voronoi",
                "localizer=mocap",
                "transport={use: sim, noise: false, positioning: {std: 0.03}}",
            ],
            True,
        ),
    ],
)
def test_avoiders_for_exact_positions_are_warned_of(
    missions: Path, changes: list[str], *, warned: bool
) -> None:
    messages = check_file(missions / "first_flight.yaml", Registry(), changes)[1]
    assert any("avoider-needs-exact-positions" in text for text in messages) == warned
