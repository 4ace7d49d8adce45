"""Finds plugins and the records that they offer."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import pluggy

from star_core.discovery import (
    BLOCK_PLUGINS,
    Source,
    blocked_hint,
    blocked_plugins,
    installed_plugins,
)
from star_core.errors import InputError, PluginError, suggestion
from star_core.plugin_support import hookspecs
from star_core.plugin_support.guard import PluginGuard
from star_core.plugin_support.option_schema import sound
from star_core.plugin_support.plugin_manager import PluginManager, default_name
from star_core.plugin_support.specs import SPECS, KindSpec, MissionSpec, Spec


@dataclass(frozen=True, slots=True)
class Found:
    """A record of a plugin, of the class of its kind, and its origin."""

    offer: Any
    source: Source


class Registry:
    """All records that installed plugins offer.

    A plugin that cannot be loaded is skipped and listed in `broken`: it must not ground a mission
    that does not use it. (pluggy's own loader would raise at the first one, and would silently drop
    the second of two plugins of one name.)

    Args:
        plugins: Further plugins to register, beside the installed ones.
        installed: Whether to load the installed ones.

    Attributes:
        manager: Holds the plugins and calls their hooks. What a plugin raises there is a
            `PluginError` that names it, unless it is an `InputError`; a plugin that raises where it
            offers records is skipped.
        broken: Why each skipped plugin could not be used.
        kinds: The class of the records of each kind; those that plugins add are the last.

    Raises:
        PluginError: As `add`, for one of `plugins`.
    """

    def __init__(self, *plugins: object, installed: bool = True) -> None:
        self.manager = PluginManager(self._guard, self._checked)
        self.broken: dict[Source, str] = {}
        self.kinds: dict[str, type[Spec]] = dict(SPECS)
        self._sources: dict[str, Source] = {}
        self._failed: dict[str, BaseException] = {}
        self._origins: dict[int, Found] = {}  # by the `id` of the record
        self._plugins: dict[str, dict[str, list[Found]]] = {}
        self._installed = installed
        for entry, source in installed_plugins() if installed else ():
            try:
                self._register(entry.load(), source)
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # noqa: BLE001 -- whatever an import may raise
                self._skip(source, error)
        names = [default_name(plugin) for plugin in plugins]
        for plugin, name in zip(plugins, names, strict=True):
            self._register(plugin, Source(name))
        self._collect(*names)

    def add(self, plugin: object, source: Source) -> None:
        """Register a plugin and collect all records anew.

        A plugin whose wrapper raises at the records of this one is skipped from now on.

        Raises:
            PluginError: It is registered already; it implements a hook that does not exist, or with
                unknown arguments; or it yields a record of another class or that is not `sound`.
        """
        self._register(plugin, source)
        self._collect(source.plugin)

    def _register(self, plugin: object, source: Source) -> None:
        name, registered = source.plugin, self.manager.plugins
        if name in registered or any(plugin is other for other in registered.values()):
            raise PluginError(f"plugin {source} is registered already", "duplicate-plugin")
        self._sources[name] = source
        try:
            self.manager.register(plugin, name)
        except pluggy.PluginValidationError as error:
            raise PluginError(" ".join(str(error).split()), "contract-broken") from error

    def _collect(self, *added: str) -> None:
        """Collect all records; skip plugins that fail, but raise the error of one of `added`."""
        errors: list[BaseException] = []
        while True:
            self._failed, self._origins = {}, {}
            self.manager.hook.star_kinds()
            for plugin, text in self.manager.unknown_hooks():
                self._failed.setdefault(plugin, PluginError(text, "contract-broken"))
            if not self._failed:
                self._plugins = {}
                for kind in reversed(self.kinds):  # verbs use the kinds that plugins add
                    self._plugins[kind] = self._of(kind)
            if not self._failed:
                break
            for name, error in self._failed.items():
                self.manager.remove(name)
                if name in added:
                    errors.append(error)
                else:
                    self._skip(self._sources[name], error)
        if errors:
            raise errors[0]

    def _of(self, kind: str) -> dict[str, list[Found]]:
        """Return the records of a kind by name, sorted by origin."""
        results = getattr(self.manager.hook, f"star_{kind}s")(registry=self)
        plugins = [self._origins[id(record)] for records in results for record in records]
        by_name: dict[str, list[Found]] = {}
        for plugin in sorted(plugins, key=lambda plugin: str(plugin.source)):
            by_name.setdefault(plugin.offer.name, []).append(plugin)
        if kind == "command":
            self._refuse_namesakes(by_name)
        return by_name

    def _refuse_namesakes(self, commands: Mapping[str, list[Found]]) -> None:
        """Fail the plugins with a command that is called like one of STAR's own."""
        for name, plugins in commands.items():
            if any(plugin.source.own for plugin in plugins):
                text = f"command {name!r}: STAR has a command of that name itself"
                for other in (plugin.source.plugin for plugin in plugins if not plugin.source.own):
                    error = PluginError(text, "duplicate-plugin")
                    self._failed.setdefault(other, error)

    def _checked(self, plugin: str, hook: str, result: Any) -> Any:
        """Return the records that a plugin offers; those that it was handed keep their origins."""
        kind = _kind_of(hook)
        if result is None or not self._offers(hook):
            return result
        return [
            item if id(item) in self._origins else self._record(plugin, kind, item)
            for item in result
        ]

    def _record(self, plugin: str, kind: str, item: Any) -> Any:
        expected, source = self.kinds.get(kind, KindSpec), self._sources[plugin]
        if not isinstance(item, expected):
            text = f"star_{kind}s() yields {type(item).__name__}, expected {expected.__name__}"
            raise PluginError(text, "contract-broken")
        if isinstance(item, KindSpec):
            self._add_kind(item)
            return item
        offer = sound(kind, item, trusted=source.own)
        self._origins[id(offer)] = Found(offer, source)
        return offer

    def _add_kind(self, kind: KindSpec) -> None:
        if not re.fullmatch(r"[a-z][a-z_]*", kind.name):
            text = f"kind {kind.name!r}: a name is lower-case letters and '_'"
            raise PluginError(text, "contract-broken")
        if self.kinds.setdefault(kind.name, kind.record) is not kind.record:
            raise PluginError(f"there is a kind {kind.name!r} already", "duplicate-plugin")
        self.manager.add_hook(f"star_{kind.name}s", _offer)

    def _offers(self, hook: str) -> bool:
        return _kind_of(hook) in {*self.kinds, "kind"}

    @contextmanager
    def _guard(self, plugin: str, hook: str) -> Iterator[None]:
        if not self._offers(hook):
            try:
                with PluginGuard(f"{hook} of {self._sources[plugin]}"):
                    yield
            except PluginError as error:
                if isinstance(error.__cause__, InputError):
                    raise error.__cause__ from None
                raise
            return
        try:
            yield
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 -- it is skipped, or raised
            self._failed.setdefault(plugin, error)

    def _skip(self, source: Source, error: BaseException) -> None:
        self.broken[source] = " ".join(f"{type(error).__name__}: {error}".split())  # on one line

    def source(self, plugin: str) -> Source:
        """Return the origin of a plugin that `manager` holds under that name."""
        return self._sources[plugin]

    def names(self, kind: str) -> tuple[str, ...]:
        """Return every name of a kind, in alphabetical order."""
        return tuple(sorted(self._plugins.get(kind, ())))

    def missing_monitors(self) -> str:
        """Return why no flight has the monitors that come with STAR; empty if all have them."""
        monitors = self._plugins["monitor"].values()
        if not self._installed or any(plugin.source.own for of in monitors for plugin in of):
            return ""
        why = [f"{BLOCK_PLUGINS} is {blocked!r}"] if (blocked := blocked_plugins()) else []
        broken = ((source, text) for source, text in self.broken.items() if source.own)
        why += [f"plugin {source} was left out: {text}" for source, text in broken]
        return f"the flight goes without the monitors that come with STAR: {'; '.join(why)}"

    def observers(self) -> dict[str, object]:
        """Return the plugins that observe flights by name, in the order of registration."""
        names = set().union(*map(self.manager.implementing, hookspecs.OBSERVING))
        return {name: plugin for name, plugin in self.manager.plugins.items() if name in names}

    def offers(self) -> dict[str, dict[str, Any]]:
        """Return the records by kind and name.

        Two of one name become one with the options of both, without their schemas: `find` refuses
        the name and explains why.
        """
        return {
            kind: {name: _merged(self._plugins[kind][name]) for name in self.names(kind)}
            for kind in self.kinds
        }

    def find(self, kind: str, name: str) -> Found:
        """Return the record of that kind and name.

        Raises:
            PluginError: There is none, and the message suggests the nearest one; or there are two.
        """
        matches = self._plugins.get(kind, {}).get(name, [])
        words = kind.replace("_", " ")
        if not matches:
            skipped = "".join(
                f"; plugin {source} was left out: {why}" for source, why in self.broken.items()
            )
            hint = blocked_hint(name) or suggestion(name, self.names(kind), "there are")
            raise PluginError(f"no {words} named {name!r}{hint}{skipped}", "unknown-plugin")
        if len(matches) > 1:
            sources = " and ".join(str(match.source) for match in matches)
            raise PluginError(
                f"two plugins offer {words} {name!r}: {sources}; uninstall one", "duplicate-plugin"
            )
        return matches[0]

    def __iter__(self) -> Iterator[tuple[str, Found]]:
        """Yield every kind and record, those of equal names included."""
        for kind in self.kinds:
            for name in self.names(kind):
                for plugin in self._plugins[kind][name]:
                    yield kind, plugin


