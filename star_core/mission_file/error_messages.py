"""Says in a user's words how a value breaks a rule of JSON Schema."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from star_core.errors import suggestion
from star_core.mission_file.located import Location

if TYPE_CHECKING:
    from jsonschema import ValidationError


class Breach(NamedTuple):
    """A rule and the value that breaks it.

    Attributes:
        path: Where the value is.
        keyword: The rule's keyword; empty where a schema is `False`.
        wanted: What the rule expects.
        value: What there is.
        rules: The schema that the rule is one of.
        of_key: Whether the value is a key of the map at `path`.
        error: As the validator found it.
    """

    path: Location
    keyword: str
    wanted: Any
    value: Any
    rules: Mapping[str, Any]
    of_key: bool
    error: ValidationError

    @classmethod
    def of(cls, error: ValidationError) -> Breach:
        """Take over what a validator found."""
        rules: Any = error.schema
        return cls(
            path=tuple(error.absolute_path),
            keyword=str(error.validator or ""),
            wanted=error.validator_value,
            value=error.instance,
            rules=rules if isinstance(rules, Mapping) else {},
            of_key="propertyNames" in error.absolute_schema_path
            and isinstance(error.instance, str),
            error=error,
        )

    def nearest(self) -> Breach | None:
        """Return how the value breaks the alternative it fits best.

        None if the rule has no alternatives, or if they differ in the keys they ask for.
        """
        from jsonschema.exceptions import best_match

        if self.keyword not in {"anyOf", "oneOf"}:
            return None
        best = best_match([self.error])
        if best is None or best is self.error or best.validator == "required":
            return None
        return Breach.of(best)


def say(breach: Breach) -> str:
    """Say what is wrong and what was expected, in a line; a schema may say it in its own words."""
    if breach.keyword in {"not", ""} and "errorMessage" in breach.rules:
        return str(breach.rules["errorMessage"])
    return _SAY.get(breach.keyword, _plainly)(breach)


def reason(breach: Breach) -> str:
    """Say what a pattern expects, in its schema's words if there are any."""
    return str(breach.rules.get("patternErrorMessage") or _plainly(breach))


def what(value: Any) -> str:
    """Say what a value is.

    >>> what("fast"), what(None), what([1])
    ("'fast' is a string", 'there is no value', 'this is a list')
    """
    if value is None:
        return "there is no value"
    shown, kind = show(value), _kind(value)
    return f"this is {kind}" if shown == kind else f"{shown} is {kind}"


def show(value: Any) -> str:
    """Return a value as a mission would write it; of a long one the beginning."""
    if isinstance(value, (list, dict)):
        return _kind(value)
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    longest = 60
    shown = repr(value)
    return shown if len(shown) <= longest else shown[:longest] + "..."


def flow(value: Any) -> str:
    """Return a value as one writes it in a line of YAML; empty if that is long.

    >>> flow({"any": [{"found": 1}, {"not": {"event": "found"}}]})
    '{any: [{found: 1}, {not: {event: found}}]}'
    >>> flow([{"found": 60 * "x" + "y"}])
    ''
    """
    longest = 60
    if not isinstance(value, (dict, list)):
        text = value if isinstance(value, str) else show(value)
    else:
        inner = [flow(one) for one in (value.values() if isinstance(value, dict) else value)]
        if not all(inner):
            return ""
        if isinstance(value, dict):
            text = "{" + ", ".join(map("{}: {}".format, value, inner)) + "}"
        else:
            text = "[" + ", ".join(inner) + "]"
    return text if len(text) <= longest else ""


def _kind(value: Any) -> str:
    if isinstance(value, bool):
        return "a truth value"
    kinds = {"str": "a string", "list": "a list", "dict": "a map"}
    return kinds.get(type(value).__name__, "a number")


def _type(breach: Breach) -> str:
    wanted = [breach.wanted] if isinstance(breach.wanted, str) else list(breach.wanted)
    if wanted == ["integer"] and isinstance(breach.value, float):
        return f"{breach.value!r} is not a whole number"
    expected = " or ".join(_TYPES.get(name, name) for name in wanted)
    return f"{what(breach.value)}, expected {expected}{_hint(breach, wanted)}"


