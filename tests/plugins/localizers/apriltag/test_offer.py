"""Spec of the localizer: its options, and checks of missions in which no tag is visible."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import star_apriltag
from star_core import Localizer, Problem, Scene
from star_core.plugin_support.registry import Registry
from star_core.toolkit import fill_defaults
from tests.plugins.localizers.apriltag.conftest import Circle, localizer, room, sheets

SCENE = room([Circle(1)], sheets())


def test_it_is_a_localizer() -> None:
    assert isinstance(localizer(SCENE), Localizer)


def test_it_is_offered_by_its_name() -> None:
    (offer,) = star_apriltag.star_localizers()
    assert offer.name == "apriltag"
    assert "apriltag" in Registry().offers()["localizer"]


def problems(scene: Scene, **changes: Any) -> list[Problem]:
    return list(star_apriltag.check(scene, **fill_defaults(changes, star_apriltag.OPTIONS)))


def test_a_world_without_landmarks_leaves_it_blind() -> None:
    (problem,) = problems(room([Circle(1)], []))
    assert problem.code == "no-tags"


def test_agents_without_a_camera_leave_it_blind() -> None:
    (problem,) = problems(room([Circle(1)], sheets(), camera=None))
    assert problem.code == "missing-camera"


def test_one_agent_with_a_camera_is_enough() -> None:
    (seeing,) = SCENE.agents
    both = replace(SCENE, agents=(seeing, replace(seeing, name="cf2", camera=None)))
    assert not problems(both)


def test_a_batch_has_nothing_to_send_back() -> None:
    (problem,) = problems(SCENE, method="batch", feedback="extpose")
    assert problem[:2] == (("feedback",), "'extpose' goes with method: filter only")
