"""Parameters in the place of values: what a schema that admits them lets through."""

from __future__ import annotations

import json
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from star_core.plugin_support.registry import Registry
from star_yaml.document import Location
from star_yaml.editor_schema import NAMED_VALUE, admitting, editor_schema, for_editors
from star_yaml.schema import _depends as depends
from star_yaml.schema import compose_steps
from star_yaml.yaml_reader import parse

MISSIONS = Path(__file__).parents[4] / "missions"
OFFERS = Registry().offers()
STRICT = compose_steps(OFFERS)
ADMITTING = for_editors(compose_steps(OFFERS), parameters=True)
STEPS = [
    step
    for path in sorted(MISSIONS.glob("*.yaml"))
    for step in parse(path.read_text(encoding="utf-8"), "").plain()["mission"]
]
OTHERS = ("$x", "$", "word", "land", "all", -1e9, 0.5, 3, True, None, (), ("$x",), {"x": "$x"})


def validator(schema: dict[str, Any]) -> Draft202012Validator:
    return Draft202012Validator({"$ref": "#/$defs/step", "$defs": schema["$defs"]})


STRICTLY, ADMITTED = validator(STRICT), validator(ADMITTING)


def places(value: Any, at: Location = ()) -> Iterator[Location]:
    """The paths of a value and of every value in it."""
    yield at
    inside = enumerate(value) if isinstance(value, list) else ()
    for key, inner in value.items() if isinstance(value, dict) else inside:
        yield from places(inner, (*at, key))


def put(step: Any, at: Location, value: Any) -> Any:
    """A step with another value at a place."""
    if not at:
        return value
    made = into = deepcopy(step)
    for key in at[:-1]:
        into = into[key]
    into[at[-1]] = value
    return made


PLACES = [(step, at) for step in STEPS for at in places(step)]


@given(st.sampled_from(PLACES))
def test_a_parameter_may_stand_in_the_place_of_every_value(place: tuple[Any, Location]) -> None:
    assert ADMITTED.is_valid(put(*place, "$x"))


@given(st.sampled_from(PLACES), st.sampled_from(OTHERS))
def test_what_editors_admit_is_what_can_become_right(
    place: tuple[Any, Location], value: Any
) -> None:
    step = put(*place, list(value) if isinstance(value, tuple) else value)
    wrong = [error for error in STRICTLY.iter_errors(step) if not depends(error)]
    assert ADMITTED.is_valid(step) == (not wrong)


def test_schema_with_parameters_is_valid_without_alternatives() -> None:
    Draft202012Validator.check_schema(ADMITTING)
    assert "oneOf" not in json.dumps(ADMITTING)
    assert "anyOf" not in json.dumps(ADMITTING)


@pytest.mark.parametrize(
    ("schema", "right", "wrong"),
    [
        ({"type": "number"}, [1, "$x"], ["x", "$", [], None]),
        ({"type": ["integer", "boolean"], "enum": [1, True]}, [1, "$x"], [2, "x"]),
        ({"enum": ["a", 1]}, ["a", 1, "$x"], ["b", 2]),
        ({"const": "a"}, ["a", "$x"], ["b"]),
        ({"type": "string", "minLength": 5}, ["12345", "$x"], ["x", 5]),
        ({"type": "string", "pattern": "^a"}, ["a", "$x"], ["b"]),
        ({"not": {"type": "string"}}, [1, "$x"], ["x"]),
        ({"type": "array", "items": {"type": "number"}}, [[1, "$x"], "$x"], [["x"], "x"]),
        ({"type": "array", "prefixItems": [{"type": "null"}]}, [[None], ["$x"]], [["x"]]),
        ({"additionalProperties": {"type": "number"}}, [{"a": "$x"}], [{"a": "x"}]),
        ({"patternProperties": {"a": {"type": "null"}}}, [{"a": "$x"}], [{"a": "x"}]),
        ({"propertyNames": {"maxLength": 1}}, [{"a": "$x"}], [{"$x": 1}]),
        ({"contains": {"type": "number"}}, [[1], ["$x"]], [["x"]]),
        ({"oneOf": [{"type": "number"}, {"type": "array"}]}, [1, [], "$x"], ["x", {}]),
        ({"anyOf": [{"type": "number"}, {"type": "array"}]}, [1, [], "$x"], ["x", {}]),
        ({"allOf": [{"type": "number"}, {"minimum": 1}]}, [1, "$x"], [0, "x"]),
        ({"oneOf": [{"required": ["a"]}], "allOf": [{"type": "object"}]}, [{"a": 1}], [{}]),
        (
            {"if": {"required": ["a"]}, "then": {"required": ["b"]}, "type": "object"},
            [{}, {"a": "$x", "b": 1}, "$x"],
            [{"a": "$x"}, "x"],
        ),
        ({"properties": {"a": True}}, [{"a": "$x"}, {"a": "x"}], []),
    ],
    ids=str,
)
def test_a_rule_holds_for_what_is_no_parameter(
    schema: dict[str, Any], right: list[Any], wrong: list[Any]
) -> None:
    before = deepcopy(schema)
    made = Draft202012Validator({**admitting(schema), "$defs": {"named_value": NAMED_VALUE}})
    assert [value for value in right if not made.is_valid(value)] == []
    assert [value for value in wrong if made.is_valid(value)] == []
    assert schema == before


@pytest.mark.parametrize(
    ("schema", "value"),
    [
        ({"type": "number"}, "$x"),
        ({"items": {"type": "number"}}, ["$x"]),
        ({"oneOf": [{"items": {"type": "number"}}]}, ["$x"]),
        ({"contains": {"type": "number"}}, ["x", "$x"]),
    ],
)
def test_a_mistake_that_a_value_may_mend_depends_on_it(schema: dict[str, Any], value: Any) -> None:
    (error,) = Draft202012Validator(schema).iter_errors(value)
    assert depends(error)


@pytest.mark.parametrize(
    ("schema", "value"),
    [
        ({"type": "number"}, "x"),
        ({"minItems": 2}, ["$x"]),
        ({"oneOf": [{"items": {"type": "number"}}]}, ["x"]),
        ({"enum": [1, 2]}, ["$x"]),
        ({"uniqueItems": True}, ["$x", "$x"]),
    ],
)
def test_a_mistake_that_no_value_mends_depends_on_none(schema: dict[str, Any], value: Any) -> None:
    (error,) = Draft202012Validator(schema).iter_errors(value)
    assert not depends(error)


def test_a_value_of_a_set_is_still_offered() -> None:
    made = admitting({"enum": ["land", "hold"], "examples": ["land"], "default": "hold"})
    assert made["examples"] == ["land", "hold"]
    assert made["default"] == "hold"


@pytest.mark.parametrize(
    ("used", "valid"),
    [("$way", True), ("orca", True), ({"use": "$way"}, True), ({"use": "orka"}, False)],
)
def test_plugins_may_be_named_by_a_parameter(used: Any, *, valid: bool) -> None:
    mission = parse((MISSIONS / "hello.yaml").read_text(encoding="utf-8"), "").plain()
    schema = editor_schema("mission", Registry())
    assert Draft202012Validator(schema).is_valid({**mission, "avoider": used}) is valid