def _hint(breach: Breach, wanted: list[str]) -> str:
    if wanted == ["string"] and isinstance(breach.value, (int, float)):
        return "; put it in quotes"
    if wanted == ["array"] and isinstance(breach.value, dict):
        if str(next(iter(breach.value), ""))[:1] == "-":
            return "; put a blank after the '-'"
        of_maps = "$ref" in breach.rules.get("items", {})
        return f"; write it `{text}`" if of_maps and (text := flow([breach.value])) else ""
    if isinstance(breach.value, str) and {"number", "integer"}.intersection(wanted):
        if re.fullmatch(r"[-+]?[0-9]+(\.[0-9]+)?", breach.value):
            return "; remove the quotes"
        if breach.value[:1].isdigit() and "description" in breach.rules:  # 0.8 m
            return f": {breach.rules['description'].rstrip('.')}"
    return ""


def _enum(breach: Breach) -> str:
    known = [value if isinstance(value, str) else show(value) for value in breach.wanted]
    word = breach.value if isinstance(breach.value, str) else ""
    return f"{show(breach.value)} is not possible here{suggestion(word, known, 'expected one of')}"


def _const(breach: Breach) -> str:
    return f"{show(breach.value)} is not possible here, expected {show(breach.wanted)}"


def _length(breach: Breach) -> str:
    """Word how many items, entries or characters there are."""
    side = breach.keyword[3:]  # Items, Properties, Length
    count = len(breach.value)
    if breach.rules.get(f"min{side}") == breach.rules.get(f"max{side}"):
        expected = str(breach.wanted)
    else:
        expected = (
            f"{'at least' if breach.keyword.startswith('min') else 'at most'} {breach.wanted}"
        )
    noun = {"Items": "item", "Properties": "key"}.get(side, "character")
    if side == "Items" and count and all(isinstance(item, (int, float)) for item in breach.value):
        noun = "number"
    if not count:
        return f"is empty, expected {expected} {noun}{'' if breach.wanted == 1 else 's'}"
    return f"has {count} {noun}{'' if count == 1 else 's'}, expected {expected}"


def _pattern(breach: Breach) -> str:
    return f"{show(breach.value)} is not possible here: {reason(breach)}"


def _unique(breach: Breach) -> str:
    items = breach.value
    twice = next((item for i, item in enumerate(items) if item in items[:i]), None)
    return f"lists {show(twice)} more than once"


def _dependent(breach: Breach) -> str:
    pairs = [
        f"{key!r} goes with {other!r}, which is missing"
        for key, others in breach.wanted.items()
        for other in others
        if key in breach.value and other not in breach.value
    ]
    return "; ".join(pairs)


def _alternatives(breach: Breach) -> str:
    """Word alternatives of which each asks for one key."""
    keys = [branch.get("required", ()) for branch in breach.wanted if isinstance(branch, dict)]
    names = [required[0] for required in keys if len(required) == 1]
    if len(names) < len(breach.wanted):
        return _plainly(breach)
    given = " and ".join(repr(name) for name in names if name in breach.value) or "none of them"
    exactly = "exactly one" if breach.keyword == "oneOf" else "at least one"
    return f"expected {exactly} of {', '.join(names)}; this has {given}"


def _plainly(breach: Breach) -> str:
    """Return the validator's own words, in one line of bearable length."""
    longest = 200
    message = " ".join(breach.error.message.split())
    return message if len(message) <= longest else message[:longest] + "..."


def _bound(words: str) -> Callable[[Breach], str]:
    return lambda breach: f"{breach.value!r} is {words} {breach.wanted!r}"


_TYPES = {
    "string": "a string",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "array": "a list",
    "object": "a map",
    "null": "null",
}
_SAY: Mapping[str, Callable[[Breach], str]] = {
    "type": _type,
    "enum": _enum,
    "const": _const,
    "minimum": _bound("less than the minimum of"),
    "maximum": _bound("greater than the maximum of"),
    "exclusiveMinimum": _bound("not possible here, expected more than"),
    "exclusiveMaximum": _bound("not possible here, expected less than"),
    "minItems": _length,
    "maxItems": _length,
    "minLength": _length,
    "maxLength": _length,
    "minProperties": _length,
    "maxProperties": _length,
    "pattern": _pattern,
    "uniqueItems": _unique,
    "dependentRequired": _dependent,
    "oneOf": _alternatives,
    "anyOf": _alternatives,
}
