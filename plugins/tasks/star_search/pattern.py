"""What a search pattern is: it says where each scout should go next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol, runtime_checkable

from star_core import Estimate


class Aim(NamedTuple):
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
    """A way to cover a `star_search.field.Field`, which it is made with."""

    def begin(self, estimate: Estimate, rows: tuple[int, ...]) -> float:
        """Plan, and return the longest time that a scout should take if nothing is in the way, s.

        Args:
            estimate: Positions of all agents.
            rows: The scouts, all of them located.
        """
        ...

    def lead(self, estimate: Estimate, rows: tuple[int, ...]) -> Mapping[int, Aim]:
        """Return where each scout should go; one for whom nothing is left has no entry.

        What the scouts see is on the field's chart already.

        Args:
            estimate: Positions of all agents.
            rows: The scouts that search now, all of them located. The share of one that is not
                among them any more goes to the others; it may come back. One that was never
                among them takes another's place, or a part of all.
        """
        ...
