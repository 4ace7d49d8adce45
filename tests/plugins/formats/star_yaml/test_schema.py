"""The mission schema that is composed from plugins' options, and the world schema."""

from __future__ import annotations

import json
from types import MappingProxyType
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from star_core.plugin_support.option_schema import sound
from star_core.plugin_support.specs import TaskSpec
from star_yaml import schema
from star_yaml.editor_schema import for_editors
from star_yaml.schema import compose, compose_steps, load, problems
from tests.plugins.formats.star_yaml.problems import document, offer

NEVER_MADE: Any = object


OFFERS = {
    "transport": {"sim": offer("sim")},
    "localizer": {
        "flow": offer(
            "flow",
            {"noise": {"$ref": "#/$defs/a~1b"}},
            **{"$defs": {"a/b": {"description": "Deviation, m.", "type": "number"}}},
        )
    },
    "avoider": {"none": offer("none"), "orca": offer("orca")},
    "task": {"land": offer("land")},
    "command": {"study": offer("study")},
}
SCHEMA = compose(OFFERS)
WORLD = """\
star: 1
name: lab
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
"""


@pytest.mark.parametrize(
    "schema", [SCHEMA, compose_steps(OFFERS), load("mission"), load("steps"), load("world")]
)
def test_every_schema_is_one(schema: dict[str, Any]) -> None:
    Draft202012Validator.check_schema(schema)


@pytest.mark.parametrize("name", ["mission", "steps", "world"])
def test_every_example_and_default_fits_its_own_schema(name: str) -> None:
    schema = load(name)
    waiting: list[Any] = [schema]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            own = Draft202012Validator({**value, "$defs": schema["$defs"]})
            defaults = [value["default"]] if "default" in value else []
            for example in [*value.get("examples", ()), *defaults]:
                own.validate(example)
            waiting += [held for key, held in value.items() if key not in ("examples", "default")]
        elif isinstance(value, list):
            waiting += value


def test_options_may_be_mappings_and_tuples_of_any_kind() -> None:
    options = MappingProxyType({"properties": MappingProxyType({"a": {"enum": (1, 2)}})})
    x = TaskSpec(name="x", summary="", make=NEVER_MADE, options=options)
    made = compose({"avoider": {"x": sound("avoider", x)}})
    expected = (
        "m.yaml:1:22: avoider 'x': a: 3 is not possible here; expected one of: 1, 2 [invalid-value]"
    )
    assert expected in problems(document("avoider: {use: x, a: 3}"), made)


def test_composing_leaves_what_a_plugin_offers_alone() -> None:
    before = json.dumps(OFFERS["localizer"]["flow"].options)
    compose(OFFERS)
    assert json.dumps(OFFERS["localizer"]["flow"].options) == before


def test_the_schema_describes_each_plugin_and_verb_for_editors() -> None:
    assert SCHEMA["properties"]["avoider"]["then"]["enumDescriptions"] == ["The none.", "The orca."]
    assert SCHEMA["$defs"]["step"]["properties"]["land"]["description"] == "The land."


def test_the_schema_of_a_mission_offers_no_alternatives() -> None:
    assert "oneOf" not in json.dumps(SCHEMA)
    assert "anyOf" not in json.dumps(SCHEMA)


def test_plugin_refs_resolve_from_the_root_of_the_schema() -> None:
    rules = SCHEMA["properties"]["localizer"]["allOf"][0]["then"]
    assert rules["properties"]["noise"]["$ref"] == "#/$defs/localizer.flow/$defs/a~1b"
    assert SCHEMA["$defs"]["localizer.flow"]["$defs"]["a/b"]["type"] == "number"


# Files of steps


def test_a_file_of_steps_is_held_to_the_steps_of_missions() -> None:
    steps = compose_steps(OFFERS)
    assert steps["$defs"]["step"] == SCHEMA["$defs"]["step"]
    assert set(steps["$defs"]) == {
        *("step", "steps", "agents", "until", "condition", "timeout", "on_failure")
    }


def test_verb_refs_are_definitions_in_the_schema_of_steps() -> None:
    push = offer("push", {"at": {"$ref": "#/$defs/b"}}, **{"$defs": {"b": {"type": "number"}}})
    for admit, expected in ((False, "number"), (True, ["number", "string"])):
        made = for_editors(compose_steps({"task": {"push": push}}), parameters=admit)
        assert made["$defs"]["task.push"]["$defs"]["b"]["type"] == expected


@pytest.mark.parametrize(
    ("step", "faults"),
    [
        ("land: $how", []),
        ("repeat: {times: $often, steps: $what}", []),
        ("repeat: {times: often, steps: $what}", ["repeat: times: 'often' is a string, expected"]),
        ("lnd: $how", ["unknown verb 'lnd'; did you mean 'land'?"]),
    ],
)
def test_a_parameter_is_no_mistake_where_they_are_distinguished(
    step: str, faults: list[str]
) -> None:
    text = f"star: 1\nmission:\n  - {step}\n"
    messages = problems(document(text), compose_steps(OFFERS), parameters=True)
    assert len(messages) == len(faults)
    assert all(fault in told for fault, told in zip(faults, messages, strict=True))


# Worlds


def test_a_good_world_has_no_fault() -> None:
    text = WORLD + (
        "obstacles:\n  a: {polygon: [[0, 0], [1, 0], [0, 1]], height: [0, 2]}\n"
        "  b: {polyline: [[0, 0], [1, 0]], thickness: 0.1, height: [0, 2]}\n"
    )
    assert problems(document(text), load("world")) == []


@pytest.mark.parametrize(
    ("pattern", "fits", "not_so"),
    [("^US\\$$", "US$", "US$\n"), ("^US\\$", "US$5", "US5"), ("^a$", "a", "a\n")],
)
def test_escaped_dollars_are_literal_and_others_match_the_end(
    pattern: str, fits: str, not_so: str
) -> None:
    validator = schema.validator()({"pattern": pattern})
    assert validator.is_valid(fits)
    assert not validator.is_valid(not_so)
