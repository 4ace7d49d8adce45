"""Starts and climbs that obstacles leave no room for."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.plugins.formats.star_yaml.problems import of_steps

WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
obstacles:
  beam: {box: {centre: [1, 0], size: [0.4, 0.4]}, height: [0.8, 1]}
"""
MISSION = """\
star: 1
name: m
world: room.yaml
swarm:
  cf1: {start: [-1, 0, 0]}
  cf2: {start: [1, 0, 0]}
transport: sim
localizer: flow
planner: straight
avoider: none
mission:
"""
LOW, HIGH = "takeoff: {height: 0.5}", "takeoff: {height: 1.4}"
ASIDE = "goto: {by: [-0.5, 0, 0]}"
RESERVE = MISSION.replace("transport", "reserve: {agents: [cf2], height: 0.5}\ntransport")


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("room.yaml").write_text(WORLD)


def faults(*steps: str, head: str = MISSION) -> list[str]:
    return of_steps(head, steps)


@pytest.mark.parametrize(
    "steps",
    [
        [LOW, "land: {}"],
        ["takeoff: {agents: cf1, height: 1.4}"],  # cf2 is below the beam
        [LOW, ASIDE, "land: {}", HIGH],  # from where they landed
    ],
)
def test_climbs_with_nothing_overhead_are_right(steps: list[str]) -> None:
    assert faults(*steps) == []


@pytest.mark.parametrize("height", ["{height: 1.4}", "{height: 0.9}", "{height: 0.75}", "{}"])
def test_climbs_into_or_through_obstacles_are_refused(height: str) -> None:
    assert faults(f"takeoff: {height}") == ["step 1:5 [inside-obstacle]"]


@pytest.mark.parametrize("around", ["repeat: {times: 3, steps: ", "each: {steps: "])
def test_climbs_in_nested_steps_are_reported_once(around: str) -> None:
    step = f"{around}[{{{HIGH}}}, land: {{}}]}}"
    assert faults(step) == [f"step 1:{step.index(HIGH) + 4} [inside-obstacle]"]


def test_reserves_are_checked_when_they_relieve_or_join() -> None:
    assert faults(HIGH, head=RESERVE) == []
    join = "join: {agents: cf2, height: 1.4}"
    assert faults(HIGH, join, head=RESERVE) == ["step 2:5 [inside-obstacle]"]
    assert faults(HIGH, head=RESERVE.replace("0.5}", "1.2}")) == ["7:20 [inside-obstacle]"]


def test_a_start_that_is_wrong_is_reported_and_no_climb_from_it() -> None:
    Path("room.yaml").write_text(WORLD.replace("[0.8, 1]", "[0.05, 1]"))
    assert faults(HIGH) == ["6:16 [inside-obstacle]"]


def safe(within: float, head: str = MISSION) -> str:
    """A mission's beginning with a rule for agents near the fence."""
    rule = f"safety: {{fence_near: {{within: {within}}}}}\n"
    return head.replace("transport", f"{rule}transport", 1)


def test_fence_rules_that_leave_room_for_climbs_are_accepted() -> None:
    assert faults(LOW, "land: {}", head=safe(0.4)) == []
    assert faults("land: {}", head=safe(0.9)) == []  # no agent flies


@pytest.mark.parametrize(("start", "within"), [("[-1, -1.75, 0]", 0.3), ("[-2, -2, 0]", 0)])
def test_starts_that_break_the_fence_rule_are_reported(start: str, within: float) -> None:
    at_the_edge = MISSION.replace("[-1, 0, 0]", start)
    assert faults(LOW, head=safe(within, at_the_edge)) == ["5:16 [fence-too-near]"]


@pytest.mark.parametrize(
    ("step", "column"),
    [
        ("takeoff: {agents: cf1, height: 0.5}", 36),
        ("takeoff: {agents: cf1, height: 1.5}", 36),
        ("repeat: {times: 1, steps: [takeoff: {height: 0.5}]}", 50),
    ],
)
def test_climbs_that_break_the_fence_rule_are_reported(step: str, column: int) -> None:
    assert faults(step, head=safe(0.6)) == [f"step 1:{column} [fence-too-near]"]


def test_climbs_of_reserves_that_break_the_fence_rule_are_reported() -> None:
    step = "takeoff: {agents: cf1, height: 1}"
    assert faults(step, head=safe(0.6, RESERVE)) == ["7:34 [fence-too-near]"]


def test_height_limits_ruled_out_by_the_fence_are_reported_once() -> None:
    low = MISSION.replace("transport", "limits: {height: [0.2, 0.5]}\ntransport", 1)
    assert faults("takeoff: {height: 0.4}", head=safe(0.6, low)) == ["8:31 [fence-too-near]"]


def test_a_reserve_may_join_in_each_and_needs_no_name_there() -> None:
    each = "each: {agents: cf2, steps: [join: {height: 0.5}, land: {}]}"
    assert faults("takeoff: {agents: cf1}", each, head=RESERVE) == []


def test_a_join_needs_names_elsewhere_and_reports_it_once() -> None:
    assert faults("join: {height: 0.5}", head=RESERVE) == ["step 1:11 [missing-option]"]


def test_an_each_for_a_reserve_that_does_not_join_has_no_agents() -> None:
    each = "each: {agents: cf2, steps: [hold: {}]}"
    assert faults(each, head=RESERVE) == ["step 1:20 [agent-not-in-mission]"]


@pytest.mark.parametrize(
    "steps",
    [
        ["parallel: [{external: {agents: cf1}}, {external: {agents: cf2, port: 5800}}]"],
        ["external: {agents: cf1}", "external: {agents: cf2}"],
        ["parallel: [{external: {agents: cf1}}, "
         "{repeat: {times: 1, steps: [{hold: {agents: cf2}}, {external: {agents: cf2}}]}}]"],
    ],
)  # fmt: skip
def test_external_steps_need_distinct_ports_only_if_parallel(steps: list[str]) -> None:
    assert faults(LOW, *steps) == []
