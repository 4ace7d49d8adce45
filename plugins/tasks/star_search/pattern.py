"""The interface of search patterns, which plugins offer by the hook ``star_search_patterns``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, runtime_checkable

from star_core.toolkit import Spec

if TYPE_CHECKING:
    from star_core import Estimate
    from star_search.search_space import SearchSpace

TOLERANCE: Final = 0.15  # m: distance from its goal at which a scout has arrived
TURN_RATE: Final = math.radians(90)  # rad/s, the planners' default


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


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchPatternSpec(Spec):
    """Announces a search pattern, which ``search: {pattern: NAME}`` chooses.

    Attributes:
        make: ``make(space)`` with the search's `SearchSpace`.
    """

    make: Callable[[SearchSpace], Pattern]
