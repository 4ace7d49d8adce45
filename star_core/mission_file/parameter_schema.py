"""How schemas let parameters stand in the place of values that are not known yet."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from jsonschema import ValidationError

SIGN: Final = "$"
"""Begins a string that names a parameter."""

PATTERN: Final = r"^\$."
"""The pattern of strings that name a parameter."""

_NAMED: Final = {
    "pattern": PATTERN,
    "patternErrorMessage": "a string here is '$' and the name of a parameter",
}
# keywords under which schemas stand: by name, in a list, and one; `if` and `not` stay as they are
_MAPS: Final = ("properties", "patternProperties", "dependentSchemas", "$defs")
_LISTS: Final = ("allOf", "anyOf", "prefixItems")
_ONE: Final = (
    *("items", "unevaluatedItems", "contains"),
    *("additionalProperties", "unevaluatedProperties", "then", "else"),
)
_OF_STRINGS: Final = (
    *("enum", "enumDescriptions", "const", "pattern", "patternErrorMessage"),
    *("minLength", "maxLength", "format", "not", "if", "then", "else"),
)
"""Rules that the name of a parameter may break."""

_OF_PARTS: Final = ("anyOf", "oneOf", "contains")
"""Rules that a list or a map may break for what it holds."""


def is_parameter(value: Any) -> bool:
    """Whether a value of a step is a parameter's.

    >>> is_parameter("$height"), is_parameter("height"), is_parameter("$"), is_parameter(1)
    (True, False, False, False)
    """
    return isinstance(value, str) and re.match(PATTERN, value) is not None


def depends(error: ValidationError) -> bool:
    """Whether it takes the values of parameters to know if this is a mistake."""
    inside = _within(error.instance) if error.validator in _OF_PARTS else ()
    return any(map(is_parameter, (error.instance, *inside)))


def admitting(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return a schema that lets a parameter stand in the place of every value, for editors.

    Every rule stays where it is, so that an editor completes and explains as before, but for those
    that no ``$name`` would keep: they hold for everything else. Alternatives need not exclude each
    other any more: which of them a parameter is for is not known.

    >>> admitting({"title": "Height", "type": "number"})["type"]
    ['number', 'string']
    >>> admitting({"enum": ["land", "hold"]})["else"]
    {'enum': ['land', 'hold']}
    """
    made = {key: _inner(key, held) for key, held in schema.items()}
    if branches := made.pop("oneOf", None):
        either = {"anyOf": [admitting(branch) for branch in branches]}
        made["allOf"] = [*made.get("allOf", ()), either]
    strict = {key: made.pop(key) for key in _OF_STRINGS if key in made}
    types = [made["type"]] if isinstance(made.get("type"), str) else made.get("type", [])
    if "enum" in strict:
        made["examples"] = strict["enum"]  # what editors offer where nothing is written yet
    if not types or "string" in types:
        return {**made, "if": {"type": "string", **_NAMED}, "else": strict} if strict else made
    made["type"] = [*types, "string"]
    if strict:
        return {**made, "if": {"type": "string"}, "then": dict(_NAMED), "else": strict}
    return {**made, **_NAMED}


def _inner(key: str, held: Any) -> Any:
    """Return what stands under a keyword, with the schemas in it made to admit parameters."""
    if key in _MAPS:
        return {name: _admitting(inner) for name, inner in held.items()}
    if key in _LISTS:
        return [_admitting(inner) for inner in held]
    return _admitting(held) if key in _ONE else held


def _admitting(schema: Any) -> Any:
    return admitting(schema) if isinstance(schema, dict) else schema  # True is a schema too


def _within(value: Any) -> Iterator[Any]:
    """Every value in a list or a map, and in those."""
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    for one in inner:
        yield one
        yield from _within(one)
