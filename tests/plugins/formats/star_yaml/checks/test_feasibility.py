"""Starts and climbs that obstacles leave no room for."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core import InputError, Registry, load

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
HIT = "obstacle 'beam' is over its start, from 0.8 to 1 m [inside-obstacle]"


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("room.yaml").write_text(WORLD)


def faults(*steps: str, head: str = MISSION) -> list[str]:
    """The errors of a mission with these steps, the first on line 1."""
    Path("m.yaml").write_text(head + "".join(f"  - {step}\n" for step in steps))
    try:
        load(Path("m.yaml"), Registry())
    except InputError as error:
        places = [told.split(":", 3) for told in error.problems]
        lines = head.count("\n")
        return [f"{int(line) - lines}:{column}:{words}" for _, line, column, words in places]
    return []


def test_a_climb_that_ends_below_what_is_overhead_is_right() -> None:
    assert faults(LOW, "land: {}") == []


@pytest.mark.parametrize("height", ["1.4", "0.9", "0.75"])
def test_climbs_into_or_through_obstacles_are_refused(height: str) -> None:
    up = f"takeoff: {{height: {height}}}"
    assert faults(up) == [f"1:5: 'cf2' cannot climb to {height} m: {HIT}"]


def test_the_height_that_a_verb_climbs_to_by_default_counts() -> None:
    assert faults("takeoff: {}") == [f"1:5: 'cf2' cannot climb to 0.8 m: {HIT}"]


def test_only_the_agents_of_a_step_are_asked() -> None:
    assert faults("takeoff: {agents: cf1, height: 1.4}") == []


def test_climb_limits_follow_the_last_landing_position() -> None:
    assert faults(LOW, ASIDE, "land: {}", HIGH) == []


def test_climbs_in_nested_steps_are_refused_and_reported_once() -> None:
    inner = f"[{{{HIGH}}}, land: {{}}]"
    for step in (f"repeat: {{times: 3, steps: {inner}}}", f"each: {{steps: {inner}}}"):
        (found,) = faults(step)
        assert f"'cf2' cannot climb to 1.4 m: {HIT}" in found


def test_reserves_are_checked_when_they_relieve_or_join() -> None:
    reserve = MISSION.replace("transport", "reserve: {agents: [cf2], height: 0.5}\ntransport")
    assert faults(HIGH, head=reserve) == []
    join = "join: {agents: cf2, height: 1.4}"
    assert faults(HIGH, join, head=reserve) == [f"2:5: 'cf2' cannot climb to 1.4 m: {HIT}"]
    high = reserve.replace("0.5}", "1.2}")
    (found,) = faults(HIGH, head=high)
    assert found == f"-5:20: 'cf2' cannot climb to 1.2 m: {HIT}"


def test_a_start_that_is_wrong_is_reported_and_no_climb_from_it() -> None:
    Path("room.yaml").write_text(WORLD.replace("[0.8, 1]", "[0.05, 1]"))
    (found,) = faults(HIGH)
    assert found.endswith(
        "start [1, 0, 0] is 0.05 m from obstacle 'beam', "
        "expected at least the radius of a drone: 0.06 m [inside-obstacle]"
    )


NEAR = "safety.fence_near would land every agent that flies within"


def safe(within: float, head: str = MISSION) -> str:
    """A mission's beginning with a rule for agents near the fence."""
    rule = f"safety: {{fence_near: {{within: {within}}}}}\n"
    return head.replace("transport", f"{rule}transport", 1)


def test_fence_rules_that_leave_room_for_climbs_are_accepted() -> None:
    assert faults(LOW, "land: {}", head=safe(0.4)) == []
    assert faults("land: {}", head=safe(0.9)) == []  # no agent flies


def test_starts_that_break_the_fence_rule_are_reported() -> None:
    at_the_edge = MISSION.replace("[-1, 0, 0]", "[-1, -1.75, 0]")
    (found,) = faults(LOW, head=safe(0.3, at_the_edge))
    assert found.endswith(
        f"'cf1' starts 0.25 m from a side of the fence, and {NEAR} 0.3 m [fence-too-near]"
    )


def test_a_start_in_a_corner_is_reported_at_the_fence_itself_too() -> None:
    corner = MISSION.replace("[-1, 0, 0]", "[-2, -2, 0]").replace("transport", "safety: "
        "{fence_near: {}}\ntransport", 1)  # fmt: skip
    (found,) = faults(LOW, head=corner)
    assert "'cf1' starts 0.00 m from a side of the fence" in found


@pytest.mark.parametrize(
    ("step", "place", "told"),
    [
        ("takeoff: {agents: cf1, height: 0.5}", "1:36", "0.5 m is 0.50 m from the floor"),
        ("takeoff: {agents: cf1, height: 1.5}", "1:36", "1.5 m is 0.50 m from the ceiling"),
        ("repeat: {times: 1, steps: [takeoff: {height: 0.5}]}", "1:50", "0.5 m is 0.50 m from"),
    ],
)
def test_climbs_that_break_the_fence_rule_are_reported(step: str, place: str, told: str) -> None:
    (found,) = faults(step, head=safe(0.6))
    assert found.startswith(f"{place}: {told}")
    assert found.endswith(f"{NEAR} 0.6 m [fence-too-near]")


def test_so_is_the_climb_of_a_reserve() -> None:
    reserve = MISSION.replace("transport", "reserve: {agents: [cf2], height: 0.5}\ntransport", 1)
    (found,) = faults("takeoff: {agents: cf1, height: 1}", head=safe(0.6, reserve))
    assert "0.5 m is 0.50 m from the floor of the fence" in found


def test_height_limits_ruled_out_by_the_fence_are_reported_once() -> None:
    low = MISSION.replace("transport", "limits: {height: [0.2, 0.5]}\ntransport", 1)
    (found,) = faults("takeoff: {height: 0.4}", head=safe(0.6, low))
    assert "every height to fly at, from 0.2 to 0.5 m, is within 0.6 m of the floor" in found


RESERVE = MISSION.replace("transport", "reserve: {agents: [cf2], height: 0.5}\ntransport", 1)


def test_a_reserve_may_join_in_each_and_needs_no_name_there() -> None:
    each = "each: {agents: cf2, steps: [join: {height: 0.5}, land: {}]}"
    assert faults("takeoff: {agents: cf1}", each, head=RESERVE) == []


def test_a_join_needs_names_elsewhere_and_reports_it_once() -> None:
    (found,) = faults("join: {height: 0.5}", head=RESERVE)
    assert found == "1:11: join: missing option 'agents' [missing-option]"


def test_an_each_for_a_reserve_that_does_not_join_has_no_agents() -> None:
    (found,) = faults("each: {agents: cf2, steps: [hold: {}]}", head=RESERVE)
    assert "cf2 is in reserve, which is in no step before a 'join'" in found


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
