"""A quick answer to whether a value fits a schema: importing jsonschema takes a tenth of a check.

jsonschema alone says what is wrong with a value, and decides wherever a schema has other rules.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, Final
from urllib.parse import unquote


class UndecidedError(Exception):
    """A schema has a rule that is none of `RULES`, or a constant that is no scalar."""


def fits(value: Any, schema: Any, root: Mapping[str, Any]) -> bool:
    """Return whether a value fits a schema, as `star_yaml.schema.validator` decides it.

    Args:
        value: As read from YAML.
        schema: To hold it to.
        root: The schema in which references start.

    Raises:
        UndecidedError: It takes that validator to decide it.

    Example:
        >>> fits({"rate": 20}, {"properties": {"rate": {"type": "integer", "maximum": 50}}}, {})
        True
    """
    if isinstance(schema, bool):
        return schema
    if other := schema.keys() - RULES.keys() - ANNOTATIONS:
        raise UndecidedError(other)
    return all(
        RULES[name](value, rule, schema, root) for name, rule in schema.items() if name in RULES
    )


ANNOTATIONS: Final = {
    "$defs",
    "$schema",
    "default",
    "description",
    "else",  # of `if`, like `then`
    "enumDescriptions",
    "errorMessage",
    "examples",
    "patternErrorMessage",
    "then",
    "title",
}


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


TYPES: Final[Mapping[str, Callable[[Any], bool]]] = {
    "array": lambda value: isinstance(value, list),
    "boolean": lambda value: isinstance(value, bool),
    "integer": lambda value: isinstance(value, int) and not isinstance(value, bool),
    "null": lambda value: value is None,
    "number": _number,
    "object": lambda value: isinstance(value, dict),
    "string": lambda value: isinstance(value, str),
}


def to_the_end(pattern: str) -> str:
    """Return a pattern whose ``$`` is the very end of a string, not a line break before it."""
    return re.sub(r"(?<!\\)((?:\\\\)*)\$$", r"\1\\Z", pattern)


def _equal(value: Any, constant: Any) -> bool:
    if isinstance(constant, dict | list):
        raise UndecidedError(constant)
    same_kind = isinstance(value, bool) == isinstance(constant, bool)
    return value is constant or (same_kind and bool(value == constant))


def _unique(items: list[Any]) -> bool:
    if not all(isinstance(item, str) for item in items):
        raise UndecidedError("uniqueItems")
    return len(set(items)) == len(items)


def _refers(value: Any, reference: str, root: Mapping[str, Any]) -> bool:
    start, *names = unquote(reference).split("/")
    target: Any = root
    for name in names:
        if "~" in name or not isinstance(target, dict) or "$id" in target:
            raise UndecidedError(reference)
        target = target.get(name)
    if start != "#" or target is None:
        raise UndecidedError(reference)
    return fits(value, target, root)


def _closed(value: Any, rule: Any, schema: Mapping[str, Any], root: Mapping[str, Any]) -> bool:
    known = schema.get("properties", {})
    return not isinstance(value, dict) or all(
        fits(item, rule, root) for name, item in value.items() if name not in known
    )


def _branch(value: Any, rule: Any, schema: Mapping[str, Any], root: Mapping[str, Any]) -> bool:
    branch = "then" if fits(value, rule, root) else "else"
    return fits(value, schema.get(branch, True), root)


# Of a value, the rule, the schema that has it, and the root. Comparisons are those of jsonschema,
# also with numbers that are none.
RULES: Final[Mapping[str, Callable[[Any, Any, Any, Any], bool]]] = {
    "$ref": lambda value, rule, _, root: _refers(value, rule, root),
    "additionalProperties": _closed,
    "allOf": lambda value, rule, _, root: all(fits(value, each, root) for each in rule),
    "anyOf": lambda value, rule, _, root: any(fits(value, each, root) for each in rule),
    "const": lambda value, rule, *_: _equal(value, rule),
    "enum": lambda value, rule, *_: any(_equal(value, each) for each in rule),
    "exclusiveMinimum": lambda value, rule, *_: not (_number(value) and value <= rule),
    "if": _branch,
    "items": lambda value, rule, _, root: (
        not isinstance(value, list) or all(fits(item, rule, root) for item in value)
    ),
    "maxItems": lambda value, rule, *_: not (isinstance(value, list) and len(value) > rule),
    "maxProperties": lambda value, rule, *_: not (isinstance(value, dict) and len(value) > rule),
    "maximum": lambda value, rule, *_: not (_number(value) and value > rule),
    "minItems": lambda value, rule, *_: not (isinstance(value, list) and len(value) < rule),
    "minLength": lambda value, rule, *_: not (isinstance(value, str) and len(value) < rule),
    "minProperties": lambda value, rule, *_: not (isinstance(value, dict) and len(value) < rule),
    "minimum": lambda value, rule, *_: not (_number(value) and value < rule),
    "not": lambda value, rule, _, root: not fits(value, rule, root),
    "pattern": lambda value, rule, *_: (
        not isinstance(value, str) or re.search(to_the_end(rule), value) is not None
    ),
    "properties": lambda value, rule, _, root: (
        not isinstance(value, dict)
        or all(fits(value[name], each, root) for name, each in rule.items() if name in value)
    ),
    "propertyNames": lambda value, rule, _, root: (
        not isinstance(value, dict) or all(fits(name, rule, root) for name in value)
    ),
    "required": lambda value, rule, *_: not isinstance(value, dict) or {*rule} <= value.keys(),
    "type": lambda value, rule, *_: any(
        TYPES[name](value) for name in ([rule] if isinstance(rule, str) else rule)
    ),
    "uniqueItems": lambda value, rule, *_: not (rule and isinstance(value, list)) or _unique(value),
}
