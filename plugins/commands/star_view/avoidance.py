"""The radius that an avoider keeps free around each agent."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from star_core import PluginError, Registry
from star_core.toolkit import fill_defaults


def radius(avoider: str, options: Mapping[str, Any], registry: Registry) -> float | None:
    """Return an avoider's option ``radius``, m; None if it has no such option."""
    try:
        schema = registry.find("avoider", avoider).offer.options
    except PluginError:  # a recorded flight, whose avoider is not installed here
        schema = {"type": "object", "properties": {}}
    value = fill_defaults(options, schema).get("radius")
    return None if value is None else float(value)
