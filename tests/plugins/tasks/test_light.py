"""The verb ``light``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

import star_verbs
import star_yaml
from star_core import InputError, Registry, fly, load
from star_core.testing import scene
from tests.core.conftest import Lab
from tests.core.robots import Robots
from tests.plugins.mission_files import write_mission
from tests.plugins.tasks.conftest import make


class LitRobots(Robots):
    """Robots with parameters, which are kept as they are set."""

    sets: list[tuple[tuple[int, ...], dict[str, float]]]

    def set_parameters(self, rows: Sequence[int], values: Mapping[str, float]) -> None:
        self.sets.append((tuple(rows), dict(values)))


@pytest.mark.parametrize(
    ("color", "rgb"), [("orange", (255, 128, 0)), ("#0A0b0c", (10, 11, 12)), ("off", (0, 0, 0))]
)
def test_a_light_sets_rings_and_color_decks(color: str, rgb: tuple[int, int, int]) -> None:
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
    path = write_mission(tmp_path, "  - light: {color: reed}\n")
    with pytest.raises(InputError, match=r"flight\.yaml:10:20: .*reed.*expected '#rrggbb' or one"):
        load(path, Registry())
