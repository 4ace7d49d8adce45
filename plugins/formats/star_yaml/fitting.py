"""Whether data fit a schema, decided without a library: it is imported to explain mistakes only."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Final
from urllib.parse import unquote

BEYOND: Final = frozenset((
    *("$dynamicRef", "dependentSchemas", "multipleOf"),
    *("maxContains", "minContains", "unevaluatedItems", "unevaluatedProperties"),
))  # fmt: skip
"""Keywords that STAR's own schemas do without."""


class Undecided(Exception):  # noqa: N818 -- no error
    """A schema or a value is beyond `fits`."""


def fits(value: Any, schema: Any, root: Mapping[str, Any]) -> bool:
    """Return whether a value fits a schema, as `star_yaml.schema.validator` decides it.

    Args:
        value: Plain data: maps with names as keys, lists, texts, numbers, truth values, None.
        schema: JSON Schema 2020-12.
        root: The schema that references are relative to.

    Raises:
        Undecided: There is a keyword of `BEYOND`, or a value that is not known here.

    >>> fits({"gain": 2}, {"properties": {"gain": {"maximum": 1}}}, {})
    False
    """
    if isinstance(schema, bool):
        return schema
    for keyword, rule in schema.items():
        if keyword in BEYOND:
            raise Undecided(keyword)
        decide = KEYWORDS.get(keyword)  # None requires nothing, as a title
        if decide is not None and not decide(value, rule, schema, root):
            return False
    return True


@cache
def anchored(expression: str) -> str:
    r"""Return a regular expression whose last ``$`` is the very end of a string.

    >>> anchored("^a$")
    '^a\\Z'
    """
    return re.sub(r"(?<!\\)((?:\\\\)*)\$$", r"\1\\Z", expression)


def is_whole(value: object) -> bool:
    """Return whether a value is a whole number: 2.0 is not."""
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


_TYPES: Final[Mapping[str, Callable[[object], bool]]] = {
    "array": lambda value: isinstance(value, list),
    "boolean": lambda value: isinstance(value, bool),
    "integer": is_whole,
    "null": lambda value: value is None,
    "number": _is_number,
    "object": lambda value: isinstance(value, dict),
    "string": lambda value: isinstance(value, str),
}


def _type(value: Any, rule: Any, _schema: Any, _root: Any) -> bool:
    names = [rule] if isinstance(rule, str) else rule
    return any(_TYPES[name](value) for name in names)


def _equal(value: Any, other: Any) -> bool:
    if isinstance(value, dict | list) or isinstance(other, dict | list):
        raise Undecided("equality")
    return isinstance(value, bool) is isinstance(other, bool) and bool(value == other)


def _unique(value: Any, rule: Any, _schema: Any, _root: Any) -> bool:
    if not rule or not isinstance(value, list):
        return True
    if not all(isinstance(item, str) for item in value):
        raise Undecided("uniqueItems")
    return len(set(value)) == len(value)


def _items(value: Any, rule: Any, schema: Any, root: Any) -> bool:
    if not isinstance(value, list):
        return True
    rest = value[len(schema.get("prefixItems", ())) :]
    return all(fits(item, rule, root) for item in rest)


def _prefix_items(value: Any, rule: Any, _schema: Any, root: Any) -> bool:
    if not isinstance(value, list):
        return True
    return all(fits(item, inner, root) for item, inner in zip(value, rule, strict=False))


def _contains(value: Any, rule: Any, _schema: Any, root: Any) -> bool:
    return not isinstance(value, list) or any(fits(item, rule, root) for item in value)


def _names(value: Mapping[Any, Any]) -> list[str]:
    if not all(isinstance(name, str) for name in value):
        raise Undecided("a key that is no name")
    return list(value)


def _properties(value: Any, rule: Any, _schema: Any, root: Any) -> bool:
    if not isinstance(value, dict):
        return True
    return all(fits(value[name], rule[name], root) for name in _names(value) if name in rule)


