"""JSON Schemas of options that several verbs have, and what they share about given options."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from star_core import Problem

MAX_VALUE: Final = 1000  # of an option, in its own unit: in meters, far more than a room


def point(description: str, example: Sequence[float]) -> Mapping[str, Any]:
    """Return the schema of a point or an offset, [x, y, z], m."""
    return {
        "type": "array",
        "items": {"type": "number", "minimum": -MAX_VALUE, "maximum": MAX_VALUE},
        "minItems": 3,
        "maxItems": 3,
        "description": description,
        "examples": [list(example)],
    }


def positive(description: str, **more: Any) -> Mapping[str, Any]:
    """Return the schema of a positive number."""
    limits = {"exclusiveMinimum": 0, "maximum": MAX_VALUE}
    return {"type": "number", **limits, "description": description, **more}


def duration(description: str) -> Mapping[str, Any]:
    """Return the schema of a duration, s, that is 0 by default."""
    limits = {"minimum": 0, "default": 0.0}
    return {"type": "number", **limits, "description": description, "examples": [5]}


SPACING: Final = positive("Least distance between agents sent to one point, m.", default=0.6)
TRAVEL_SPEED: Final = positive(
    "Speed limit on the way, m/s; at most limits.speed, and that if not given.", examples=[0.3]
)


def changed(options: Mapping[str, Any], schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that differ from their defaults."""
    rules = schema["properties"]
    return {key: value for key, value in options.items() if value != rules[key].get("default")}


def exactly_one(one: str, other: str, options: Mapping[str, Any]) -> Iterator[Problem]:
    """Check that exactly one of two options is given."""
    if one not in options and other not in options:
        yield Problem((), f"expected {one!r} or {other!r}", "missing-option")
    elif one in options and other in options:
        message = f"{other!r} does not go with {one!r}, expected one of them"
        yield Problem((other,), message, "option-conflict")
