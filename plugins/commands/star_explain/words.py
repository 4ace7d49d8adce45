"""Numbers and options of a mission in readable form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

MINUTE: Final = 60.0
LONG: Final = 120.0  # s: longer times are given in minutes


def seconds(time: float) -> str:
    """Return a time.

    >>> seconds(8.04), seconds(61.2), seconds(125.0)
    ('8.0 s', '61 s', '2 min 5 s')
    """
    few = 10.0  # s: shorter times are given to a tenth
    if time < LONG:
        return f"{time:.1f} s" if time < few else f"{time:.0f} s"
    minutes, rest = divmod(round(time), int(MINUTE))
    return f"{minutes} min {rest} s" if rest else f"{minutes} min"


def value(given: Any) -> str:
    """Return a value as written in a mission.

    >>> value([0.0, 1, True]), value({"shape": "line"}), value(None)
    ('[0, 1, true]', '{shape: line}', 'null')
    """
    if isinstance(given, bool) or given is None:
        return {True: "true", False: "false", None: "null"}[given]
    if isinstance(given, int | float):
        return f"{given:g}" if isinstance(given, float) else str(given)
    if isinstance(given, list | tuple):
        return "[" + ", ".join(map(value, given)) + "]"
    if isinstance(given, Mapping):
        return "{" + ", ".join(f"{key}: {value(inner)}" for key, inner in given.items()) + "}"
    return " ".join(str(given).split())


def options(given: Mapping[str, Any]) -> str:
    """Return options as text: ``height: 0.8, speed: 0.3``."""
    return ", ".join(f"{name}: {value(one)}" for name, one in given.items())


def left_out(given: Mapping[str, Any], schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a schema that are not set, with their defaults."""
    return {
        name: option["default"]
        for name, option in schema.get("properties", {}).items()
        if name not in given and isinstance(option, Mapping) and "default" in option
    }
