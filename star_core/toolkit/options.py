"""JSON Schemas of options that are numbers."""

from __future__ import annotations

from typing import Any


def number(description: str, **rules: Any) -> dict[str, Any]:
    """Return the schema of a number.

    Args:
        description: With the unit.
        rules: Further keywords: ``default``, ``minimum``, ``maximum``, ``examples`` ...

    Example:
        >>> number("Share.", maximum=1)
        {'type': 'number', 'description': 'Share.', 'maximum': 1}
    """
    return {"type": "number", "description": description, **rules}


def positive(description: str, **rules: Any) -> dict[str, Any]:
    """Return the schema of a number greater than 0; the arguments are those of `number`."""
    return number(description, exclusiveMinimum=0, **rules)
