"""Says whose fault it is when a plugin raises."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Iterable
from types import TracebackType

from star_core.errors import PluginError, StarError

log = logging.getLogger(__name__)


def close(parts: Iterable[tuple[Blame, object]]) -> list[str]:
    """Close every part that can be closed, one after the other; return what went wrong."""
    wrong = []
    for blame, part in parts:
        try:
            with blame:
                getattr(part, "close", lambda: None)()
        except PluginError as error:  # the others are still to be closed
            wrong.append(str(error))
    return wrong


class Blame:
    """Turns whatever is raised inside into a `PluginError` that names the plugin.

    >>> with Blame("avoider 'mine' (my-dist 1.0:mine)"):
    ...     {}["gain"]
    Traceback (most recent call last):
    star_core.errors.PluginError: avoider 'mine' (my-dist 1.0:mine): KeyError: 'gain' (<...>:2)

    Args:
        whom: The plugin: kind, name and source.
    """

    def __init__(self, whom: str) -> None:
        self.whom = whom

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
        if isinstance(error, StarError):
            raise PluginError(f"{self.whom}: {error}") from error
        innermost = traceback.extract_tb(trace)[-1]
        said = " ".join(f"{type(error).__name__}: {error}".split())  # on one line
        raise PluginError(
            f"{self.whom}: {said} ({innermost.filename}:{innermost.lineno})"
        ) from error
