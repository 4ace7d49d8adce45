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


GOAL = {"position": HERE, "velocity": [0.1, 0, 0], "yaw": 1.5, "speed": 0.4}


@pytest.mark.parametrize(
    ("message", "content"),
    [
        ({"goals": {"cf1": {"position": [1, 0, 0.8]}}}, {"cf1": Goal((1.0, 0.0, 0.8))}),
        ({"goals": {"cf1": GOAL}}, {"cf1": Goal((1.0, 0.0, 0.8), (0.1, 0.0, 0.0), 1.5, 0.4)}),
        ({"goals": {}}, {}),
        ({"done": True}, Done()),
        ({"fail": "lost"}, Failed("lost")),
        ({"fail": "a\n" + 1000 * "b"}, Failed("a " + 198 * "b")),
    ],
)
def test_messages_are_goals_success_or_failure(message: Any, content: Any) -> None:
    assert answered(message) == content


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (
            {"done": True, "goals": {}},
            "expected an object with one of 'goals', 'done' and 'fail', "
            "got {'done': True, 'goals': {}}",
        ),
        ({"done": 1}, "done is 1, expected true"),
        ({"fail": 7}, "fail is 7, expected the reason as a string"),
        ({"goals": [1]}, "goals are [1], expected an object of goals by agent"),
        (
            {"goals": {"cf3": {"position": HERE}}},
            "no agent named 'cf3' in this step; there are: cf1, cf2",
        ),
        (
            {"goals": {"cf1": {"yaw": 1}}},
            "cf1: the goal is {'yaw': 1}, expected an object with a position",
        ),
    ],
)
def test_invalid_messages_are_refused(message: Any, why: str) -> None:
    assert refused(message) == why


@pytest.mark.parametrize(
    ("goal", "why"),
    [
        ({"sped": 1}, "unknown 'sped', expected 'position', 'velocity', 'yaw' and 'speed'"),
        ({"position": [1, 2]}, "position is [1, 2], expected [x, y, z]"),
        ({"position": [1, True, 1]}, "position has True, expected a finite number"),
        ({"yaw": 10**400}, "yaw has 1000000000000000"),  # beyond all floats
        ({"position": [99, 0, 1]}, "[99, 0, 1] is outside the fence"),
        ({"position": [0, 0, 2.5]}, "[0, 0, 2.5] is outside the heights to fly at"),
        ({"position": [4.5, 4.5, 1]}, "[4.5, 4.5, 1] is inside obstacle 'pillar'"),
        ({"speed": 2}, "speed of 2 m/s is above limits.speed, 0.5 m/s"),
        ({"speed": 0}, "speed is 0 m/s, expected at least 0.01"),
        ({"speed": 1e-308}, "speed is 1e-308 m/s, expected at least 0.01"),
        ({"yaw": 1e308}, "yaw is 1e+308 rad, expected from -1000 to 1000"),
        ({"velocity": [0.4, 0.4, 0]}, "velocity of 0.565685 m/s is above limits.speed, 0.5 m/s"),
    ],
)
def test_invalid_goals_are_refused(goal: dict[str, Any], why: str) -> None:
    assert refused({"goals": {"cf1": {"position": HERE, **goal}}}).startswith(f"cf1: {why}")


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
