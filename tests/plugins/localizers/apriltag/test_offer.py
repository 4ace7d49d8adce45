"""Spec of the localizer: its options, and checks of missions in which no tag is visible."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import star_apriltag
from star_core import Scene
from star_core.toolkit import fill_defaults
from tests.plugins.localizers.apriltag.conftest import Circle, room, sheets

SCENE = room([Circle(1)], sheets())


def problems(scene: Scene, **changes: Any) -> list[tuple[tuple[str | int, ...], str]]:
    mistakes = star_apriltag.check(scene, **fill_defaults(changes, star_apriltag.OPTIONS))
    return [(problem.path, problem.code) for problem in mistakes]


def test_missions_in_which_no_tag_is_visible_are_refused() -> None:
    assert problems(room([Circle(1)], [])) == [((), "no-tags")]
    assert problems(room([Circle(1)], sheets(), camera=None)) == [((), "missing-camera")]
    (seeing,) = SCENE.agents
    both = replace(SCENE, agents=(seeing, replace(seeing, name="cf2", camera=None)))
    assert problems(both) == []


def test_a_batch_has_nothing_to_send_back() -> None:
    conflict = [(("feedback",), "option-conflict")]
    assert problems(SCENE, method="batch", feedback="extpose") == conflict
