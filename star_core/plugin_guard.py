"""Says whose fault it is when a plugin raises."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Iterable
from types import TracebackType

from star_core.errors import PluginError, RowCountError, StarError

log = logging.getLogger(__name__)


def close(parts: Iterable[tuple[PluginGuard, object]]) -> list[str]:
    """Close every part that can be closed, one after the other; return what went wrong."""
    wrong = []
    for blame, part in parts:
        try:
            with blame:
                getattr(part, "close", lambda: None)()
        except PluginError as error:  # the others are still to be closed
            wrong.append(str(error))
    return wrong


class PluginGuard:
    """Turns whatever is raised inside into a `PluginError` that names the plugin.

    >>> with PluginGuard("avoider 'mine' (1.0)"):
    ...     {}["gain"]
    Traceback (most recent call last):
    star_core.errors.PluginError: avoider 'mine' (1.0): KeyError: 'gain' (<...>:2) [plugin-failed]

    Args:
        whom: The plugin: kind, name and source.
        agents: Number of agents of the swarm, to find the wrong fields of a table by.
    """

    def __init__(self, whom: str, agents: int | None = None) -> None:
        self.whom = whom
        self._agents = agents

    def __enter__(self) -> None:
        pass

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if not isinstance(error, Exception | SystemExit):
            return
        log.debug("%s raised", self.whom, exc_info=error)
        if isinstance(error, RowCountError) and self._agents is not None:
            raise PluginError(f"{self.whom}: {error.among(self._agents)}") from error
        if isinstance(error, StarError):
            raise PluginError(f"{self.whom}: {error}") from error
        innermost = traceback.extract_tb(trace)[-1]
        said = " ".join(f"{type(error).__name__}: {error}".split())  # on one line
        raise PluginError(
            f"{self.whom}: {said} ({innermost.filename}:{innermost.lineno})"
        ) from error
