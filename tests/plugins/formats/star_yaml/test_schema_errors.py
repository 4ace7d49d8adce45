"""How each mistake in a mission or a world reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from star_core.plugin_support.specs import TaskSpec
from star_yaml.document import Document
from star_yaml.input_file import override
from star_yaml.schema import compose, problems
from star_yaml.yaml_reader import parse
from tests.commands import position_and_code


def number(description: str, **rules: Any) -> dict[str, Any]:
    return {"description": description, "type": "number", **rules}


NEVER_MADE: Any = object


def offer(name: str, properties: dict[str, Any] | None = None, **rules: Any) -> TaskSpec:
    """An offer of a plugin that cannot do anything."""
    options = {"type": "object", "properties": properties or {}, **rules}
    return TaskSpec(name=name, summary=f"The {name}.", make=NEVER_MADE, options=options)


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
                "log": {"type": "boolean"},
                "colours": {"type": "object", "maxProperties": 1, "minProperties": 1},
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


def document(text: str) -> Document:
    parsed = parse(text, "m.yaml")
    return Document(parsed, Path("m.yaml"))


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
    (found,) = faults(with_line(start, line))
    return found


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


# Faults of missions


@pytest.mark.parametrize(
    ("start", "line", "expected"),
    [
        ("star", "star: 2", "1:7: this version reads `star: 1`, this file is of 2"),
        ("star", "star: '1'", "1:7: this version reads `star: 1`, this file is of '1'"),
        ("star", "", "2:1: missing key 'star'; write `star: 1` first"),
        ("name", "name: a/b", "2:7: name: 'a/b' is not possible here: expected 1 to 64 letters, "),
        ("name", 'name: "a\\n"', "2:7: name: 'a\\n' is not possible here: expected 1 to 64 "),
        ("name", "name: 12", "2:7: name: 12 is a number, expected a string; put it in quotes"),
        ("world", "world: ''", "3:8: world: is empty, expected at least 1 character"),
        ("world", "world:", "3:1: world: there is no value, expected a string"),
        ("  cf1", "  1cf: {start: [0, 0, 0]}", "5:3: swarm: '1cf' cannot be a name here: expected"),
        ("  cf1", "  all: {start: [0, 0, 0]}", "5:3: swarm: 'all' cannot be a name here: expected"),
        ("  cf1", "  cf1: {}", "5:3: swarm.cf1: missing key 'start'"),
        ("  cf1", "  cf1:", "5:3: swarm.cf1: there is no value, expected a map"),
        ("  cf1", "  cf1: {start: [0, 0]}", "5:16: swarm.cf1.start: has 2 numbers, expected 3"),
        ("  cf1", "  cf1: {start: [0]}", "5:16: swarm.cf1.start: has 1 number, expected 3"),
        ("  cf1", "  cf1: {start: [0, 0, true]}", "5:23: swarm.cf1.start: true is a truth value,"),
        ("transport", "transport: simm", "6:12: no transport named 'simm'; did you mean 'sim'?"),
        ("planner", "planner: rrt", "8:10: no planner named 'rrt'; installed: file, straight"),
        ("planner", "planner:", "8:1: planner: there is no value, expected a name or {use: name, "),
        ("planner", "planner: [a]", "8:10: planner: this is a list, expected a name or {use: "),
        ("planner", "planner: {}", "8:1: planner: missing key 'use'; write {use: name of a plugin"),
        ("planner", "planner: {use: 5}", "8:16: planner: 5 is a number, expected a name"),
        ("planner", "planner: {use: straigt}", "8:16: no planner named 'straigt'; did you mean '"),
        (
            "planner",
            "planner: file",
            "8:10: planner 'file' has options that must be given; write {use: file, path: ...}",
        ),
        ("planner", "planner: {use: file}", "8:1: planner 'file': missing option 'path'"),
        (
            "avoider",
            "avoider: {use: none, a: 1}",
            "9:22: avoider 'none': unknown option 'a'; there",
        ),
    ],
)
def test_a_mistake_in_a_mission_is_one_line(start: str, line: str, expected: str) -> None:
    assert fault(start, line).startswith(f"m.yaml:{expected}")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("radius: -4", "30: avoider 'orca': radius: -4 is not possible here, expected more than 0"),
        ("horizon: 11", "31: avoider 'orca': horizon: 11 is greater than the maximum of 10"),
        (
            "neighbours: 100",
            "34: avoider 'orca': neighbours: 100 is not possible here, expected less than 100",
        ),
        ("neighbours: 2.0", "34: avoider 'orca': neighbours: 2.0 is not a whole number"),
        ("radius: fast", "30: avoider 'orca': radius: 'fast' is a string, expected a number"),
        ("radius: '1'", "30: avoider 'orca': radius: '1' is a string, expected a number; remove "),
        ("radius: 20 cm", "30: avoider 'orca': radius: '20 cm' is a string, expected a number: Ra"),
        ("radius: true", "30: avoider 'orca': radius: true is a truth value, expected a number"),
        ("log: yes", "27: avoider 'orca': log: 'yes' is a string, expected true or false"),
        ("radus: 1", "22: avoider 'orca': unknown option 'radus'; did you mean 'radius'?"),
        ("x: 1", "22: avoider 'orca': unknown option 'x'; expected one of: radius, horizon, "),
        ("shape: [a]", "30: avoider 'orca': shape: 'a' is a string, expected a number"),
        ("colours: {}", "31: avoider 'orca': colours: is empty, expected 1 key"),
        ("word: A", "28: avoider 'orca': word: 'A' is not possible here: 'A' does not match"),
        ("word: abcdef", "28: avoider 'orca': word: has 6 characters, expected at most 5"),
        ("even: 3", "28: avoider 'orca': even: 3 is not a multiple of 2"),
        ("side: left", "10: avoider 'orca': 'side' goes with 'horizon', which is missing"),
        ("level: 5", "29: avoider 'orca': level: 5 is a number, expected a string; put it in quo"),
        ("mode: slow", "28: avoider 'orca': mode: 'slow' is not possible here, expected 'fast'"),
        ("both: 1", "28: avoider 'orca': both: 1 is valid under each of {'type': 'integer'}, {"),
        ("nearest: a", "31: avoider 'orca': nearest: 'a' is a string, expected a number"),
        ("horizon: 1, side: rigth", "40: avoider 'orca': side: 'rigth' is not possible here; did "),
    ],
)
def test_a_mistake_in_a_plugins_option_names_the_plugin(options: str, expected: str) -> None:
    found = fault("avoider", f"avoider: {{use: orca, {options}}}")
    assert found.startswith(f"m.yaml:9:{expected}")


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        ("takeof: {}", "5: unknown verb 'takeof'; did you mean 'takeoff'?"),
        (
            "fly: {}",
            "5: unknown verb 'fly'; expected one of: parallel, repeat, if, include, each, goto, "
            "land, takeoff",
        ),
        (
            "{goto: {to: [0, 0, 1]}, land: {}}",
            "5: a step has one verb, this one has 2: 'goto', 'land'; write each as its own step",
        ),
        ("{}", "5: a step has one verb, this one has none; expected one of: parallel, repeat, "),
        ("", "4: an empty step, expected a verb such as `land: {}`"),
        ("land", "5: a step is a map; write it `land: {}`"),
        ("lnad", "5: 'lnad' is a string, expected a step such as `land: {}`; did you mean 'land'?"),
        ("5", "5: 5 is a number, expected a step such as `land: {}`"),
        ("land:", "5: land: nothing follows; write it `land: {}`"),
        ("goto:", "5: goto: nothing follows; write it `goto: {to: ...}`"),
        ("parallel:", "5: parallel: nothing follows, expected a list of steps"),
        ("land: now", "11: land: 'now' is a string, expected a map"),
        ("goto: {}", "5: goto: missing option 'to'"),
        ("{goto: , to: [0, 0, 1]}", "14: option 'to' stands beside its verb 'goto'; indent it fur"),
        ("{goto: {speed: 1}, to: 1}", "24: option 'to' stands beside its verb 'goto'; indent it"),
        ("takeoff: {height: -1}", "23: takeoff: height: -1 is less than the minimum of 0"),
        ("takeoff: {hieght: 1}", "15: takeoff: unknown option 'hieght'; did you mean 'height'?"),
        ("land: {on_failure: stop}", "24: land: on_failure: 'stop' is not possible here; expecte"),
        ("land: {timeout: 0}", "21: land: timeout: 0 is not possible here, expected more than 0"),
        ("land: {agents: []}", "20: land: agents: is empty, expected at least 1 item"),
        ("land: {agents: [a, a]}", "20: land: agents: lists 'a' more than once"),
        ("parallel: []", "15: parallel: is empty, expected at least 1 item"),
        ("parallel: [{land: {x: 1}}]", "24: land: unknown option 'x'; expected one of: agents, "),
        ("parallel: [{lnad: {}}]", "17: unknown verb 'lnad'; did you mean 'land'?"),
        ("repeat: {times: 2}", "5: repeat: missing option 'steps'"),
        ("repeat: {times: 0, steps: [{land: {}}]}", "21: repeat: times: 0 is less than the mini"),
        ("repeat: {times: 1, steps: [land]}", "32: a step is a map; write it `land: {}`"),
    ],
)
def test_a_mistake_in_a_step_is_one_line(step: str, expected: str) -> None:
    assert fault("  - takeoff", f"  - {step}").startswith(f"m.yaml:11:{expected}")


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
    found = problems(document(MISSION), compose({}))
    assert "m.yaml:6:12 [unknown-plugin]" in map(position_and_code, found)


def test_an_empty_swarm_has_too_few_agents() -> None:
    empty = document(MISSION.replace("swarm:\n  cf1: {start: [0, 0, 0]}", "swarm: {}"))
    assert [*map(position_and_code, problems(empty, SCHEMA))] == ["m.yaml:4:8 [wrong-length]"]


def test_all_mistakes_are_listed_in_the_order_of_the_file() -> None:
    text = with_line("avoider", "avoider: {use: orca, radius: 0, x: 1}").replace("swap", "'?'")
    places = [found.split(": ")[0] for found in faults(text.replace("sim", "simm"))]
    assert places == ["m.yaml:2:7", "m.yaml:6:12", "m.yaml:9:30", "m.yaml:9:33"]


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
    found = problems(document(json.dumps(whole)), SCHEMA)
    assert all(line.startswith("m.yaml:1:") and "\n" not in line for line in found)
    assert bool(found) is not Draft202012Validator(SCHEMA).is_valid(whole) or any(
        "whole number" in line for line in found
    )
