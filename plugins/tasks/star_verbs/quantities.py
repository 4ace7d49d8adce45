"""JSON Schemas of the quantities that verbs take: points, and numbers above zero."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


def point(description: str, example: Sequence[float]) -> Mapping[str, Any]:
    """Return the schema of a point or an offset, [x, y, z], m."""
    return {
        "type": "array",
        "items": {"type": "number"},
        "minItems": 3,
        "maxItems": 3,
        "description": description,
        "examples": [list(example)],
    }


def positive(description: str, **more: Any) -> Mapping[str, Any]:
    """Return the schema of a number above zero."""
    return {"type": "number", "exclusiveMinimum": 0, "description": description, **more}
