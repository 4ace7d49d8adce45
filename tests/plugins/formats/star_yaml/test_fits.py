"""A quick answer to whether a value fits a schema, which is always that of jsonschema."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from star_core import Registry
from star_yaml.fits import RULES, UndecidedError, fits
from star_yaml.input_file import read
from star_yaml.schema import compose, validator

composed = cache(lambda: compose(Registry().offers()))
MISSIONS = Path(__file__).parents[4] / "missions"
VALUES: list[Any] = [
    None,
    True,
    False,
    0,
    1,
    1.0,
    2.5,
    -3,
    math.nan,
    math.inf,
    "",
    "a",
    "ab\n",
    "$a",
    [],
    [1, 2],
    ["a", "a"],
    ["a", "b"],
    {},
    {"a": 1},
    {"a": "b", "b": None},
]
SCHEMAS: dict[str, list[Any]] = {
    "$ref": [{"$ref": "#/$defs/a~b"}, {"$ref": "#/$defs/nothing"}, {"$ref": "#/$defs/has%20space"}],
    "additionalProperties": [
        {"additionalProperties": False},
        {"additionalProperties": {"type": "string"}, "properties": {"a": True}},
    ],
    "allOf": [{"allOf": [{"type": "array"}, {"minItems": 1}]}],
    "anyOf": [{"anyOf": [{"type": "null"}, {"minimum": 1, "type": "number"}]}],
    "const": [{"const": constant} for constant in (0, 1, True, False, None, "a", 1.0, math.nan)],
    "enum": [{"enum": [1, "a", None]}, {"enum": [True, 0]}, {"enum": [[1, 2]]}],
    "exclusiveMinimum": [{"exclusiveMinimum": 1}],
    "if": [
        {"if": {"type": "string"}, "then": {"const": "a"}, "else": {"minimum": 1}},
        {"if": {"type": "string"}, "then": False},
        {"if": {"multipleOf": 2}, "then": False},
    ],
    "items": [{"items": {"type": "string"}}, {"items": False, "prefixItems": [True]}],
    "maxItems": [{"maxItems": 1}],
    "maxProperties": [{"maxProperties": 1}],
    "maximum": [{"maximum": 1}],
    "minItems": [{"minItems": 1}],
    "minLength": [{"minLength": 2}],
    "minProperties": [{"minProperties": 1}],
    "minimum": [{"minimum": 1}],
    "not": [{"not": {"type": ["string", "array"]}}, {"not": {"items": False, "prefixItems": []}}],
    "pattern": [{"pattern": "^a|b$"}, {"pattern": r"a\$"}],
    "properties": [{"properties": {"a": {"type": "integer"}, "c": False}}],
    "propertyNames": [{"propertyNames": {"const": "a"}}],
    "required": [{"required": ["a", "b"]}],
    "type": [
        *({"type": name} for name in ("array", "boolean", "integer", "null", "number", "object")),
        {"type": ["string", "null"]},
    ],
    "uniqueItems": [{"uniqueItems": True}, {"uniqueItems": False}],
}
DEFINITIONS = {"a~b": True, "has space": {"type": "object"}}


def test_every_rule_is_compared() -> None:
    assert SCHEMAS.keys() == RULES.keys()


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_is_that_of_jsonschema(rule: str) -> None:
    decided = 0
    for written in SCHEMAS[rule]:
        schema = {**written, "$defs": DEFINITIONS}
        for value in VALUES:
            try:
                answer = fits(value, schema, schema)
            except UndecidedError:
                continue
            decided += 1
            assert answer == validator()(schema).is_valid(value), (schema, value)
    assert decided >= len(VALUES) / 2


@pytest.mark.parametrize("rule", [{"multipleOf": 2}, {"prefixItems": [False]}, {"const": [1]}])
def test_other_rules_are_undecided(rule: dict[str, Any]) -> None:
    schema = {"items": {"allOf": [rule]}}
    with pytest.raises(UndecidedError):
        fits([[1]], schema, schema)


@pytest.mark.parametrize("path", sorted(MISSIONS.glob("*.yaml")), ids=lambda path: path.stem)
def test_missions_fit_or_not_as_jsonschema_says(path: Path) -> None:
    data, schema = read(path).data, composed()
    check = validator()(schema)
    rng = random.Random(path.name)  # noqa: S311 -- no secret
    for changed in (data, *_changed(data, rng, count=8)):
        assert fits(changed, schema, schema) == check.is_valid(changed)


def _changed(data: Any, rng: random.Random, count: int) -> Iterator[Any]:
    """Yield copies of a document with another value in one position."""
    for _ in range(count):
        copy = deepcopy(data)
        holder = rng.choice([*_holders(copy)])
        key = rng.choice([*holder] if isinstance(holder, dict) else range(len(holder)))
        holder[key] = deepcopy(rng.choice(VALUES))
        yield copy


def _holders(value: Any) -> Iterator[Any]:
    """Yield every map and list in a value that holds anything."""
    if isinstance(value, dict | list) and value:
        yield value
        for item in value.values() if isinstance(value, dict) else value:
            yield from _holders(item)
