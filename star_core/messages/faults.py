"""Faults that are injected into a flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of one component of some agents.

    Attributes:
        component: What fails, such as ``motor`` or ``link``.
        mode: One of PX4's words: off, stuck, garbage, wrong, slow, delayed or intermittent.
        at: Mission time at which it begins, s.
        until: By row of the agents that have it: when it ends, s; infinite at the end of the
            flight.
        values: Its other properties by name.
        number: Index among the faults of the flight, for random numbers.
    """

    component: str
    mode: str
    at: float
    until: Mapping[int, float]
    values: Mapping[str, Any]
    number: int = 0

    def rows(self, time: float) -> tuple[int, ...]:
        """Return the rows of the agents that have it at a mission time, s."""
        begun = time >= self.at
        return tuple(row for row, end in self.until.items() if begun and time < end)
