"""Messages from the other process."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import InputError, Obstacle
from star_core.testing import scene
from star_external.planner import Done, Failed, Goal
from star_external.protocol import read

ROOM = scene(2)
PILLAR = Obstacle("pillar", (((4.0, 4.0), (5.0, 4.0), (5.0, 5.0), (4.0, 5.0)),), (0.0, 3.0))
FULL = replace(ROOM, world=replace(ROOM.world, obstacles=(PILLAR,)))
HERE = [1.0, 0.0, 0.8]

numbers = st.one_of(st.floats(), st.integers(), st.integers(-3, 3), st.booleans(), st.none())
values = st.recursive(
    st.one_of(numbers, st.text()),
    lambda inner: st.one_of(st.lists(inner), st.dictionaries(st.text(), inner)),
    max_leaves=20,
)
goals = st.dictionaries(
    st.sampled_from(["position", "velocity", "yaw", "speed", "extra"]),
    st.one_of(values, st.lists(numbers, min_size=3, max_size=3)),
)
messages = st.one_of(
    values,
    st.dictionaries(st.sampled_from(["goals", "done", "fail"]), values),
    st.dictionaries(
        st.just("goals"), st.dictionaries(st.sampled_from(["cf1", "cf2", "cf3"]), goals)
    ),
)


def answered(value: Any) -> Any:
    return read(json.dumps(value).encode(), FULL, ["cf1", "cf2"])


def refused(value: Any) -> str:
    with pytest.raises(InputError) as error:
        answered(value)
    assert error.value.code == "invalid-message"
    return str(error.value).removesuffix(" [invalid-message]")


def wrong_goal(**goal: Any) -> str:
    return refused({"goals": {"cf1": {"position": HERE, **goal}}})


def test_a_goal_needs_a_position_only() -> None:
    assert answered({"goals": {"cf1": {"position": [1, 0, 0.8]}}}) == {"cf1": Goal((1.0, 0.0, 0.8))}


def test_a_goal_may_have_a_velocity_a_yaw_and_a_speed() -> None:
    goal = {"position": HERE, "velocity": [0.1, 0, 0], "yaw": 1.5, "speed": 0.4}
    expected = Goal((1.0, 0.0, 0.8), (0.1, 0.0, 0.0), 1.5, 0.4)
    assert answered({"goals": {"cf1": goal}}) == {"cf1": expected}


def test_no_goals_are_a_sign_of_life() -> None:
    assert answered({"goals": {}}) == {}


def test_the_other_process_can_end_the_step() -> None:
    assert answered({"done": True}) == Done()


def test_the_other_process_can_fail_the_step_with_a_reason() -> None:
    assert answered({"fail": "lost"}) == Failed("lost")


def test_why_it_gives_up_is_kept_short_and_on_one_line() -> None:
    assert answered({"fail": "a\n" + 1000 * "b"}) == Failed("a " + 198 * "b")


def test_a_line_is_one_of_three_things() -> None:
    assert refused({"done": True, "goals": {}}) == (
        "expected an object with one of 'goals', 'done' and 'fail', got {'done': True, 'goals': {}}"
    )


def test_done_is_true() -> None:
    assert refused({"done": 1}) == "done is 1, expected true"


def test_a_failure_has_words() -> None:
    assert refused({"fail": 7}) == "fail is 7, expected the reason as a string"


def test_goals_are_by_agent() -> None:
    assert refused({"goals": [1]}) == "goals are [1], expected an object of goals by agent"


def test_names_are_checked() -> None:
    message = refused({"goals": {"cf3": {"position": HERE}}})
    assert message == "no agent named 'cf3' in this step; there are: cf1, cf2"


def test_a_goal_without_a_position_is_refused() -> None:
    assert refused({"goals": {"cf1": {"yaw": 1}}}) == (
        "cf1: the goal is {'yaw': 1}, expected an object with a position"
    )


def test_what_is_not_known_is_refused() -> None:
    assert wrong_goal(sped=1) == (
        "cf1: unknown 'sped', expected 'position', 'velocity', 'yaw' and 'speed'"
    )


def test_a_position_has_three_coordinates() -> None:
    assert wrong_goal(position=[1, 2]) == "cf1: position is [1, 2], expected [x, y, z]"


def test_a_coordinate_is_a_number() -> None:
    assert wrong_goal(position=[1, True, 1]) == "cf1: position has True, expected a finite number"


def test_a_number_beyond_all_floats_is_refused() -> None:
    assert "expected a finite number" in wrong_goal(yaw=10**400)


def test_a_goal_outside_the_fence_is_refused() -> None:
    assert wrong_goal(position=[99, 0, 1]).startswith("cf1: [99, 0, 1] is outside the fence")


def test_a_goal_outside_the_heights_is_refused() -> None:
    assert wrong_goal(position=[0, 0, 2.5]) == (
        "cf1: [0, 0, 2.5] is outside the heights to fly at, from 0.2 to 1.8 m"
    )


def test_a_goal_in_an_obstacle_is_refused() -> None:
    message = wrong_goal(position=[4.5, 4.5, 1])
    assert message == "cf1: [4.5, 4.5, 1] is inside obstacle 'pillar'"


def test_a_speed_above_the_limit_is_refused() -> None:
    assert wrong_goal(speed=2) == "cf1: speed of 2 m/s is above limits.speed, 0.5 m/s"


def test_a_speed_of_nothing_is_refused() -> None:
    assert wrong_goal(speed=0) == "cf1: speed is 0 m/s, expected at least 0.01"
    assert wrong_goal(speed=1e-308) == "cf1: speed is 1e-308 m/s, expected at least 0.01"
    assert wrong_goal(yaw=1e308) == "cf1: yaw is 1e+308 rad, expected from -1000 to 1000"


def test_a_velocity_above_the_limit_is_refused() -> None:
    message = wrong_goal(velocity=[0.4, 0.4, 0])
    assert message == "cf1: velocity of 0.565685 m/s is above limits.speed, 0.5 m/s"


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (b"{", "invalid JSON: Expecting property name"),
        (b"\xff{}", "invalid JSON: 'utf-8' codec"),
        (b'{"goals": {"cf1": {"position": [NaN, 0, 1]}}}', "invalid JSON: NaN is not a number"),
        (b'{"done": true, "done": true}', "invalid JSON: duplicate name in ['done', 'done']"),
        (60000 * b"[", "invalid JSON: too deeply nested"),
        (b'{"fail": ' + 5000 * b"9" + b"}", "invalid JSON: Exceeds the limit"),
    ],
)
def test_what_is_no_json_is_refused(line: bytes, why: str) -> None:
    with pytest.raises(InputError) as error:
        read(line, ROOM, ["cf1"])
    assert str(error.value).startswith(why)


@given(st.binary())
def test_any_bytes_are_understood_or_refused(line: bytes) -> None:
    try:
        read(line, ROOM, ["cf1"])
    except InputError as error:
        assert str(error)  # noqa: PT017 -- whichever it is


@given(messages)
def test_any_json_is_understood_or_refused_in_few_words(value: Any) -> None:
    try:
        message = answered(value)
    except InputError as error:
        assert 0 < len(str(error)) < 200  # noqa: PT017 -- whichever it is
        return
    if not isinstance(message, Done | Failed):
        for goal in message.values():
            assert FULL.world.fault(goal.position) is None
