"""Agents that come nearer to others, obstacles or the fence than the drift of positions permits."""

from __future__ import annotations

import re
from functools import partial

import numpy as np
import pytest

from star_core import AgentPhase
from star_core.toolkit import Rehearsal
from tests.plugins.commands.star_explain.conftest import HALL, Warn

MISSION = """\
star: 1
name: hover
world: hall.yaml
swarm:
  cf1: {start: [0, 0, 0]}
  cf2: {start: [1.2, 0, 0]}
transport: sim
localizer: {use: flow}
planner: straight
avoider: orca
mission:
  - takeoff: {height: 0.8}
  - hold: {for: 5}
  - land: {}
"""


@pytest.fixture
def warnings(warn: Warn) -> Warn:
    """Return the warnings of a hover with some changes."""
    return partial(warn, MISSION)


@pytest.mark.parametrize("changes", [(), ("mission=[{hold: {}}]",)])
def test_short_flights_and_agents_on_the_ground_are_safe(
    warnings: Warn, changes: tuple[str, ...]
) -> None:
    assert warnings(*changes) == []


@pytest.mark.parametrize(
    "change", ["mission.1.hold.for=60", "swarm.cf2.start=[0.5, 0, 0]", "localizer.error_std=0.5"]
)
def test_flights_too_long_too_near_or_too_inexact_are_warned_of(
    warnings: Warn, change: str
) -> None:
    (warning,) = warnings(change)
    assert warning.split(": warning: ")[0].endswith("m.yaml:8:12")
    assert "cf1, cf2 are" in warning
    assert warning.endswith("[drift-exceeds-separation]")


@pytest.mark.parametrize(
    "change",
    [
        "swarm.cf2.start=[6, 0, 0]",
        "limits.uncertainty_margin=0",
        "limits.separation=0",
        "transport.noise=false",
    ],
)
def test_distant_or_exactly_located_agents_give_no_warning(warnings: Warn, change: str) -> None:
    assert warnings("mission.1.hold.for=60", change) == []


def test_repeated_steps_count_as_often_as_they_are_flown(warnings: Warn) -> None:
    steps = "mission.1={repeat: {times: %d, steps: [{hold: {for: 5}}]}}"
    assert warnings(steps % 1) == []
    assert re.search(r"after about [67]\d s", warnings(steps % 12)[0])


def test_between_moments_an_agent_is_on_the_line() -> None:
    x = np.array([0.0, 1.0, 0.0, 1.0, 0.0])
    position = np.stack([x, 0 * x, 0 * x + 1], axis=1)[:, None]
    yaw, phase = np.zeros((5, 1)), np.full((5, 1), int(AgentPhase.FLYING))
    rehearsal = Rehearsal((), np.arange(5.0), position, 0 * position, yaw, phase)
    times, sampled, _, airborne = rehearsal.sampled(0.5)
    assert times[-1] >= 4.0
    assert sampled[:8, 0, 0] == pytest.approx([0, 0.5, 1, 0.5, 0, 0.5, 1, 0.5])
    assert airborne.all()


ALONE = ("swarm={cf1: {start: [0, 0, 0]}}", "mission.1={hold: {at: [3, 0, 0.8], for: 40}}")
PILLAR = "obstacles: {pillar: {box: {centre: [4.0, 0], size: [0.8, 0.8]}, height: [0, 3]}}\n"
TAGS = "landmarks: {start: {tags: [1], at: [0.8, 0, 0]}, goal: {tags: [2], at: [3.45, 0, 0]}}\n"
BY_TAGS = ("localizer=apriltag", "swarm.cf1.camera=aideck")


@pytest.fixture
def warned(warn: Warn) -> Warn:
    """Return the warnings of a flight of one drone in a hall with something more in it."""

    def alone(world: str, *changes: str) -> list[str]:
        return warn(MISSION, "planner=visibility", *ALONE, *changes, world=HALL + world)

    return alone


