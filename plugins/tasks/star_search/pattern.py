"""Search patterns: their interface, and those that are installed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, runtime_checkable

from star_core import PluginError
from star_core.toolkit import permitted_entry_points

if TYPE_CHECKING:
    from star_core import Estimate
    from star_search.search_space import SearchSpace

TOLERANCE: Final = 0.15  # m: distance from its goal at which a scout has arrived
TURN_RATE: Final = math.radians(90)  # rad/s, the planners' default

GROUP: Final = "star.search_patterns"
"""Entry points of patterns: each names what is called with the `SearchSpace` and returns a
`Pattern`."""

OWN: Final = (
    EntryPoint("frontier", "star_search.frontier:Frontier", GROUP),
    EntryPoint("sweep", "star_search.sweep:Sweep", GROUP),
)


class Waypoint(NamedTuple):
    """Where a scout should go now, at the height of the search.

    Attributes:
        x: Map frame, m.
        y: Map frame, m.
        yaw: Heading to turn to at once, rad, anticlockwise from the map's x axis.
    """

    x: float
    y: float
    yaw: float


@runtime_checkable
class Pattern(Protocol):
    """A way to cover a `star_search.search_space.SearchSpace`, with which it is created."""

    def begin(self, estimate: Estimate, rows: tuple[int, ...]) -> float:
        """Plan, and return the longest time that a scout takes if nothing delays it, s.

        Args:
            estimate: Positions of all agents.
            rows: The scouts, all of them located.
        """
        ...

    def waypoints(self, estimate: Estimate, rows: tuple[int, ...]) -> Mapping[int, Waypoint]:
        """Return where each scout should go; a scout with nothing more to see has no entry.

        What the scouts see is in the coverage map already.

        Args:
            estimate: Positions of all agents.
            rows: The scouts that search now, all of them located. The share of a scout that is no
                longer among them goes to the others; it may come back. A new scout takes the share
                of another one, or a part of all.
        """
        ...


@cache
def _installed() -> dict[str, EntryPoint]:
    found = {point.name: point for point in (*permitted_entry_points(GROUP), *OWN)}
    return dict(sorted(found.items()))


def pattern_names() -> tuple[str, ...]:
    """Return the names of all patterns."""
    return tuple(_installed())


def make_pattern(name: str, space: SearchSpace) -> Pattern:
    """Return a pattern for a search space.

    Raises:
        PluginError: It cannot be imported, or does not keep the contract.
    """
    point = _installed()[name]
    try:
        pattern = point.load()(space)
    except (ImportError, AttributeError) as error:
        raise PluginError(f"search pattern {name!r} ({point.value}): {error}") from error
    if not isinstance(pattern, Pattern):
        raise PluginError(
            f"search pattern {name!r} ({point.value}) made {type(pattern).__name__}, "
            "expected begin(estimate, rows) and waypoints(estimate, rows)",
            code="contract-broken",
        )
    return pattern
