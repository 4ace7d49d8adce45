"""The patterns that are installed, by name: those of this package, and other people's."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Final

from star_core import PluginError

if TYPE_CHECKING:
    from star_search.field import Field
    from star_search.pattern import Pattern

GROUP: Final = "star.search_patterns"
"""Entry points of patterns: each names what is called with the `Field` and returns a `Pattern`."""

OWN: Final = (
    EntryPoint("frontier", "star_search.frontier:Frontier", GROUP),
    EntryPoint("sweep", "star_search.sweep:Sweep", GROUP),
)


@cache
def _installed() -> dict[str, EntryPoint]:
    found = {point.name: point for point in entry_points(group=GROUP)}
    return dict(sorted((found | {point.name: point for point in OWN}).items()))


def names() -> tuple[str, ...]:
    """Return the name of every pattern."""
    return tuple(_installed())


def made(name: str, field: Field) -> Pattern:
    """Return a pattern for a field.

    Raises:
        PluginError: It cannot be imported, or keeps not to the contract.
    """
    from star_search.pattern import Pattern

    point = _installed()[name]
    try:
        pattern = point.load()(field)
    except (ImportError, AttributeError) as error:
        raise PluginError(f"search pattern {name!r} ({point.value}): {error}") from error
    if not isinstance(pattern, Pattern):
        raise PluginError(
            f"search pattern {name!r} ({point.value}) made {type(pattern).__name__}, "
            "expected begin(estimate, rows) and lead(estimate, rows)"
        )
    return pattern
