"""How each mistake in a mission or a world reads."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from star_yaml.input_file import override
from star_yaml.schema import compose, problems
from tests.commands import position_and_code
from tests.plugins.formats.star_yaml.problems import document, offer


def number(description: str, **rules: Any) -> dict[str, Any]:
    return {"description": description, "type": "number", **rules}


NUMBER = {"type": "number"}
POINT = {"type": "array", "items": NUMBER, "minItems": 3, "maxItems": 3}
OFFERS = {
    "transport": {"sim": offer("sim")},
    "localizer": {"flow": offer("flow", {"noise": {"$ref": "#/$defs/a~1b"}}, **{
        "$defs": {"a/b": number("Deviation, m.", minimum=0)},
    })},
    "planner": {
        "straight": offer("straight"),
        "file": offer("file", {"path": {"type": "string"}}, required=["path"]),
    },
    "avoider": {
        "none": offer("none"),
        "orca": offer(
            "orca",
            {
                "radius": number("Radius of an agent, m.", exclusiveMinimum=0, default=0.15),
                "horizon": number("How far to look ahead, s.", maximum=10),
                "neighbours": {"type": "integer", "exclusiveMaximum": 100},
                "shape": {"anyOf": [{"type": "number"}, {"type": "array", "items": NUMBER}]},
                "word": {"type": "string", "pattern": "^[a-z]+$", "maxLength": 5},
                "even": {"type": "integer", "multipleOf": 2},
                "side": {"enum": ["left", "right"]},
                "level": {"type": "string", "enum": ["low", "high"]},
                "mode": {"const": "fast"},
                "both": {"oneOf": [{"type": "number"}, {"type": "integer"}]},
                "nearest": {"$ref": "#/properties/shape/anyOf/0"},
            },
            dependentRequired={"side": ["horizon"]},
        ),
    },
    "task": {
        "takeoff": offer("takeoff", {"height": number("Height to climb to, m.", minimum=0)}),
        "goto": offer("goto", {"to": POINT, "speed": number("Speed, m/s.")}, required=["to"]),
        "land": offer("land"),
    },
    "command": {"study": offer("study")},
}  # fmt: skip
SCHEMA = compose(OFFERS)
MISSION = """\
star: 1
name: swap
world: worlds/lab.yaml
swarm:
  cf1: {start: [0, 0, 0]}
transport: sim
localizer: flow
planner: straight
avoider: {use: orca, radius: 0.2}
mission:
  - takeoff: {height: 1}
"""


def faults(text: str) -> list[str]:
    return problems(document(text), SCHEMA)


def with_line(start: str, line: str) -> str:
    """The mission with the line that begins with `start` replaced; MISSION's places stay."""
    assert f"\n{start}" in f"\n{MISSION}"
    return "".join(
        f"{line}\n" if old.startswith(start) else old for old in MISSION.splitlines(keepends=True)
    )


def fault(start: str, line: str) -> str:
    """The only mistake in the mission once one of its lines is replaced."""
    (message,) = faults(with_line(start, line))
    return message


# What is right


def test_a_good_mission_has_no_fault() -> None:
    assert faults(MISSION) == []


def test_plugins_may_be_a_name_or_a_map_with_use() -> None:
    assert faults(with_line("avoider", "avoider: orca")) == []
    assert faults(with_line("avoider", "avoider: {use: orca}")) == []


def test_verbs_take_their_own_and_the_common_options() -> None:
    line = "  - goto: {to: [0, 0, 1], speed: 1, agents: [cf1], timeout: 3, on_failure: land}"
    assert faults(with_line("  - takeoff", line)) == []


def test_steps_may_stand_inside_steps() -> None:
    line = "  - parallel: [{repeat: {times: 2, steps: [{parallel: [{land: {}}]}]}}]"
    assert faults(with_line("  - takeoff", line)) == []


def test_plugin_options_are_checked_by_their_own_definitions() -> None:
    assert faults(with_line("localizer", "localizer: {use: flow, noise: 0.1}")) == []
    assert fault("localizer", "localizer: {use: flow, noise: -1}") == (
        "m.yaml:7:31: localizer 'flow': noise: -1 is less than the minimum of 0 [out-of-range]"
    )


