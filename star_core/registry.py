"""Finds plugins and the records that they offer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pluggy

from star_core import hookspecs
from star_core.errors import PluginError, suggestion
from star_core.plugin_support.discovery import Source, installed_plugins
from star_core.plugin_support.hook_calls import (
    KINDS,
    Found,
    Offers,
    WrapperError,
    default_name,
    register,
)
from star_core.plugin_support.specs import MissionSpec


class Registry:
    """All records that installed plugins offer.

    A plugin that cannot be loaded is skipped and listed in `broken`: it must not ground a mission
    that does not use it. (pluggy's own loader would raise at the first one, and would silently drop
    the second of two plugins of one name.)

    Args:
        plugins: Further plugins to register, beside the installed ones.
        installed: Whether to load the installed ones.

    Attributes:
        manager: Holds the plugins, for the observing hooks.
        broken: Why each skipped plugin could not be used.
    """

    def __init__(self, *plugins: object, installed: bool = True) -> None:
        self.manager = pluggy.PluginManager(hookspecs.PROJECT)
        self.manager.add_hookspecs(hookspecs)
        self.broken: dict[Source, str] = {}
        self._sources: dict[str, Source] = {}
        self._offers = Offers(self.manager, self._sources)
        self._found: dict[str, dict[str, list[Found]]] = {kind: {} for kind in KINDS}
        for entry, source in installed_plugins() if installed else ():
            try:
                self.add(entry.load(), source)
            except (Exception, SystemExit) as error:  # noqa: BLE001 -- whatever an import may raise
                self.broken[source] = f"{type(error).__name__}: {error}"
        for plugin in plugins:
            self.add(plugin, Source(default_name(plugin)))

    def add(self, plugin: object, source: Source) -> None:
        """Register a plugin and collect its records.

        A plugin whose wrapper raises at the records of this one is skipped from now on.

        Raises:
            PluginError: It is registered already; it implements a hook that does not exist, or with
                unknown arguments; or it yields a record of another class or that is not `sound`.
        """
        name = source.plugin
        if self.manager.has_plugin(name) or self.manager.is_registered(plugin):
            raise PluginError(f"plugin {source} is registered already", "duplicate-plugin")
        self._sources[name] = source
        try:
            register(self.manager, plugin, name)
            self._collect(name)
        except (Exception, SystemExit) as error:
            self._remove(name)
            if isinstance(error, pluggy.PluginValidationError):
                raise PluginError(" ".join(str(error).split()), "contract-broken") from error
            raise

    def _collect(self, added: str) -> None:
        while True:
            try:
                self._found = {kind: self._offers.of(kind) for kind in KINDS}
            except WrapperError as failed:
                plugin, error = failed.plugin, failed.error
                if plugin == added:
                    raise error from None
                self.broken[self._sources[plugin]] = f"{type(error).__name__}: {error}"
                self._remove(plugin)
            else:
                return

    def _remove(self, name: str) -> None:
        self._offers.forget(name)
        if self.manager.has_plugin(name):
            self.manager.unregister(name=name)

    def source(self, plugin: str) -> Source:
        """Return the origin of a plugin that `manager` holds under that name."""
        return self._sources[plugin]

    def names(self, kind: str) -> tuple[str, ...]:
        """Return every name of a kind, in alphabetical order."""
        return tuple(sorted(self._found[kind]))

    def offers(self) -> dict[str, dict[str, Any]]:
        """Return the records by kind and name.

        Two of one name become one with the options of both, without their schemas: `find` refuses
        the name and explains why.
        """
        return {
            kind: {name: _merged(self._found[kind][name]) for name in self.names(kind)}
            for kind in KINDS
        }

    def find(self, kind: str, name: str) -> Found:
        """Return the record of that kind and name.

        Raises:
            PluginError: There is none, and the message suggests the nearest one; or there are two.
        """
        found = self._found[kind].get(name, [])
        if not found:
            skipped = "".join(
                f"; plugin {source} was left out: {why}" for source, why in self.broken.items()
            )
            hint = suggestion(name, self.names(kind), "there are")
            raise PluginError(f"no {kind} named {name!r}{hint}{skipped}", "unknown-plugin")
        if len(found) > 1:
            sources = " and ".join(str(one.source) for one in found)
            raise PluginError(
                f"two plugins offer {kind} {name!r}: {sources}; uninstall one", "duplicate-plugin"
            )
        return found[0]

    def __iter__(self) -> Iterator[tuple[str, Found]]:
        """Yield every kind and record, those of equal names included."""
        for kind in KINDS:
            for name in self.names(kind):
                for found in self._found[kind][name]:
                    yield kind, found


def _merged(found: list[Found]) -> Any:
    first = found[0].offer
    if len(found) == 1 or not isinstance(first, MissionSpec):
        return first
    names = [name for one in found for name in one.offer.options.get("properties", {})]
    options = {"type": "object", "properties": {name: {} for name in names}}
    return replace(first, options=options)
