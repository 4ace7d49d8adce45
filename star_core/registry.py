"""Finds plugins and the records that they offer."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import Distribution, EntryPoint, entry_points
from types import ModuleType
from typing import Any, Final

import pluggy

from star_core import hookspecs
from star_core.contracts import SPECS, MissionSpec
from star_core.errors import PluginError, suggestion
from star_core.hookspecs import plugin_calls
from star_core.plugin_support.option_schema import sound

ENTRY_POINT_GROUP: Final = "star.plugins"
OWN: Final = "star-swarm:"
"""Prefix of the names of STAR's own plugins; their records are checked by a test, not when they
are loaded."""

BLOCK_PLUGINS: Final = "STAR_BLOCK_PLUGINS"
"""Environment variable: names of entry points that are not loaded, separated by commas."""

ALLOW_PLUGINS: Final = "STAR_ALLOW_PLUGINS"
"""Environment variable: likewise, of those beside STAR's own that are loaded; by default all."""

KINDS: Final = tuple(SPECS)


@dataclass(frozen=True, slots=True)
class Source:
    """Origin of a plugin.

    Attributes:
        plugin: ``distribution:entry point``.
        version: The distribution's version.
    """

    plugin: str
    version: str = ""

    @property
    def own(self) -> bool:
        """Whether it is one of STAR's own plugins."""
        return self.plugin.startswith(OWN)

    def __str__(self) -> str:
        distribution, _, entry = self.plugin.partition(":")
        return f"{distribution} {self.version}:{entry}" if self.version else self.plugin


@dataclass(frozen=True, slots=True)
class Found:
    """A record of a plugin, of the class that `SPECS` has for its kind, and its origin."""

    offer: Any
    source: Source


class Registry:
    """All records that installed plugins offer.

    A plugin that cannot be loaded is skipped and listed in `broken`: it must not ground a mission
    that does not use it. (pluggy's own loader would raise at the first one, and would silently drop
    the second of two plugins of one name.)

    A wrapper of a hook that offers plugins receives the records of all the others, as pluggy
    documents; records that it adds or replaces are attributed to its own plugin.

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
        self._results: dict[str, dict[str, list[Found]]] = {kind: {} for kind in KINDS}
        self._found: dict[str, dict[str, list[Found]]] = {kind: {} for kind in KINDS}
        for entry in sorted(entry_points(group=ENTRY_POINT_GROUP)) if installed else ():
            source = _source(entry)
            if not _permitted(entry.name, source):
                continue
            try:
                self.add(entry.load(), source)
            except (Exception, SystemExit) as error:  # noqa: BLE001 -- whatever an import may raise
                self.broken[source] = f"{type(error).__name__}: {error}"
        for plugin in plugins:
            self.add(plugin, Source(_default_name(plugin)))

    def add(self, plugin: object, source: Source) -> None:
        """Register a plugin and collect its records.

        Raises:
            PluginError: It is registered already; it implements a hook that does not exist, or with
                unknown arguments; or it yields a record of another class or that is not `sound`.
        """
        name = source.plugin
        if self.manager.has_plugin(name) or self.manager.is_registered(plugin):
            raise PluginError(f"plugin {source} is registered already", "duplicate-plugin")
        self._sources[name] = source
        try:
            self.manager.register(_hashable(plugin), name=name)
            _require_known_hooks(self.manager, name)
            self._found = self._collected(name)
        except (Exception, SystemExit) as error:
            self._remove(name)
            if isinstance(error, pluggy.PluginValidationError):
                raise PluginError(" ".join(str(error).split()), "contract-broken") from error
            raise

    def _remove(self, name: str) -> None:
        for results in self._results.values():
            results.pop(name, None)
        if self.manager.has_plugin(name):
            self.manager.unregister(name=name)

    def _collected(self, added: str) -> dict[str, dict[str, list[Found]]]:
        """Return the records by kind and name, after the wrappers of their hooks.

        A plugin whose wrapper raises is skipped, unless it is the plugin being `added`: then its
        error is raised.
        """
        while True:
            try:
                return {kind: self._collect(kind) for kind in KINDS}
            except _WrapperError as failed:
                plugin, error = failed.plugin, failed.error
                if plugin == added:
                    raise error from None
                self.broken[self._sources[plugin]] = f"{type(error).__name__}: {error}"
                self._remove(plugin)

    def _collect(self, kind: str) -> dict[str, list[Found]]:
        calls = plugin_calls(self.manager, f"star_{kind}s")
        given = self._results[kind]
        for call in calls:  # each plugin once; wrappers always, with the records of the others
            if not call.wraps and call.plugin not in given:
                given[call.plugin] = list(self._checked(kind, call.plugin, call.caller(), {}))
        found = [given[call.plugin] for call in calls if not call.wraps]
        for call in reversed([call for call in calls if call.wraps]):
            known = {id(one.offer): one for own in found for one in own}
            # pluggy calls the last one first
            offers = [[one.offer for one in own] for own in reversed(found)]
            try:
                results = call.caller.call_extra([lambda own=own: own for own in offers], {})
                found = [list(self._checked(kind, call.plugin, results, known))]
            except (Exception, SystemExit) as error:
                raise _WrapperError(call.plugin, error) from error
        by_name: dict[str, list[Found]] = {}
        for one in sorted((one for own in found for one in own), key=lambda one: str(one.source)):
            by_name.setdefault(one.offer.name, []).append(one)
        return by_name

    def _checked(
        self, kind: str, plugin: str, results: Any, known: Mapping[int, Found]
    ) -> Iterator[Found]:
        """Yield checked results of a hook call; those that are not `known` are this plugin's."""
        for result in results:
            for offer in result:
                if id(offer) in known:
                    yield known[id(offer)]
                elif isinstance(offer, SPECS[kind]):
                    source = self._sources[plugin]
                    yield Found(sound(kind, offer, trusted=source.own), source)
                else:
                    raise PluginError(
                        f"star_{kind}s() yields {type(offer).__name__}, "
                        f"expected {SPECS[kind].__name__}",
                        "contract-broken",
                    )

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


