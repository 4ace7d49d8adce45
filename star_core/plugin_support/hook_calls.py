"""Calls hooks one plugin at a time, so that an error is attributed to its plugin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Final, NamedTuple

import pluggy

from star_core import hookspecs
from star_core.errors import PluginError, suggestion
from star_core.plugin_support.discovery import Source
from star_core.plugin_support.option_schema import sound
from star_core.plugin_support.specs import SPECS

KINDS: Final = tuple(SPECS)


class PluginCall(NamedTuple):
    """One plugin's implementations of one hook, called by pluggy.

    Attributes:
        plugin: The name that it is registered under.
        caller: Calls its implementations, and no other plugin's.
        wraps: Whether one of them is a wrapper: the other plugins are then called within this
            call, by `pluggy.HookCaller.call_extra`.
    """

    plugin: str
    caller: pluggy.HookCaller
    wraps: bool


def plugin_calls(manager: pluggy.PluginManager, hook: str) -> list[PluginCall]:
    """Return the calls of a hook, one per plugin, in the order in which pluggy makes them."""
    implementations: dict[str, list[pluggy.HookImpl]] = {}
    for implementation in reversed(getattr(manager.hook, hook).get_hookimpls()):
        implementations.setdefault(implementation.plugin_name, []).append(implementation)
    return [
        PluginCall(
            name,
            manager.subset_hook_caller(hook, manager.get_plugins() - {own[0].plugin}),
            any(one.wrapper or one.hookwrapper for one in own),
        )
        for name, own in implementations.items()
    ]


def register(manager: pluggy.PluginManager, plugin: object, name: str) -> None:
    """Register a plugin; its hooks must exist, and have the arguments of their specifications.

    Raises:
        PluginError: It implements a hook that does not exist.
        pluggy.PluginValidationError: An implementation has unknown arguments.
    """
    try:
        hash(plugin)
    except TypeError:  # pluggy cannot keep it: register its functions instead
        functions = ModuleType(default_name(plugin))
        vars(functions).update((each, getattr(plugin, each)) for each in dir(plugin))
        plugin = functions
    manager.register(plugin, name=name)
    for caller in manager.get_hookcallers(plugin) or ():
        own = (one for one in caller.get_hookimpls() if one.plugin_name == name)
        if not caller.has_spec() and not all(one.optionalhook for one in own):
            known = [hook for hook in vars(hookspecs) if hook.startswith("star_")]
            hint = suggestion(caller.name, known)
            raise PluginError(f"no hook named {caller.name!r}{hint}", "contract-broken")


def default_name(plugin: object) -> str:
    """Return the name of a plugin that is not installed."""
    if isinstance(plugin, ModuleType):
        return plugin.__name__
    return f"{type(plugin).__module__}:{type(plugin).__name__}"


@dataclass(frozen=True, slots=True)
class Found:
    """A record of a plugin, of the class that `SPECS` has for its kind, and its origin."""

    offer: Any
    source: Source


class WrapperError(Exception):
    """A plugin's wrapper of a hook that offers plugins raised."""

    def __init__(self, plugin: str, error: BaseException) -> None:
        super().__init__(plugin)
        self.plugin, self.error = plugin, error


class Offers:
    """Collects the records that plugins offer, each plugin called once, through all wrappers.

    A wrapper of a hook that offers plugins receives the records of all the others, as pluggy
    documents; records that it adds or replaces are attributed to its own plugin.

    Args:
        manager: Holds the plugins.
        sources: Their origins, by the names that they are registered under.
    """

    def __init__(self, manager: pluggy.PluginManager, sources: Mapping[str, Source]) -> None:
        self._manager = manager
        self._sources = sources
        self._own: dict[str, dict[str, list[Found]]] = {kind: {} for kind in KINDS}

    def forget(self, plugin: str) -> None:
        """Drop what a plugin has offered."""
        for own in self._own.values():
            own.pop(plugin, None)

    def of(self, kind: str) -> dict[str, list[Found]]:
        """Return the records of a kind by name, sorted by origin.

        Raises:
            PluginError: A plugin yields a record of another class or that is not `sound`.
            WrapperError: A wrapper raised.
        """
        calls = plugin_calls(self._manager, f"star_{kind}s")
        given = self._own[kind]
        for call in calls:  # wrappers are called always, with the records of the others
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
                raise WrapperError(call.plugin, error) from error
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
