"""Finds plugins and hands out what they offer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import Distribution, EntryPoint, entry_points
from types import ModuleType
from typing import Any, Final

import pluggy

from star_core import hookspecs
from star_core.contracts import Offer
from star_core.errors import PluginError, instead
from star_core.options import sound

ENTRY_POINT_GROUP: Final = "star.plugins"
OWN: Final = "star-swarm:"
"""How the names of STAR's own plugins begin; a test holds what they offer, so that it need not be
looked at again each time that one is loaded."""

KINDS: Final = ("transport", "localizer", "planner", "avoider", "task", "command")


@dataclass(frozen=True, slots=True)
class Source:
    """Where a plugin comes from.

    Attributes:
        plugin: ``distribution:entry point``.
        version: The distribution's version.
    """

    plugin: str
    version: str = ""

    def __str__(self) -> str:
        distribution, _, entry = self.plugin.partition(":")
        return f"{distribution} {self.version}:{entry}" if self.version else self.plugin


@dataclass(frozen=True, slots=True)
class Found:
    """An offer and where it comes from."""

    offer: Offer[Any]
    source: Source


class Registry:
    """Everything that installed plugins offer.

    A plugin that cannot be loaded is left out and listed in `broken`: it must not ground a mission
    that does not use it. (pluggy's own loader would raise at the first one, and would drop the
    second of two plugins of one name without a word.)

    Args:
        plugins: Further plugins to register, beside the installed ones.
        installed: Whether to load the installed ones.

    Attributes:
        manager: Holds the plugins, for the hooks that watch.
        broken: Why each plugin that was left out could not be used.
    """

    def __init__(self, *plugins: object, installed: bool = True) -> None:
        self.manager = pluggy.PluginManager(hookspecs.PROJECT)
        self.manager.add_hookspecs(hookspecs)
        self.broken: dict[Source, str] = {}
        self._found: dict[str, dict[str, list[Found]]] = {kind: {} for kind in KINDS}
        for entry in sorted(entry_points(group=ENTRY_POINT_GROUP)) if installed else ():
            source = Source(*_home(entry))
            try:
                self.add(entry.load(), source)
            except (Exception, SystemExit) as error:  # noqa: BLE001 -- whatever an import may raise
                self.broken[source] = f"{type(error).__name__}: {error}"
        for plugin in plugins:
            self.add(plugin, Source(_called(plugin)))

    def add(self, plugin: object, source: Source) -> None:
        """Register a plugin and collect its offers.

        Raises:
            PluginError: It is there already, implements a hook that does not exist or asks it for
                what is not told, or offers what is no `Offer` or not `sound`.
        """
        if self.manager.has_plugin(source.plugin) or self.manager.is_registered(plugin):
            raise PluginError(f"plugin {source} is registered already")
        try:
            self.manager.register(plugin, name=source.plugin)
            _hooks_exist(self.manager.get_hookcallers(plugin) or ())
            fresh = [
                (kind, Found(offer, source))
                for kind in KINDS
                for offer in _offers(plugin, kind, trusted=source.plugin.startswith(OWN))
            ]
        except (Exception, SystemExit) as error:
            if self.manager.has_plugin(source.plugin):
                self.manager.unregister(name=source.plugin)
            if isinstance(error, pluggy.PluginValidationError):
                raise PluginError(" ".join(str(error).split())) from error
            raise
        for kind, found in fresh:
            self._found[kind].setdefault(found.offer.name, []).append(found)

    def names(self, kind: str) -> tuple[str, ...]:
        """Every name of a kind, in alphabetical order."""
        return tuple(sorted(self._found[kind]))

    def offers(self) -> dict[str, dict[str, Offer[Any]]]:
        """The offers by kind and name; two of one name are one that takes the options of both.

        What each asks of its options is left out of it: `find` refuses the name, and says why.
        """
        return {
            kind: {name: _one(self._found[kind][name]) for name in self.names(kind)}
            for kind in KINDS
        }

    def find(self, kind: str, name: str) -> Found:
        """Return the offer of that kind and name.

        Raises:
            PluginError: There is none, and the message names the nearest one; or there are two.
        """
        found = self._found[kind].get(name, [])
        if not found:
            left_out = "".join(
                f"; plugin {source} was left out: {why}" for source, why in self.broken.items()
            )
            hint = instead(name, self.names(kind), "there are")
            raise PluginError(f"no {kind} named {name!r}{hint}{left_out}")
        if len(found) > 1:
            who = " and ".join(str(one.source) for one in found)
            raise PluginError(f"two plugins offer {kind} {name!r}: {who}; uninstall one")
        return found[0]

    def __iter__(self) -> Iterator[tuple[str, Found]]:
        """Every kind and offer there is, those of equal names included."""
        for kind in KINDS:
            for name in self.names(kind):
                for found in self._found[kind][name]:
                    yield kind, found


def _offers(plugin: object, kind: str, *, trusted: bool) -> Iterable[Offer[Any]]:
    hook = getattr(plugin, f"star_{kind}s", None)
    for offer in hook() or () if hook is not None else ():
        if not isinstance(offer, Offer):
            raise PluginError(f"star_{kind}s() yields {type(offer).__name__}, expected Offer")
        yield sound(kind, offer, trusted=trusted)


def _one(found: list[Found]) -> Offer[Any]:
    first = found[0].offer
    if len(found) == 1:
        return first
    names = [name for one in found for name in one.offer.options.get("properties", {})]
    options = {"type": "object", "properties": {name: {} for name in names}}
    return replace(first, options=options)


def _called(plugin: object) -> str:
    """What a plugin is called that was given and not installed."""
    if isinstance(plugin, ModuleType):
        return plugin.__name__
    return f"{type(plugin).__module__}:{type(plugin).__name__}"


def _hooks_exist(callers: Iterable[pluggy.HookCaller]) -> None:
    for caller in callers:
        if not caller.has_spec():
            known = [name for name in vars(hookspecs) if name.startswith("star_")]
            raise PluginError(f"no hook named {caller.name!r}{instead(caller.name, known)}")


def _home(entry: EntryPoint) -> tuple[str, str]:
    if entry.dist is None:
        return entry.name, ""
    name, version = _distribution(entry.dist)
    return f"{name}:{entry.name}", version


@cache
def _distribution(distribution: Distribution) -> tuple[str, str]:
    """Name and version; each question to a distribution reads its metadata anew."""
    metadata = distribution.metadata
    return metadata["Name"], metadata["Version"]
