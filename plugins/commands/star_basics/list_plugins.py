"""``star plugins``: lists the installed plugins, or describes one."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Mapping
from itertools import groupby
from types import ModuleType
from typing import Any, Final, TypeAlias

from star_basics.columns import columns
from star_core import PluginError, Registry
from star_core.commands import Found, Source, completes
from star_core.toolkit import Spec, suggestion

NO_OPTIONS: Final = {"type": "object", "properties": {}}  # of commands, for example

Plugins: TypeAlias = list[tuple[str, Found]]
"""Kinds and records."""


def configure(line: ArgumentParser) -> None:
    """Add the options of the command."""
    name = line.add_argument(
        "name", nargs="?", help="plugin, distribution or kind to describe; all if not given"
    )
    completes(name, _names)
    line.add_argument("--json", action="store_true", help="as JSON, with option schemas")


def run(options: Namespace, registry: Registry) -> int:
    """Print the list or the descriptions and return the exit status, 0.

    Raises:
        PluginError: There is no plugin of that name.
    """
    plugins = chosen(registry, options.name)
    if options.json:
        print(as_json(plugins, registry.broken))
    elif options.name is None:
        print(as_text(plugins, registry.broken))
    else:
        from star_basics.describe_plugin import describe

        print("\n\n".join(describe(kind, plugin) for kind, plugin in plugins))
    return 0


def chosen(registry: Registry, name: str | None = None) -> Plugins:
    """Return all plugins; with a `name`, those of that name, distribution or kind.

    A ``verb`` is a task, as everywhere on the command line.

    Raises:
        PluginError: There are none of that name.
    """
    name = "task" if name == "verb" else name
    plugins = [*registry, *_observers(registry)]
    if name is None:
        return plugins
    all_names: set[str] = set()
    matches = []
    for kind, plugin in plugins:
        distribution, _, entry = plugin.source.plugin.partition(":")
        names = {plugin.offer.name, entry, distribution, kind, f"{kind}s"}
        all_names |= names
        if name in names:
            matches.append((kind, plugin))
    if not matches:
        hint = suggestion(name, sorted(all_names)) or "; `star plugins` lists all plugins"
        raise PluginError(f"no plugin named {name!r}{hint}", "unknown-plugin")
    return matches


def as_text(plugins: Plugins, broken: Mapping[Source, str]) -> str:
    """Return a table: names and summaries by kind; the distribution of those of third parties."""
    lines: list[str] = []
    for kind, group in groupby(plugins, key=lambda plugin: plugin[0]):
        lines += [
            f"{kind}s".replace("_", " "),
            *columns(map(_row, (plugin for _, plugin in group))),
            "",
        ]
    lines.append("`star plugins NAME` describes a plugin and its options.")
    return "\n".join([*lines, *(f"left out: {source}: {why}" for source, why in broken.items())])


def as_json(plugins: Plugins, broken: Mapping[Source, str]) -> str:
    """Return one JSON object: ``plugins``, with their options' schemas, and ``broken``."""
    records: list[dict[str, Any]] = [
        {
            "kind": kind,
            "name": plugin.offer.name,
            "summary": plugin.offer.summary,
            "plugin": plugin.source.plugin,
            "version": plugin.source.version,
            "options": dict(options_of(plugin)),
        }
        for kind, plugin in plugins
    ]
    reasons = {str(source): why for source, why in broken.items()}
    return json.dumps({"plugins": records, "broken": reasons}, indent=2)


def options_of(plugin: Found) -> Mapping[str, Any]:
    """Return the JSON Schema of a plugin's options."""
    schema: Mapping[str, Any] = getattr(plugin.offer, "options", NO_OPTIONS)
    return schema


def _row(plugin: Found) -> tuple[str, str]:
    source = "" if plugin.source.own else f"  [{plugin.source}]"
    return plugin.offer.name, plugin.offer.summary + source


def _observers(registry: Registry) -> Iterator[tuple[str, Found]]:
    """Yield the plugins that observe flights; the summary is the first line of the docstring."""
    for name, plugin in sorted(registry.observers().items()):
        text = (plugin if isinstance(plugin, ModuleType) else type(plugin)).__doc__ or ""
        first = text.strip().partition("\n")[0].replace("``", "")
        title, _, rest = first.partition(": ")
        summary = rest[:1].upper() + rest[1:] if title.startswith("Observer") else first
        spec = Spec(name=name.rpartition(":")[2], summary=summary)
        yield "observer", Found(spec, registry.source(name))


def _names(prefix: str, **_context: object) -> list[str]:
    """Return the names of plugins that begin so."""
    names = {plugin.offer.name for _kind, plugin in Registry()}
    return sorted(name for name in names if name.startswith(prefix))
