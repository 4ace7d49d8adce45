"""How a value breaks a rule of any JSON Schema, in the words of its author."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from star_core.toolkit import flow, suggestion
from star_yaml.document import Location
from star_yaml.yaml_errors import odd_character

if TYPE_CHECKING:
    from jsonschema import ValidationError

CODES: Final = {
    "type": "wrong-type",
    "required": "missing-option",
    "enum": "invalid-value",
    "const": "invalid-value",
    "pattern": "invalid-value",
    "minimum": "out-of-range",
    "maximum": "out-of-range",
    "exclusiveMinimum": "out-of-range",
    "exclusiveMaximum": "out-of-range",
    "minItems": "wrong-length",
    "maxItems": "wrong-length",
    "minLength": "wrong-length",
    "maxLength": "wrong-length",
    "minProperties": "wrong-length",
    "maxProperties": "wrong-length",
    "uniqueItems": "duplicate-item",
    "dependentRequired": "missing-option",
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
_BOUNDS: Final = {
    "minimum": "less than the minimum of",
    "maximum": "greater than the maximum of",
    "exclusiveMinimum": "not possible here, expected more than",
    "exclusiveMaximum": "not possible here, expected less than",
}
_POINT: Final = 3  # numbers in the longest list that is correct without decimals
_LONGEST: Final = 60  # characters of a value in a message
_LONGEST_MESSAGE: Final = 200  # characters of a message of the validator


class Breach(NamedTuple):
    """A value that breaks a rule: the rule's keyword, its operand, and the schema it is one of."""

    path: Location
    keyword: str
    operand: Any
    value: Any
    rules: Mapping[str, Any]
    error: ValidationError

    @classmethod
    def of(cls, error: ValidationError) -> Breach:
        path, keyword, rules = tuple(error.absolute_path), str(error.validator or ""), error.schema
        rules = rules if isinstance(rules, Mapping) else {}
        return cls(path, keyword, error.validator_value, error.instance, rules, error)

    @property
    def possible_keys(self) -> Mapping[str, Any]:
        """The keys that are possible."""
        return self.rules.get("properties", {})  # type: ignore[no-any-return]

    @property
    def is_key(self) -> bool:
        """Whether the value is a key of the map at `path`."""
        return "propertyNames" in self.error.absolute_schema_path and isinstance(self.value, str)


def nearest(breach: Breach) -> Breach | None:
    """Return how the value breaks the alternative it fits best.

    None if the rule has no alternatives, or if they differ in the keys they ask for.
    """
    from jsonschema.exceptions import best_match

    if breach.keyword not in {"anyOf", "oneOf"}:
        return None
    best = best_match([breach.error])
    alike = best is None or best is breach.error or best.validator == "required"
    return None if alike else Breach.of(best)


# What is so of any schema


def general(breach: Breach) -> str:
    """Return what is wrong and what was expected; a schema may have a message of its own."""
    keyword = breach.keyword
    if keyword in {"not", ""} and "errorMessage" in breach.rules:
        return str(breach.rules["errorMessage"])
    if keyword in _BOUNDS:
        return f"{breach.value!r} is {_BOUNDS[keyword]} {breach.operand!r}"
    if CODES.get(keyword) == "wrong-length":
        return _length(breach)
    return _MESSAGES.get(keyword, _plainly)(breach)


def reason(breach: Breach) -> str:
    """Return what a pattern expects, in its schema's words if there are any."""
    return str(breach.rules.get("patternErrorMessage") or _plainly(breach))


def _plainly(breach: Breach) -> str:
    """Return the validator's own message, in one line of bearable length."""
    text = " ".join(breach.error.message.split())
    return text if len(text) <= _LONGEST_MESSAGE else text[:_LONGEST_MESSAGE] + "..."


def _type(breach: Breach) -> str:
    types = [breach.operand] if isinstance(breach.operand, str) else list(breach.operand)
    if types == ["integer"] and isinstance(breach.value, float):
        return f"{breach.value!r} is not a whole number"
    expected = " or ".join(_TYPES.get(name, name) for name in types)
    return f"{what(breach.value)}, expected {expected}{_hint(breach, types)}"


def _hint(breach: Breach, types: list[str]) -> str:
    """Return how to correct a value of another type, if that is clear."""
    value = breach.value
    if types == ["string"] and isinstance(value, int | float):
        return "; put it in quotes"
    if types == ["array"] and isinstance(value, dict):
        return _as_list(breach)
    if types == ["array"] and isinstance(value, str):
        names = breach.rules.get("items", {}).get("type") == "string"
        return f"; write it `{text}`" if names and (text := short_flow([value])) else ""
    if types == ["object"]:
        return _as_map(breach)
    return _as_number(breach) if {"number", "integer"}.intersection(types) else ""


