"""Lists the installed plugins."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from itertools import groupby
from types import ModuleType
from typing import Any, TypeAlias

from star_core import hookspecs
from star_core.commands.columns import columns
from star_core.errors import PluginError, suggestion
from star_core.plugin_support.discovery import Source
from star_core.plugin_support.specs import NO_OPTIONS, MissionSpec, Spec
from star_core.registry import Found, Registry

Plugins: TypeAlias = list[tuple[str, Found]]
"""Kinds and records."""


def chosen(registry: Registry, name: str | None = None) -> Plugins:
    """Return all plugins; with a `name`, those of that name, distribution or kind.

    Raises:
        PluginError: There are none of that name.
    """
    plugins = [*registry, *_observers(registry)]
    if name is None:
        return plugins
    known: set[str] = set()
    found = []
    for kind, one in plugins:
        distribution, _, entry = one.source.plugin.partition(":")
        names = {one.offer.name, entry, distribution, kind, f"{kind}s"}
        known |= names
        if name in names:
            found.append((kind, one))
    if not found:
        hint = suggestion(name, sorted(known)) or "; `star plugins` lists all plugins"
        raise PluginError(f"no plugin named {name!r}{hint}", "unknown-plugin")
    return found


def as_text(plugins: Plugins, broken: Mapping[Source, str]) -> str:
    """Return a table: names and summaries by kind; the distribution of those of third parties."""
    lines: list[str] = []
    for kind, group in groupby(plugins, key=lambda plugin: plugin[0]):
        lines += [
            f"{kind}s".replace("_", " "),
            *columns(map(_row, (found for _, found in group))),
            "",
        ]
    lines.append("`star plugins NAME` describes a plugin and its options.")
    return "\n".join([*lines, *(f"left out: {source}: {why}" for source, why in broken.items())])


def as_json(plugins: Plugins, broken: Mapping[Source, str]) -> str:
    """Return one JSON object: ``plugins``, with their options' schemas, and ``broken``."""
    records: list[dict[str, Any]] = [
        {
            "kind": kind,
            "name": found.offer.name,
            "summary": found.offer.summary,
            "plugin": found.source.plugin,
            "version": found.source.version,
            "options": dict(options(found)),
        }
        for kind, found in plugins
    ]
    reasons = {str(source): why for source, why in broken.items()}
    return json.dumps({"plugins": records, "broken": reasons}, indent=2)


def options(found: Found) -> Mapping[str, Any]:
    """Return the JSON Schema of a plugin's options."""
    return found.offer.options if isinstance(found.offer, MissionSpec) else NO_OPTIONS


def _row(found: Found) -> tuple[str, str]:
    source = "" if found.source.own else f"  [{found.source}]"
    return found.offer.name, found.offer.summary + source


def _observers(registry: Registry) -> Iterator[tuple[str, Found]]:
    """Yield the plugins that observe flights; the summary is the first line of the docstring."""
    offering = {f"star_{kind}s" for kind in ("kind", *registry.kinds)}
    hooks = [hook for hook in vars(hookspecs) if hook.startswith("star_") and hook not in offering]
    for name in sorted(set().union(*map(registry.manager.implementing, hooks))):
        plugin = registry.manager.plugins[name]
        text = (plugin if isinstance(plugin, ModuleType) else type(plugin)).__doc__ or ""
        first = text.strip().partition("\n")[0].replace("``", "")
        title, _, rest = first.partition(": ")
        summary = rest[:1].upper() + rest[1:] if title.startswith("Observer") else first
        spec = Spec(name=name.rpartition(":")[2], summary=summary)
        yield "observer", Found(spec, registry.source(name))
