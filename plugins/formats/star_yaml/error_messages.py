"""How a value breaks a rule of any JSON Schema: frequent mistakes in the words of their author."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

from star_core.formats import shown
from star_core.toolkit import flow, suggestion
from star_yaml.document import Location
from star_yaml.yaml_errors import odd_character

if TYPE_CHECKING:
    from jsonschema import ValidationError

_BOUNDS: Final = {
    "minimum": "less than the minimum of",
    "maximum": "greater than the maximum of",
    "exclusiveMinimum": "not possible here, expected more than",
    "exclusiveMaximum": "not possible here, expected less than",
}
_LENGTHS: Final = {
    **dict.fromkeys(("minItems", "maxItems"), "item"),
    **dict.fromkeys(("minLength", "maxLength"), "character"),
    **dict.fromkeys(("minProperties", "maxProperties"), "key"),
}
CODES: Final = {
    "type": "wrong-type",
    "required": "missing-option",
    "dependentRequired": "missing-option",
    "enum": "invalid-value",
    "const": "invalid-value",
    "pattern": "invalid-value",
    **dict.fromkeys(_BOUNDS, "out-of-range"),
    **dict.fromkeys(_LENGTHS, "wrong-length"),
    "uniqueItems": "duplicate-item",
    "oneOf": "option-conflict",
    "anyOf": "option-conflict",
}
"""Codes of mistakes by the keyword of the schema."""

_TYPES: Final = {
    "string": "a string",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "array": "a list",
    "object": "a map",
}
_LONGEST: Final = 60  # characters of a value to be written
_LONGEST_MESSAGE: Final = 200  # characters of a message of the validator


class Breach:
    """A value that breaks a rule of a schema.

    Attributes:
        path: Where the value is; of a key, where its map is.
        keyword: Of the rule.
        operand: What stands under the keyword.
        value: That breaks the rule.
        rules: The schema that has the rule.
        properties: The keys that this schema has.
        is_key: Whether the value is a key of the map at `path`.
        words: The validator's own, in one line of bearable length.
    """

    def __init__(self, error: ValidationError) -> None:
        self.path: Location = tuple(error.absolute_path)
        self.keyword = str(error.validator or "")
        self.operand: Any = error.validator_value
        self.value: Any = error.instance
        self.rules: Mapping[str, Any] = error.schema if isinstance(error.schema, Mapping) else {}
        self.properties: Mapping[str, Any] = self.rules.get("properties", {})
        self.is_key = "propertyNames" in error.absolute_schema_path and isinstance(self.value, str)
        words = " ".join(error.message.split())
        self.words = words[:_LONGEST_MESSAGE] + "..." * (len(words) > _LONGEST_MESSAGE)

    @property
    def reason(self) -> str:
        """What a pattern expects, in its schema's words if there are any."""
        return str(self.rules.get("patternErrorMessage", self.words))


def message(breach: Breach) -> str:
    """Return what is wrong and what was expected; a schema may have a message of its own."""
    if breach.keyword in {"not", "", "type"} and "errorMessage" in breach.rules:
        return str(breach.rules["errorMessage"])
    explain = _MESSAGES.get(breach.keyword)
    return breach.words if explain is None else explain(breach)


def _type(breach: Breach) -> str:
    types = [breach.operand] if isinstance(breach.operand, str) else list(breach.operand)
    if types == ["integer"] and isinstance(breach.value, float):
        return f"{breach.value!r} is not a whole number"
    expected = " or ".join(_TYPES.get(name, name) for name in types)
    return f"{what(breach.value)}, expected {expected}{_hint(breach, types)}"


def _hint(breach: Breach, types: list[str]) -> str:
    """Return how to correct a value of another type, if that is clear."""
    value, items = breach.value, breach.rules.get("items", {})
    if types == ["string"] and isinstance(value, int | float):
        return "; put it in quotes"
    if types == ["array"] and isinstance(value, str):
        return hint_to_write([value]) if items.get("type") == "string" else ""
    if types == ["array"] and isinstance(value, dict) and value:
        return _as_list(value, items)
    if types == ["object"] and isinstance(value, list):
        return _as_map(value)
    if {"number", "integer"}.intersection(types) and isinstance(value, str):
        return _as_number(value, breach.rules)
    return ""