def _as_list(breach: Breach) -> str:
    """Return how to write a map as a list."""
    first = str(next(iter(breach.value), ""))
    if first.startswith("-"):
        return "; put a space after the '-'"
    if "$ref" not in breach.rules.get("items", {}):
        return ""
    if len(breach.value) > 1:
        return f"; put '- ' before each: `- {first}: ...`"
    return f"; write it `{text}`" if (text := short_flow([breach.value])) else ""


def _as_map(breach: Breach) -> str:
    """Return how to write a list, or one of the keys, as a map."""
    value = breach.value
    if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        keys = [str(key) for key in value[0] if key != "name"]
        if isinstance(name := value[0].get("name"), str) and keys:
            return f"; write each as `{name}: {{{keys[0]}: ...}}`"
        return f"; remove the '- ' before each: `{next(iter(value[0]), '...')}: ...`"
    examples = (
        breach.possible_keys.get(value, {}).get("examples") if isinstance(value, str) else None
    )
    return f"; write it `{text}`" if examples and (text := short_flow({value: examples[0]})) else ""


def _as_number(breach: Breach) -> str:
    """Return how to write text as a number."""
    value, rules = breach.value, breach.rules
    if not isinstance(value, str):
        return ""
    if re.fullmatch(r"[-+]?[0-9]+(\.[0-9]+)?", value):
        return "; remove the quotes"
    if hint := odd_character(value)[1]:
        return f"; {hint}"
    measured = value[:1].isdigit() and "description" in rules  # 0.8 m
    return f": {rules['description'].rstrip('.')}" if measured else ""


def _length(breach: Breach) -> str:
    """Return how many items, keys or characters there are, and how many were expected."""
    side, value, length = breach.keyword[3:], breach.value, breach.operand
    exactly = breach.rules.get(f"min{side}") == breach.rules.get(f"max{side}")
    bound = "" if exactly else "at least " if breach.keyword.startswith("min") else "at most "
    noun = {"Items": "item", "Properties": "key"}.get(side, "character")
    if side == "Items" and value and all(isinstance(item, int | float) for item in value):
        noun = "number"
    if not value:
        return f"is empty, expected {bound}{length} {noun}{'' if length == 1 else 's'}"
    hint = ""
    halved = noun == "number" and length < len(value) <= 2 * length and len(value) > _POINT
    if halved and all(isinstance(item, int) for item in value):
        hint = "; a decimal has a point: 0.8"
    if noun == "key" and "elapsed" in breach.possible_keys:  # of a condition
        both = short_flow({"all": [{key: item} for key, item in value.items()]})
        hint = f"; write `{both}`, or `any` for one of them" if both else "; join them by `all`"
    plural = "" if len(value) == 1 else "s"
    return f"has {len(value)} {noun}{plural}, expected {bound}{length}{hint}"


def _enum(breach: Breach) -> str:
    allowed = [value if isinstance(value, str) else show(value) for value in breach.operand]
    word = breach.value if isinstance(breach.value, str) else ""
    return (
        f"{show(breach.value)} is not possible here{suggestion(word, allowed, 'expected one of')}"
    )


def _twice(breach: Breach) -> str:
    items = breach.value
    return f"lists {show(next(a for i, a in enumerate(items) if a in items[:i]))} more than once"


def _dependent(breach: Breach) -> str:
    return "; ".join(
        f"{key!r} goes with {other!r}, which is missing"
        for key, others in breach.operand.items()
        for other in others
        if key in breach.value and other not in breach.value
    )


def _alternatives(breach: Breach) -> str:
    """Name alternatives of which each asks for one key."""
    keys = [branch.get("required", ()) for branch in breach.operand if isinstance(branch, dict)]
    names = [required[0] for required in keys if len(required) == 1]
    if len(names) < len(breach.operand):
        return _plainly(breach)
    present = " and ".join(repr(name) for name in names if name in breach.value) or "none of them"
    exactly = "exactly one" if breach.keyword == "oneOf" else "at least one"
    return f"expected {exactly} of {', '.join(names)}; this has {present}"


_MESSAGES: Final[Mapping[str, Callable[[Breach], str]]] = {
    "type": _type,
    "enum": _enum,
    "const": lambda breach: (
        f"{show(breach.value)} is not possible here, expected {show(breach.operand)}"
    ),
    "pattern": lambda breach: f"{show(breach.value)} is not possible here: {reason(breach)}",
    "uniqueItems": _twice,
    "dependentRequired": _dependent,
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
    if isinstance(value, list | dict):
        return "a list" if isinstance(value, list) else "a map"
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    text = repr(value)
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "..."


def short_flow(value: Any) -> str:
    """Return a value in one line of YAML; empty if that is long."""
    text = flow(value)
    return text if len(text) <= _LONGEST else ""
