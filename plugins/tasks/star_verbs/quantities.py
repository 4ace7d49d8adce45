"""JSON Schemas of the quantities that verbs take: points, and numbers above zero."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

FARTHEST: Final = 1000
"""Greatest number that a verb takes, in its own unit: metres of it are far more than a room."""


def point(description: str, example: Sequence[float]) -> Mapping[str, Any]:
    """Return the schema of a point or an offset, [x, y, z], m."""
    return {
        "type": "array",
        "items": {"type": "number", "minimum": -FARTHEST, "maximum": FARTHEST},
        "minItems": 3,
        "maxItems": 3,
        "description": description,
        "examples": [list(example)],
    }


def positive(description: str, **more: Any) -> Mapping[str, Any]:
    """Return the schema of a number above zero."""
    above_zero = {"exclusiveMinimum": 0, "maximum": FARTHEST}
    return {"type": "number", **above_zero, "description": description, **more}


SPACING = positive(
    "Least distance between the agents where several are sent to one place, m.", default=0.6
)
