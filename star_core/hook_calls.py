"""Calls the implementations of a hook plugin by plugin, so that a failure has a plugin's name.

Each call is a call of pluggy's: ``specname``, ``tryfirst``, ``trylast``, ``optionalhook`` and
wrappers behave as pluggy documents, and a function without ``@hookimpl`` is ignored.
"""

from __future__ import annotations

from typing import NamedTuple

import pluggy


class PluginCall(NamedTuple):
    """One plugin's implementations of one hook.

    Attributes:
        plugin: The name it is registered by.
        caller: Calls its implementations, and no other plugin's.
        wraps: Whether one of them is a wrapper: the other plugins are then to be called within
            this call, by `pluggy.HookCaller.call_extra`.
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