def _pattern_properties(value: Any, rule: Any, _schema: Any, root: Any) -> bool:
    if not isinstance(value, dict):
        return True
    return all(
        fits(value[name], inner, root)
        for pattern, inner in rule.items()
        for name in _names(value)
        if re.search(pattern, name)
    )


def _additional_properties(value: Any, rule: Any, schema: Any, root: Any) -> bool:
    if not isinstance(value, dict):
        return True
    known, patterns = schema.get("properties", {}), schema.get("patternProperties", {})
    return all(
        fits(value[name], rule, root)
        for name in _names(value)
        if name not in known and not any(re.search(pattern, name) for pattern in patterns)
    )


def _property_names(value: Any, rule: Any, _schema: Any, root: Any) -> bool:
    return not isinstance(value, dict) or all(fits(name, rule, root) for name in value)


def _dependent(value: Any, rule: Any, _schema: Any, _root: Any) -> bool:
    if not isinstance(value, dict):
        return True
    return all(needed in value for name in value for needed in rule.get(name, ()))


def _reference(value: Any, rule: str, _schema: Any, root: Any) -> bool:
    start, *names = unquote(rule).split("/")
    if start != "#":
        raise Undecided(rule)
    target: Any = root
    for name in names:
        token = name.replace("~1", "/").replace("~0", "~")
        if not isinstance(target, dict) or token not in target:
            raise Undecided(rule)
        target = target[token]
    return fits(value, target, root)


def _if(value: Any, rule: Any, schema: Any, root: Any) -> bool:
    branch = "then" if fits(value, rule, root) else "else"
    return fits(value, schema.get(branch, True), root)


_Decide = Callable[[Any, Any, Any, Any], bool]


def _of(known: Callable[[object], bool], decide: Callable[[Any, Any], bool]) -> _Decide:
    """Return a keyword that requires something of values of one type only."""
    return lambda value, rule, _schema, _root: not known(value) or decide(value, rule)


_is_text, _is_list, _is_map = _TYPES["string"], _TYPES["array"], _TYPES["object"]
KEYWORDS: Final[Mapping[str, _Decide]] = {
    "$ref": _reference,
    "type": _type,
    "const": lambda value, rule, *_: _equal(value, rule),
    "enum": lambda value, rule, *_: any(_equal(value, item) for item in rule),
    "minimum": _of(_is_number, lambda value, rule: not value < rule),
    "maximum": _of(_is_number, lambda value, rule: not value > rule),
    "exclusiveMinimum": _of(_is_number, lambda value, rule: not value <= rule),
    "exclusiveMaximum": _of(_is_number, lambda value, rule: not value >= rule),
    "pattern": _of(_is_text, lambda value, rule: re.search(anchored(rule), value) is not None),
    "minLength": _of(_is_text, lambda value, rule: len(value) >= rule),
    "maxLength": _of(_is_text, lambda value, rule: len(value) <= rule),
    "minItems": _of(_is_list, lambda value, rule: len(value) >= rule),
    "maxItems": _of(_is_list, lambda value, rule: len(value) <= rule),
    "uniqueItems": _unique,
    "items": _items,
    "prefixItems": _prefix_items,
    "contains": _contains,
    "required": _of(_is_map, lambda value, rule: all(name in value for name in rule)),
    "dependentRequired": _dependent,
    "minProperties": _of(_is_map, lambda value, rule: len(value) >= rule),
    "maxProperties": _of(_is_map, lambda value, rule: len(value) <= rule),
    "properties": _properties,
    "patternProperties": _pattern_properties,
    "additionalProperties": _additional_properties,
    "propertyNames": _property_names,
    "allOf": lambda value, rule, _, root: all(fits(value, inner, root) for inner in rule),
    "anyOf": lambda value, rule, _, root: any(fits(value, inner, root) for inner in rule),
    "oneOf": lambda value, rule, _, root: sum(fits(value, inner, root) for inner in rule) == 1,
    "not": lambda value, rule, _, root: not fits(value, rule, root),
    "if": _if,
}
