"""Values as text."""

from __future__ import annotations

import json
from typing import Any


def flow(value: Any) -> str:
    """Return a value in one line of YAML.

    >>> flow({"any": [{"found": 1}, {"not": {"event": ""}}]})
    '{any: [{found: 1}, {not: {event: ""}}]}'
    """
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(flow, value)) + "]"
    return value if isinstance(value, str) and value else json.dumps(value)
