"""Attribution of failures to plugins, and checks of the functions that plugins provide."""

from __future__ import annotations

import inspect
import logging
import threading
import traceback
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from types import MappingProxyType, TracebackType
from typing import Any, TypeVar

from star_core.errors import CommandError, ContractError, PluginError, StarError

Value = TypeVar("Value")

log = logging.getLogger(__name__)


class PluginTimeout(BaseException):
    """Raised inside a plugin's call that does not return; ``except Exception`` does not catch it.

    The call's `PluginGuard` turns it into a `PluginError`.
    """


class Strikes:
    """Counts the failures of each plugin in flight, and tolerates the first ones.

    Args:
        limit: Number of failures of one plugin that is not tolerated any more.

    Attributes:
        pending: Messages about those that were tolerated and have not been reported.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._count = Counter[str]()
        self._in_flight = False
        self.pending: list[str] = []

    def begin_tick(self, *, in_flight: bool) -> None:
        """Begin a tick; on the ground no failure is tolerated: nothing would have been lost."""
        self._in_flight = in_flight

    def tolerates(self, plugin: str, error: PluginError) -> bool:
        """Count a failure; return whether the flight goes on."""
        if not self._in_flight or isinstance(error.__cause__, PluginTimeout | CommandError):
            return False
        self._count[plugin] += 1
        count = self._count[plugin]
        if count >= self._limit:
            return False
        self.pending.append(
            f"all agents brake: {error.message} (failure {count}; at {self._limit} all land)"
        )
        return True

    def drain(self) -> list[str]:
        """Return the pending messages once."""
        drained, self.pending = self.pending, []
        return drained


class _TimedCall:
    """Measures the time spent inside by a stopwatch, if there is one."""

    def __init__(self, stopwatch: AbstractContextManager[Any] | None) -> None:
        stopwatch = stopwatch or nullcontext()
        self._begin: Callable[[], object] = stopwatch.__enter__
        self._end: Callable[..., object] = stopwatch.__exit__

    def __enter__(self) -> None:
        self._begin()


class DroppingGuard(_TimedCall):
    """Suppresses what a plugin raises inside but `KeyboardInterrupt`, and passes it to `drop`."""

    def __init__(
        self,
        drop: Callable[[BaseException], None],
        stopwatch: AbstractContextManager[Any] | None,
    ) -> None:
        super().__init__(stopwatch)
        self._drop = drop

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        self._end(kind, error, trace)
        if error is None or isinstance(error, KeyboardInterrupt):
            return False
        self._drop(error)
        return True


class PluginGuard(_TimedCall):
    """Turns any exception raised inside into a `PluginError` that names the plugin.

    The operator's `KeyboardInterrupt` alone is not the plugin's.

    >>> with PluginGuard("avoider 'mine' (1.0)"):
    ...     {}["gain"]
    Traceback (most recent call last):
    star_core.errors.PluginError: avoider 'mine' (1.0): KeyError: 'gain' (<...>:2) [plugin-failed]

    Args:
        plugin: Kind, name and source of the plugin.
        stopwatch: Measures the time spent inside.
    """

    def __init__(
        self,
        plugin: str,
        stopwatch: AbstractContextManager[Any] | None = None,
    ) -> None:
        super().__init__(stopwatch)
        self.plugin = plugin

    def __exit__(
        self, kind: object, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end(kind, error, trace)
        if error is not None:
            self._attribute(error, trace)

    def attempt(
        self, strikes: Strikes, work: Callable[[], Value], otherwise: Callable[[], Value]
    ) -> Value:
        """Return the result of `work`; of `otherwise` if it fails and that is tolerated."""
        self._begin()
        try:
            result = work()
        except BaseException as error:
            self._end(type(error), error, error.__traceback__)
            try:
                self._attribute(error, error.__traceback__)
            except PluginError as failure:
                if strikes.tolerates(self.plugin, failure):
                    return otherwise()
                raise
            raise
        self._end(None, None, None)
        return result

    def _attribute(self, error: BaseException, trace: TracebackType | None) -> None:
        """Raise the `PluginError` for an error of the plugin."""
        if isinstance(error, KeyboardInterrupt):
            return
        log.debug("%s raised", self.plugin, exc_info=error)
        if isinstance(error, StarError):
            raise PluginError(f"{self.plugin}: {error}") from error
        frames = traceback.extract_tb(trace)
        innermost = frames[-2 if isinstance(error, PluginTimeout) else -1]  # not the watchdog's
        text = " ".join(f"{type(error).__name__}: {error}".split())  # on one line
        raise PluginError(
            f"{self.plugin}: {text} ({innermost.filename}:{innermost.lineno})"
        ) from error


def close_all(plugins: Iterable[tuple[PluginGuard, object]]) -> list[str]:
    """Close every plugin that has ``close()``, one after the other; return their errors.

    Raises:
        KeyboardInterrupt: The operator interrupted one that hangs; the others are closed.
    """
    errors, interrupt = [], None
    for guard, plugin in plugins:
        try:
            with guard:
                getattr(plugin, "close", lambda: None)()
        except PluginError as error:  # the others have yet to be closed
            errors.append(str(error))
        except KeyboardInterrupt as error:
            interrupt = error
    if interrupt is not None:
        raise interrupt
    return errors


def leaked_threads(before: Collection[threading.Thread]) -> str:
    """Return which threads were started since, and keep the process from its end."""
    leaked = [t.name for t in threading.enumerate() if t not in before and not t.daemon]
    if not leaked:
        return ""
    count = f"{len(leaked)} thread{'s' if len(leaked) > 1 else ''}"
    still = "still run" if len(leaked) > 1 else "still runs"
    return f"{count} {still} after the flight: {', '.join(sorted(set(leaked)))}"


def require_methods(plugin: object, contract: type) -> None:
    """Check that a plugin has the methods of its contract, with the arguments they are called with.

    Raises:
        ContractError: A method is missing, or takes other arguments; the message names it.
    """
    if not isinstance(plugin, contract):
        has = set(dir(plugin))
        methods = (name for name in vars(contract) if not name.startswith("_"))
        missing = ", ".join(f"{name}()" for name in methods if name not in has)
        raise ContractError(f"{type(plugin).__name__} has no {missing}")
    for name, method in vars(contract).items():
        if not name.startswith("_"):
            _, *arguments = inspect.signature(method).parameters
            require_signature(getattr(plugin, name), name, arguments)


def require_signature(
    function: Callable[..., object],
    name: str,
    arguments: Sequence[str],
    options: Mapping[str, object] = MappingProxyType({}),
) -> None:
    """Check that a plugin's function can be called the way the core calls it.

    Args:
        function: Of the plugin; one whose signature cannot be inspected passes.
        name: Its name in the contract.
        arguments: Names of its positional arguments.
        options: Its keyword arguments.

    Raises:
        ContractError: It cannot; the message has its signature and its source line.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return
    try:
        signature.bind(*arguments, **options)
    except TypeError as error:
        plain = [p.replace(annotation=p.empty) for p in signature.parameters.values()]
        takes = signature.replace(parameters=plain, return_annotation=signature.empty)
        called = ", ".join((*arguments, *(f"{key}=..." for key in options)))
        code = getattr(function, "__code__", None)
        source = f" ({code.co_filename}:{code.co_firstlineno})" if code else ""
        raise ContractError(
            f"{name}{takes} cannot be called as {name}({called}): {error}{source}"
        ) from error
