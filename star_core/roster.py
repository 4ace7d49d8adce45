"""Who is in the mission: places in the swarm, and the agents that hold them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from star_core.table import Mask


@dataclass(frozen=True, slots=True)
class Team:
    """Those who do a step.

    Attributes:
        holders: The row of the agent that holds each of the step's places.
        rows: Their rows.
        own: (N,) whether an agent is one of them.
        names: Their names, for messages.
    """

    holders: Mapping[int, int]
    rows: tuple[int, ...]
    own: Mask
    names: str

    @classmethod
    def of(cls, holders: Mapping[int, int], names: Sequence[str]) -> Team:
        """Those who hold some places, of agents with N names."""
        rows = tuple(holders.values())
        own = np.zeros(len(names), np.bool_)
        own[list(rows)] = True
        return cls(holders, rows, own, ", ".join(names[row] for row in rows))


class Roster:
    """The places of a mission and who holds them.

    A place is named by the row of the agent that it was made for; steps are for places. Another
    agent may hold it, or nobody.

    Args:
        n: How many agents there are.
        reserve: Rows of those that are in no step until they relieve another or join.

    Attributes:
        retired: Places that nobody is to hold any more.
        version: Another one after each change.
    """

    def __init__(self, n: int, reserve: Iterable[int] = ()) -> None:
        self._holder = list(range(n))
        self._vacant = set(reserve)
        self.retired = set(reserve)
        self.version = 0

    def holders(self, places: Iterable[int]) -> dict[int, int]:
        """Return the row of the agent that holds each of some places, without the vacant ones."""
        return {place: self._holder[place] for place in places if place not in self._vacant}

    def place(self, row: int) -> int | None:
        """Return the place that an agent holds; None if it is not in the mission."""
        for place, holder in enumerate(self._holder):
            if holder == row and place not in self._vacant:
                return place
        return None

    def vacancies(self) -> list[int]:
        """Places that somebody should hold and nobody does."""
        return sorted(self._vacant - self.retired)

    def vacate(self, rows: Iterable[int], *, retire: bool = False) -> None:
        """Take agents out of the mission; `retire` their places, and nobody is to fill them."""
        for row in rows:
            if (place := self.place(row)) is not None:
                self.version += 1
                self._vacant.add(place)
                if retire:
                    self.retired.add(place)

    def take(self, place: int, row: int) -> None:
        """Let an agent hold a place, whoever holds it now."""
        self.version += 1
        self._holder[place] = row
        self._vacant.discard(place)
        self.retired.discard(place)

    def left(self) -> Mask:
        """(N,) who is not in the mission."""
        out = np.ones(len(self._holder), np.bool_)
        out[list(self.holders(range(len(self._holder))).values())] = False
        return out
