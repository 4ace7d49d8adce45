"""Lists the installed plugins with their distributions and options."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from star_core.contracts import NO_OPTIONS, MissionSpec
from star_core.registry import Found, Registry


def as_text(registry: Registry) -> str:
    """Return one paragraph for each kind and one line for each plugin and option."""
    lines: list[str] = []
    last = ""
    for kind, found in registry:
        if kind != last:
            lines += ["", f"{kind}s"] if lines else [f"{kind}s"]
            last = kind
        lines.append(f"  {found.offer.name:12} {found.offer.summary}  [{found.source}]")
        schema = _options(found)
        required = schema.get("required", ())
        for name, option in schema.get("properties", {}).items():
            option = option if isinstance(option, dict) else {}  # noqa: PLW2901 -- True is a schema
            default = f" (default {json.dumps(option['default'])})" if "default" in option else ""
            must = " (must be given)" if name in required else ""
            lines.append(f"      {name}: {option.get('description', '')}{default}{must}")
    lines += [f"left out: {source}: {why}" for source, why in registry.broken.items()]
    return "\n".join(lines)


def as_json(registry: Registry) -> str:
    """Return the same as one JSON object: ``plugins`` and ``broken``."""
    plugins: list[dict[str, Any]] = [
        {
            "kind": kind,
            "name": found.offer.name,
            "summary": found.offer.summary,
            "plugin": found.source.plugin,
            "version": found.source.version,
            "options": dict(_options(found)),
        }
        for kind, found in registry
    ]
    broken = {str(source): why for source, why in registry.broken.items()}
    return json.dumps({"plugins": plugins, "broken": broken}, indent=2)


def _options(found: Found) -> Mapping[str, Any]:
    return found.offer.options if isinstance(found.offer, MissionSpec) else NO_OPTIONS