def test_one_agent_that_drifts_near_an_obstacle_is_warned_of(warned: Warn) -> None:
    (warning,) = warned(PILLAR)
    assert warning.split(": warning: ")[0].endswith("m.yaml:8:12")
    assert "cf1 is 0.6 m from obstacle 'pillar' after about" in warning
    assert warning.endswith("[drift-exceeds-clearance]")
    assert warned(PILLAR, "limits.uncertainty_margin=0") == []
    assert warned(PILLAR, "mission.1.hold={at: [1.5, 0, 0.8], for: 5}") == []


def test_a_contact_in_three_of_a_thousand_flights_is_warned_of(warned: Warn) -> None:
    (warning,) = warned(PILLAR, "mission.1.hold={at: [2.75, 0, 0.8], for: 10}")
    assert "agents touch obstacles with a probability of up to 0." in warning
    assert warned(PILLAR, "mission.1.hold={at: [2.5, 0, 0.8], for: 10}") == []


def test_one_agent_that_drifts_near_the_fence_is_warned_of(warned: Warn) -> None:
    (warning,) = warned("", "mission.1.hold.at=[8.5, 0, 0.8]")
    assert "cf1 is 0.5 m from the fence" in warning
    assert "leave the fence by more than 0.2 m" in warning
    assert warning.endswith("[drift-exceeds-clearance]")


def test_agents_that_see_landmarks_are_not_warned_of(warned: Warn) -> None:
    assert warned(PILLAR + TAGS, *BY_TAGS) == []
    (unseen,) = warned(PILLAR + TAGS, *BY_TAGS, "localizer.max_tags_per_landmark=0")
    assert "when its position by 'apriltag' has a standard deviation" in unseen


CROSSING = (
    "swarm={cf1: {start: [-2, 0, 0]}, cf2: {start: [2, 0, 0]}, cf3: {start: [0, -2, 0]}, "
    "cf4: {start: [0, 2, 0]}}",
    "mission.1={parallel: [{goto: {agents: cf1, to: [2, 0, 0.8]}}, "
    "{goto: {agents: cf2, to: [-2, 0, 0.8]}}, {goto: {agents: cf3, to: [0, 2, 0.8]}}, "
    "{goto: {agents: cf4, to: [0, -2, 0.8]}}]}",
)


def test_agents_that_the_core_would_land_are_warned_of(warnings: Warn) -> None:
    (warning,) = warnings(*CROSSING)
    assert "have no room between them after about" in warning
    assert warning.endswith("[no-room-for-drift]")
    assert warnings(*CROSSING, "limits.uncertainty_margin=0") == []


@pytest.mark.parametrize(("half", "is_warned"), [(0.5, True), (0.8, False)])
def test_pairs_that_swap_in_near_lanes_are_warned_of(
    warnings: Warn, half: float, *, is_warned: bool
) -> None:
    lanes = (
        f"swarm={{cf1: {{start: [-0.8, {half}, 0]}}, cf2: {{start: [0.8, {half}, 0]}}, "
        f"cf3: {{start: [-0.8, -{half}, 0]}}, cf4: {{start: [0.8, -{half}, 0]}}}}",
        f"mission.1={{parallel: [{{goto: {{agents: cf1, to: [0.8, {half}, 0.8]}}}}, "
        f"{{goto: {{agents: cf2, to: [-0.8, {half}, 0.8]}}}}, "
        f"{{goto: {{agents: cf3, to: [0.8, -{half}, 0.8]}}}}, "
        f"{{goto: {{agents: cf4, to: [-0.8, -{half}, 0.8]}}}}]}}",
    )
    messages = warnings(*lanes)
    assert [text.rpartition("[")[2] for text in messages] == ["no-room-for-drift]"] * is_warned


@pytest.mark.parametrize(
    ("positioning", "is_warned"),
    [
        ("std: 0.03", False),
        ("std: 0.3", True),
        ("std: 0.03, dropout_rate: 0.1, dropout_time: 60", True),
    ],
)
def test_the_error_of_a_positioning_system_is_expected(
    warnings: Warn, positioning: str, *, is_warned: bool
) -> None:
    system = f"transport={{use: sim, positioning: {{{positioning}}}}}"
    messages = warnings(
        system, "localizer=mocap", "mission.1.hold.for=60", "swarm.cf2.start=[0.7, 0, 0]"
    )
    assert any(text.endswith("[drift-exceeds-separation]") for text in messages) == is_warned