def _kind_of(hook: str) -> str:
    return hook.removeprefix("star_").removesuffix("s")


def _offer(registry: Registry) -> Iterable[Spec]:  # type: ignore[empty-body]
    """Offer records of a kind that a plugin adds."""


def _merged(plugins: list[Found]) -> Any:
    first = plugins[0].offer
    if len(plugins) == 1 or not isinstance(first, MissionSpec):
        return first
    names = [name for plugin in plugins for name in plugin.offer.options.get("properties", {})]
    options = {"type": "object", "properties": {name: {} for name in names}}
    return replace(first, options=options)


def guarded(kind: str, plugin: Found, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return the result of a function of a plugin; what a third party's generator yields as a list.

    Raises:
        PluginError: A third party's raised neither `InputError` nor, in a command, `SystemExit`.
    """
    if plugin.source.own:  # its other errors are bugs, and show their tracebacks
        return function(*arguments)
    try:
        with PluginGuard(f"{kind} {plugin.offer.name!r} ({plugin.source})"):
            result = function(*arguments)
            return list(result) if isinstance(result, Generator) else result
    except PluginError as error:
        cause = error.__cause__
        if isinstance(cause, InputError | BrokenPipeError):
            raise cause from None
        if kind == "command" and isinstance(cause, SystemExit):
            raise cause from None
        raise
