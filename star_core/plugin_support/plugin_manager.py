"""pluggy's manager, in which every implementation of a hook is called in a guard of its plugin."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, suppress
from functools import wraps
from inspect import isgeneratorfunction
from types import FunctionType, MethodType, ModuleType
from typing import Any, Final, TypeAlias

import pluggy

from star_core.errors import suggestion
from star_core.plugin_support import hookspecs

Guard: TypeAlias = Callable[[str, str], AbstractContextManager[object]]
"""Returns the context in which to call a plugin's implementation of a hook, by their names. One
that suppresses an exception leaves the call without a result, and a wrapper without effect."""

Check: TypeAlias = Callable[[str, str, Any], Any]
"""Returns the checked result of a plugin's implementation of a hook; called in the guard."""

FUNCTIONS: Final = (FunctionType, MethodType, classmethod, staticmethod)
"""What can implement a hook in a module."""


class PluginManager(pluggy.PluginManager):
    """Calls hooks as pluggy does, each implementation in a guard.

    Generators run within their call, so that what they raise is attributed too.

    Args:
        guard: For the calls of all plugins.
        check: For their results, unless None; where a wrapper returns several, for each of them.

    Attributes:
        plugins: By the names that they are registered under.
    """

    def __init__(self, guard: Guard, check: Check = lambda _plugin, _hook, result: result) -> None:
        super().__init__(hookspecs.PROJECT)
        self.add_hookspecs(hookspecs)
        self.plugins: dict[str, object] = {}
        self._guard = guard
        self._check = check

    def register(self, plugin: object, name: str | None = None) -> str | None:
        """Register a plugin, by its guarded functions.

        Raises:
            pluggy.PluginValidationError: An implementation has unknown arguments, or is a wrapper
                of the old style.
        """
        name = name or default_name(plugin)
        functions = ModuleType(name)
        for attribute in dir(plugin):
            options = self.parse_hookimpl_opts(plugin, attribute)
            if options is None:
                continue
            function, wraps_hook = getattr(plugin, attribute), options.get("wrapper")
            if options.get("hookwrapper") or (wraps_hook and not isgeneratorfunction(function)):
                text = f"{attribute}: expected a generator function with `wrapper=True`"
                raise pluggy.PluginValidationError(plugin, text)
            guarded = self._guarded_wrapper if wraps_hook else self._guarded
            hook = options.get("specname") or attribute
            setattr(functions, attribute, guarded(name, hook, function))
        try:
            super().register(functions, name)
        except pluggy.PluginValidationError:
            if self.has_plugin(name):
                super().unregister(name=name)
            raise
        self.plugins[name] = plugin
        return name

    def parse_hookimpl_opts(self, plugin: object, name: str) -> pluggy.HookimplOpts | None:
        """Return the options of an implementation: for a module quicker than pluggy does."""
        if type(plugin) is ModuleType and not isinstance(vars(plugin).get(name), FUNCTIONS):
            return None
        return super().parse_hookimpl_opts(plugin, name)

    def remove(self, name: str) -> None:
        """Unregister a plugin; it is not called any more, also where a hook is being called."""
        if name in self.plugins:
            del self.plugins[name]
            self.unregister(name=name)

    def implementing(self, hook: str) -> set[str]:
        """Return the names of the plugins that implement a hook."""
        return {impl.plugin_name for impl in getattr(self.hook, hook).get_hookimpls()}

    def add_hook(self, name: str, specification: Callable[..., object]) -> None:
        """Add a hook, unless there is one of that name."""
        hook = getattr(self.hook, name, None)
        if hook is None or not hook.has_spec():
            namespace = ModuleType(name)
            setattr(namespace, name, hookspecs.hookspec(specification))
            with suppress(pluggy.PluginValidationError):  # `unknown_hooks` names every plugin
                self.add_hookspecs(namespace)

    def unknown_hooks(self) -> Iterator[tuple[str, str]]:
        """Yield plugins that implement a hook that does not exist, or with other arguments."""
        hooks = vars(self.hook)
        arguments = {name: hook.spec.argnames for name, hook in hooks.items() if hook.spec}
        for name, hook in hooks.items():
            for impl in hook.get_hookimpls():
                unknown = [
                    argument
                    for argument in impl.argnames
                    if argument not in arguments.get(name, ())
                ]
                if name in arguments and unknown:
                    yield impl.plugin_name, f"hook {name} has no argument {', '.join(unknown)}"
                elif name not in arguments and not impl.optionalhook:
                    yield impl.plugin_name, f"no hook named {name!r}{suggestion(name, arguments)}"

    def _guarded(self, plugin: str, hook: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def call(*arguments: Any) -> Any:
            if plugin in self.plugins:
                with self._guard(plugin, hook):
                    result = function(*arguments)
                    return None if result is None else self._checked(plugin, hook, result)
            return None

        return call

    def _guarded_wrapper(
        self, plugin: str, hook: str, function: Callable[..., Generator[None, Any, Any]]
    ) -> Callable[..., Generator[None, Any, Any]]:
        @wraps(function)
        def call(*arguments: Any) -> Generator[None, Any, Any]:
            inner = function(*arguments)
            waiting = False
            with self._guard(plugin, hook):
                next(inner)
                waiting = True
            result = yield
            if waiting and plugin in self.plugins:
                with self._guard(plugin, hook):
                    try:
                        inner.send(result)
                    except StopIteration as end:
                        if isinstance(result, list):
                            return [self._checked(plugin, hook, records) for records in end.value]
                        return end.value
                    raise RuntimeError("a wrapper of a hook yields once")
            return result

        return call

    def _checked(self, plugin: str, hook: str, result: Any) -> Any:
        result = list(result) if isinstance(result, Generator) else result
        return self._check(plugin, hook, result)


def default_name(plugin: object) -> str:
    """Return the name of a plugin that is not installed."""
    if isinstance(plugin, ModuleType):
        return plugin.__name__
    return f"{type(plugin).__module__}:{type(plugin).__name__}"
