"""Data fit a schema just if the library that explains mistakes finds none."""

from __future__ import annotations

import subprocess
import sys
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from star_core import Registry
from star_yaml.fitting import BEYOND, KEYWORDS, Undecided, fits
from star_yaml.input_file import read
from star_yaml.schema import load, validator

ROOT = Path(__file__).parents[4]
MISSIONS = [  # that write their values out
    path for path in sorted((ROOT / "missions").glob("*.yaml")) if "let" not in read(path).data
]
POINT = {"type": "array", "prefixItems": [{"type": "number"}, True], "items": {"maximum": 3}}
SCHEMAS: tuple[Any, ...] = (
    True,
    False,
    {"type": "integer"},
    {"type": ["number", "null"], "minimum": 1},
    {"exclusiveMinimum": 0, "exclusiveMaximum": 2, "maximum": 5},
    {"enum": ["a", 1, None]},
    {"const": True},
    {"pattern": "^a$", "minLength": 1, "maxLength": 2},
    POINT,
    {"minItems": 1, "maxItems": 2, "contains": {"type": "string"}},
    {"uniqueItems": True},
    {"dependentRequired": {"a": ["b"]}},
    {"required": ["a"], "minProperties": 1, "maxProperties": 1},
    {
        "properties": {"a": {"type": "number"}},
        "patternProperties": {"^b": False},
        "additionalProperties": {"type": "string"},
        "propertyNames": {"maxLength": 2},
    },
    {"anyOf": [{"type": "string"}, {"minimum": 2}]},
    {"oneOf": [{"type": "number"}, {"type": "integer"}]},
    {"allOf": [{"type": "number"}, {"not": {"const": 1}}]},
    {"if": {"type": "string"}, "then": {"const": "a"}, "else": {"$ref": "#/$defs/point"}},
)
plain = st.recursive(
    st.sampled_from([None, True, False, 0, 1, 2, 1.0, 2.5, "", "a", "a\n", "ab", "b", "$x"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("abc"), inner),
    max_leaves=6,
)


def agrees(value: Any, schema: Any) -> bool:
    """Whether `fits` decides as the library does, or does not decide."""
    try:
        decided = fits(value, schema, schema if isinstance(schema, dict) else {})
    except Undecided:
        return True
    return decided is not any(True for _ in validator()(schema).iter_errors(value))


@pytest.mark.parametrize("schema", SCHEMAS)
@given(value=plain)
def test_data_fit_as_the_library_decides(schema: Any, value: Any) -> None:
    if isinstance(schema, dict):
        schema = {**schema, "$defs": {"point": POINT}}
    assert agrees(value, schema)


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.stem)
def test_missions_fit_and_lose_that_with_each_key(path: Path) -> None:
    data, schema = read(path).data, Registry().find("file_kind", "mission").offer.schema(Registry())
    assert fits(data, schema, schema)
    for key in data:
        broken = deepcopy(data)
        broken[key] = {"wrong": [broken[key]]}
        assert agrees(broken, schema)
        del broken[key]
        assert agrees(broken, schema)


def test_every_keyword_of_the_library_is_known_or_beyond() -> None:
    named = {*Draft202012Validator.VALIDATORS} - {"format"}
    assert named <= {*KEYWORDS, *BEYOND}
    with pytest.raises(Undecided):
        fits(1, {"multipleOf": 2}, {})


@pytest.mark.parametrize("kind", ["world", "camera", "steps", "mission"])
def test_the_own_schemas_have_no_keyword_beyond(kind: str) -> None:
    waiting: list[Any] = [load(kind)]
    while waiting:
        schema = waiting.pop()
        keys = schema if isinstance(schema, dict) else {}
        waiting += keys.values() if keys else schema if isinstance(schema, list) else ()
        assert not BEYOND & keys.keys()


def test_checks_of_valid_missions_import_no_validator_and_no_compiler() -> None:
    heavy = "jsonschema", "numba", "scipy", "shapely"
    program = (
        "import sys; from star_core.commands.main import main; main(); "
        f"print([name for name in {heavy} if name in sys.modules])"
    )
    mission = str(ROOT / "missions" / "first_flight.yaml")
    command = [sys.executable, "-c", program, "check", mission]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "[]"
