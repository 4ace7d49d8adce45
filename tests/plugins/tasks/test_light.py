"""The verb ``light``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

import star_verbs
import star_yaml
from star_core import InputError, Registry, fly, load
from star_core.testing import scene
from tests.core.conftest import Lab
from tests.core.robots import Robots

MISSION = """\
star: 1
name: lights
world: {WORLD}
limits: {{speed: 0.5, height: [0.2, 1.8]}}
swarm: {{cf1: {{start: [0, 0, 0]}}, cf2: {{start: [0, 1, 0]}}}}
transport: sim
localizer: flow
planner: straight
avoider: orca
mission:
  - light: {{color: {COLOR}}}
"""


class LitRobots(Robots):
    """Robots with parameters, which are kept as they are set."""

    sets: list[tuple[tuple[int, ...], dict[str, float]]]

    def set_parameters(self, rows: Sequence[int], values: Mapping[str, float]) -> None:
        self.sets.append((tuple(rows), dict(values)))


@pytest.mark.parametrize(
    ("color", "rgb"), [("orange", (255, 128, 0)), ("#0A0b0c", (10, 11, 12)), ("off", (0, 0, 0))]
)
def test_a_light_sets_rings_and_color_decks(
    make: Any, color: str, rgb: tuple[int, int, int]
) -> None:
    output = make("light", scene(2), (0, 1), color=color).step(None, None)
    red, green, blue = rgb
    whole = (red * 256 + green) * 256 + blue
    assert output.parameters == {
        "ring.effect": 7,
        "ring.solidRed": red,
        "ring.solidGreen": green,
        "ring.solidBlue": blue,
        "colorLedBot.wrgb8888": whole,
        "colorLedTop.wrgb8888": whole,
    }


def test_the_agents_of_a_step_are_lit_once(tmp_path: Path) -> None:
    lab = Lab(tmp_path)
    lab.robots_class = LitRobots
    LitRobots.sets = []
    lab.registry = Registry(star_yaml, star_verbs, lab, installed=False)
    steps = "\n  - light: {agents: cf2, color: blue}\n  - light: {color: off}\n"
    summary = fly(lab.load(steps), lab.registry)
    assert summary["outcome"] == "completed", summary["reason"]
    lit = [(rows, values["colorLedBot.wrgb8888"]) for rows, values in LitRobots.sets]
    assert lit == [((1,), 255), ((0, 1), 0)]


def test_a_color_that_is_unknown_is_located(tmp_path: Path) -> None:
    path = tmp_path / "lights.yaml"
    (tmp_path / "room.yaml").write_text(
        "star: 1\nname: room\nfence: {low: [-2, -2, 0], high: [2, 2, 2]}\n"
    )
    path.write_text(MISSION.format(WORLD="room.yaml", COLOR="reed"))
    with pytest.raises(InputError, match=r"lights\.yaml:11:20: .*reed.*expected '#rrggbb' or one"):
        load(path, Registry())