def _as_list(value: Mapping[str, Any], items: Mapping[str, Any]) -> str:
    """Return how to write a map as a list."""
    first = next(iter(value))
    if first.startswith("-"):
        return "; put a space after the '-'"
    if "$ref" not in items:
        return ""
    return (
        hint_to_write([value]) if len(value) == 1 else f"; put '- ' before each: `- {first}: ...`"
    )


def _as_map(value: list[Any]) -> str:
    """Return how to write a list as a map."""
    if not value or not all(isinstance(item, dict) and item for item in value):
        return ""
    name, keys = value[0].get("name"), [key for key in value[0] if key != "name"]
    if isinstance(name, str) and keys:
        return f"; write each as `{name}: {{{keys[0]}: ...}}`"
    return f"; remove the '- ' before each: `{next(iter(value[0]))}: ...`"


def _as_number(value: str, rules: Mapping[str, Any]) -> str:
    """Return how to write text as a number."""
    if re.fullmatch(r"[-+]?[0-9]+(\.[0-9]+)?", value):
        return "; remove the quotes"
    if hint := odd_character(value)[1]:
        return f"; {hint}"
    measured = value[:1].isdigit() and "description" in rules  # 0.8 m
    return f": {rules['description'].rstrip('.')}" if measured else ""


def _length(breach: Breach) -> str:
    """Return how many items, keys or characters there are, and how many were expected."""
    side, value, noun = breach.keyword[3:], breach.value, _LENGTHS[breach.keyword]
    exactly = breach.rules.get(f"min{side}") == breach.rules.get(f"max{side}")
    bound = "" if exactly else "at least " if breach.keyword.startswith("min") else "at most "
    if noun == "item" and value and all(isinstance(item, int | float) for item in value):
        noun = "number"
    if not value:
        return f"is empty, expected {bound}{breach.operand} {noun}{'s' * (breach.operand > 1)}"
    return f"has {len(value)} {noun}{'s' * (len(value) > 1)}, expected {bound}{breach.operand}"


def _enum(breach: Breach) -> str:
    allowed = [value if isinstance(value, str) else show(value) for value in breach.operand]
    word = breach.value if isinstance(breach.value, str) else ""
    hint = suggestion(word, allowed, "expected one of")
    return f"{show(breach.value)} is not possible here{hint}"


def _twice(breach: Breach) -> str:
    items = breach.value
    return f"lists {show(next(a for i, a in enumerate(items) if a in items[:i]))} more than once"


def _alternatives(breach: Breach) -> str:
    """Name alternatives of which each asks for one key."""
    keys = [branch.get("required", ()) for branch in breach.operand if isinstance(branch, dict)]
    names = [required[0] for required in keys if len(required) == 1]
    if len(names) < len(breach.operand):
        return breach.words
    present = " and ".join(repr(name) for name in names if name in breach.value) or "none of them"
    exactly = "exactly one" if breach.keyword == "oneOf" else "at least one"
    return f"expected {exactly} of {', '.join(names)}; this has {present}"


_MESSAGES: Final[Mapping[str, Callable[[Breach], str]]] = {
    "type": _type,
    "enum": _enum,
    "const": lambda breach: (
        f"{show(breach.value)} is not possible here, expected {show(breach.operand)}"
    ),
    "pattern": lambda breach: f"{show(breach.value)} is not possible here: {breach.reason}",
    **dict.fromkeys(
        _BOUNDS,
        lambda breach: f"{breach.value!r} is {_BOUNDS[breach.keyword]} {breach.operand!r}",
    ),
    **dict.fromkeys(_LENGTHS, _length),
    "uniqueItems": _twice,
    "oneOf": _alternatives,
    "anyOf": _alternatives,
}


def what(value: Any) -> str:
    """Return what a value is.

    >>> what("fast"), what(None), what([1])
    ("'fast' is a string", 'there is no value', 'this is a list')
    """
    if value is None:
        return "there is no value"
    if isinstance(value, list | dict):
        return f"this is {show(value)}"
    kind = "a string" if isinstance(value, str) else "a number"
    return f"{show(value)} is {'a truth value' if isinstance(value, bool) else kind}"


def show(value: Any) -> str:
    """Return a value as a mission would write it; of a long one the beginning."""
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    return shown(value)


def hint_to_write(value: Any, key: str = "") -> str:
    """Return the hint to write a value, after its key, in one line of YAML; empty if it is long."""
    text = key + flow(value)
    return f"; write it `{text}`" if len(text) <= _LONGEST else ""