# Faults of missions; the corpus has those of what is installed


def test_plugins_that_need_options_are_no_bare_names() -> None:
    assert fault("planner", "planner: file") == (
        "m.yaml:8:10: planner 'file' has options that must be given; write {use: file, path: ...}"
        " [missing-option]"
    )


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (
            "neighbours: 100",
            "34: avoider 'orca': neighbours: 100 is not possible here, expected less than 100",
        ),
        ("radius: 20 cm", "30: avoider 'orca': radius: '20 cm' is a string, expected a number: Ra"),
        ("shape: [a]", "29: avoider 'orca': shape: ['a'] is not valid under any of the given sche"),
        ("word: A", "28: avoider 'orca': word: 'A' is not possible here: 'A' does not match"),
        ("word: abcdef", "28: avoider 'orca': word: has 6 characters, expected at most 5"),
        ("even: 3", "28: avoider 'orca': even: 3 is not a multiple of 2"),
        ("side: left", "10: avoider 'orca': 'horizon' is a dependency of 'side'"),
        ("level: 5", "29: avoider 'orca': level: 5 is a number, expected a string; put it in quo"),
        ("mode: slow", "28: avoider 'orca': mode: 'slow' is not possible here, expected 'fast'"),
        ("both: 1", "28: avoider 'orca': both: 1 is valid under each of {'type': 'integer'}, {"),
        ("nearest: a", "31: avoider 'orca': nearest: 'a' is a string, expected a number"),
    ],
)
def test_rules_that_no_installed_plugin_has_are_explained(options: str, expected: str) -> None:
    message = fault("avoider", f"avoider: {{use: orca, {options}}}")
    assert message.startswith(f"m.yaml:9:{expected}")


def test_misspelt_and_missing_keys_are_both_reported() -> None:
    assert faults(with_line("name", "nmae: swap")) == [
        "m.yaml:1:1: missing key 'name' [missing-option]",
        "m.yaml:2:1: unknown key 'nmae'; did you mean 'name'? [unknown-option]",
    ]


def test_a_key_that_resembles_none_is_answered_by_all_there_are() -> None:
    assert fault("name", "name: swap\nlimits: {z: 1}") == (
        "m.yaml:3:10: limits: unknown key 'z'; expected one of: speed, acceleration, "
        "height, separation, vertical_separation, uncertainty_margin [unknown-option]"
    )


def test_no_installed_plugin_is_reported() -> None:
    messages = problems(document(MISSION), compose({}))
    assert "m.yaml:6:12 [unknown-plugin]" in map(position_and_code, messages)


def test_problems_of_set_assignments_come_last_and_name_them() -> None:
    changed = override(document(with_line("name", "name: '?'")), ["avoider.radius=-1"])
    _, last = problems(changed, SCHEMA)
    assert last.startswith(
        "--set avoider.radius=-1: avoider 'orca': radius: -1 is not possible her"
    )


def test_a_long_value_is_cut() -> None:
    assert len(fault("avoider", f"avoider: {'x' * 5000}")) < 200
    assert len(fault("avoider", f"avoider: {{use: orca, even: {'x' * 5000}}}")) < 200


WORDS = st.sampled_from(
    ["use", "orca", "file", "land", "goto", "to", "parallel", "repeat", "steps", "radius", "shape"]
)
DATA = st.recursive(
    st.none() | st.booleans() | st.integers(-2, 2) | st.floats(-2, 2) | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=8,
)


@given(
    st.dictionaries(st.sampled_from(list(SCHEMA["properties"])), DATA, max_size=4),
    st.lists(DATA, max_size=3),
)
def test_every_mission_however_wrong_is_answered_in_lines(
    data: dict[str, Any], steps: list[Any]
) -> None:
    whole = document(MISSION).data | {"mission": steps} | data
    lines = problems(document(json.dumps(whole)), SCHEMA)
    assert all(line.startswith("m.yaml:1:") and "\n" not in line for line in lines)
    assert bool(lines) is not Draft202012Validator(SCHEMA).is_valid(whole) or any(
        "whole number" in line for line in lines
    )
