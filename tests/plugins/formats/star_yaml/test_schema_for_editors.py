"""What editors show of every key of a mission: a title, what it is, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import pytest

from star_core.plugin_support.registry import Registry
from star_yaml.editor_schema import editor_schema, for_editors
from star_yaml.schema import compose, compose_steps

UNIT = re.compile(
    r"(?<![\w'])(m|m/s|m/s²|m⁴/s|s|1/s|Hz|V|px|degrees|degrees/s|rad|kg)\b(?!['\w])", re.ASCII
)
COUNT = re.compile(
    r"how (often|many)|so many|as many as|\b(seed|share|fraction|number|factor|ticks|paths planned"
    r"|per second of|rows|columns|gray value|port|processes|images)\b",
    re.IGNORECASE,
)
"""How descriptions name a number without a unit."""

ABSENT = re.compile(
    r"not given|by default|the default for|give this or|needed (with|for)|derived|needs none"
    r"|without one",
    re.IGNORECASE,
)
"""How descriptions explain the absence of an option without a default."""


class Property(NamedTuple):
    """A key of the schema, what it refers to put in, and whether the map must have it."""

    path: str
    schema: dict[str, Any]
    required: bool
    one_of_many: bool
    told_above: bool


def properties(value: Any, root: dict[str, Any], path: str = "") -> Iterator[Property]:
    """Every property of a schema, but of conditions: those are for no reader."""
    if isinstance(value, list):
        for member in value:
            yield from properties(member, root, path)
    if not isinstance(value, dict):
        return
    for name, held in value.get("properties", {}).items():
        if isinstance(held, dict):
            yield Property(
                f"{path}/{name}",
                resolved(held, root),
                required=name in value.get("required", ()),
                one_of_many=1 in limits(value),
                told_above="examples" in value or "default" in value,
            )
            yield from properties(held, root, f"{path}/{name}")
    for key, held in value.items():
        if key not in {"properties", "if", "examples", "default", "enum", "const"}:
            yield from properties(held, root, f"{path}/{key}" if key == "$defs" else path)


def limits(schema: dict[str, Any]) -> Iterator[int]:
    """How many keys a map may have, by itself and where it has no key that permits more."""
    if "maxProperties" in schema:
        yield schema["maxProperties"]
    yield from limits(schema["else"]) if "else" in schema else ()


def resolved(schema: dict[str, Any], root: dict[str, Any]) -> dict[str, Any]:
    """A schema with what it refers to."""
    if "$ref" not in schema:
        return schema
    node: Any = root
    for name in schema["$ref"].removeprefix("#/").split("/"):
        node = node[name]
    return resolved(node, root) | schema


def types(schema: dict[str, Any]) -> set[str]:
    names = schema.get("type", ())
    return {names} if isinstance(names, str) else set(names)


MISSION = for_editors(compose(Registry().offers()), parameters=True)
STEPS = for_editors(compose_steps(Registry().offers()), parameters=True)
SCHEMAS = {
    "mission": MISSION,
    "steps": STEPS,
    **{name: editor_schema(name, Registry()) for name in ("world", "camera", "study", "faults")},
}
EVERY = [
    (f"{name}{key.path}", key)
    for name, schema in SCHEMAS.items()
    for key in properties(schema, schema)
]
OPTIONAL = [(p, f) for p, f in EVERY if not f.required]


def test_there_is_something_to_look_at() -> None:
    assert len(EVERY) > 300
    assert "mission/limits/speed" in dict(EVERY)
    assert "mission/avoider/radius" in dict(EVERY)
    assert "mission/$defs/goto/to" in dict(EVERY)


def test_every_key_has_a_title_and_a_description() -> None:
    assert [path for path, key in EVERY if not key.schema.get("title")] == []
    assert [path for path, key in EVERY if not key.schema.get("description")] == []


def test_the_title_of_a_key_is_its_name_in_words() -> None:
    made = dict(EVERY)
    assert made["mission/limits/speed"].schema["title"] == "Speed"
    assert made["mission/avoider/communication_radius"].schema["title"] == "Communication radius"
    assert made["mission/planner/yaw_rate_deg"].schema["title"] == "Yaw rate"


def test_numbers_in_the_schema_have_a_unit_or_state_their_count() -> None:
    numbers = [
        (path, key.schema["description"])
        for path, key in EVERY
        if types(key.schema) & {"number", "integer"}
    ]
    assert len(numbers) > 100
    silent = [
        number for number in numbers if not UNIT.search(number[1]) and not COUNT.search(number[1])
    ]
    assert silent == []


@pytest.mark.parametrize(
    "key", ["limits/speed", "safety/battery_low/below", "localizer/max_report_age"]
)
def test_a_unit_is_found_where_there_is_one(key: str) -> None:
    assert UNIT.search(dict(EVERY)[f"mission/{key}"].schema["description"])


def test_optional_keys_have_a_default_or_describe_their_absence() -> None:
    told = {"default", "const"}
    assert [
        path
        for path, key in OPTIONAL
        if not (told & set(key.schema))
        and not key.one_of_many
        and not path.startswith("mission/safety/")  # a rule that is not there is none
        and not ABSENT.search(key.schema["description"])
    ] == []


def test_every_key_has_an_example_a_default_or_its_values() -> None:
    shown = {"examples", "default", "enum", "const"}
    assert [
        path
        for path, key in EVERY
        if not shown & set(key.schema) and "boolean" not in types(key.schema) and not key.told_above
    ] == []


def test_every_verb_has_an_example() -> None:
    verbs = MISSION["$defs"]["step"]["properties"]
    assert [name for name, verb in verbs.items() if not verb.get("examples")] == []