class _WrapperError(Exception):
    """A plugin's wrapper of a hook that offers plugins raised."""

    def __init__(self, plugin: str, error: BaseException) -> None:
        super().__init__(plugin)
        self.plugin, self.error = plugin, error


def _merged(found: list[Found]) -> Any:
    first = found[0].offer
    if len(found) == 1 or not isinstance(first, MissionSpec):
        return first
    names = [name for one in found for name in one.offer.options.get("properties", {})]
    options = {"type": "object", "properties": {name: {} for name in names}}
    return replace(first, options=options)


def _default_name(plugin: object) -> str:
    """Return the name of a plugin that is not installed."""
    if isinstance(plugin, ModuleType):
        return plugin.__name__
    return f"{type(plugin).__module__}:{type(plugin).__name__}"


def _hashable(plugin: object) -> object:
    """Return the plugin or, if it has no hash and pluggy cannot keep it, its functions."""
    try:
        hash(plugin)
    except TypeError:
        functions = ModuleType(_default_name(plugin))
        vars(functions).update((name, getattr(plugin, name)) for name in dir(plugin))
        return functions
    return plugin


def _require_known_hooks(manager: pluggy.PluginManager, plugin: str) -> None:
    for caller in manager.get_hookcallers(manager.get_plugin(plugin)) or ():
        own = (one for one in caller.get_hookimpls() if one.plugin_name == plugin)
        if not caller.has_spec() and not all(one.optionalhook for one in own):
            known = [name for name in vars(hookspecs) if name.startswith("star_")]
            hint = suggestion(caller.name, known)
            raise PluginError(f"no hook named {caller.name!r}{hint}", "contract-broken")


def _permitted(name: str, source: Source) -> bool:
    """Return whether the environment lets an entry point be loaded."""
    blocked = os.environ.get(BLOCK_PLUGINS, "").split(",")
    allowed = os.environ.get(ALLOW_PLUGINS)
    return name not in blocked and (source.own or allowed is None or name in allowed.split(","))


def _source(entry: EntryPoint) -> Source:
    if entry.dist is None:
        return Source(entry.name)
    name, version = _distribution(entry.dist)
    return Source(f"{name}:{entry.name}", version)


@cache
def _distribution(distribution: Distribution) -> tuple[str, str]:
    """Return name and version; each access to `metadata` reads the file again."""
    metadata = distribution.metadata
    return metadata["Name"], metadata["Version"]
