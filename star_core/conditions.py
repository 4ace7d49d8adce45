"""Conditions that end or choose steps; formats have the kinds of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from star_core.messages.events import Event
    from star_core.messages.state import Estimate, Health


@dataclass(frozen=True, slots=True)
class ConditionContext:
    """The state of a flight, for the conditions of a step.

    Attributes:
        rows: The agents of the step.
        begun: When the step began, s.
        time: Mission time, s.
        estimate: Of all agents.
        health: Of all agents.
        names: Of the agents, by row.
        targets: Finders of those that were found, by name.
        events: All events so far, the newest last.
    """

    rows: tuple[int, ...]
    begun: float
    time: float
    estimate: Estimate
    health: Health
    names: Sequence[str]
    targets: Mapping[str, str]
    events: Sequence[Event]

    def rows_of(self, names: Iterable[str]) -> list[int]:
        """Return the rows of agents."""
        return [self.names.index(name) for name in names]


class Condition:
    """A condition; its text is a clause, as in ``until 30 s have passed``."""

    __slots__ = ()

    def holds(self, now: ConditionContext) -> bool:
        """Return whether it holds."""
        raise NotImplementedError

    def holds_from(self, others: float) -> float:
        """Return from when it holds if what does not depend on time holds from `others` on, s.

        With 0 it is the time before which the condition cannot hold; with infinity the time from
        which it holds whatever happens.
        """
        return others

    @property
    def longest_wait(self) -> float:
        """The longest time in it, s; 0 without one."""
        return max((part.longest_wait for part in self.parts), default=0.0)

    @property
    def parts(self) -> tuple[Condition, ...]:
        """The conditions that it consists of."""
        return ()

    @property
    def has_elapsed(self) -> bool:
        """Whether it depends on when a step began."""
        return any(part.has_elapsed for part in self.parts)
