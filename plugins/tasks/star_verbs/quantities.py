"""JSON Schemas of the quantities used by verbs: points, and positive numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

FARTHEST: Final = 1000
"""Greatest value of a verb's option, in its own unit: in meters, far more than a room."""


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
    """Return the schema of a positive number."""
    above_zero = {"exclusiveMinimum": 0, "maximum": FARTHEST}
    return {"type": "number", **above_zero, "description": description, **more}


SPACING = positive("Least distance between agents sent to one point, m.", default=0.6)
