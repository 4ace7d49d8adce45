"""Interface of the sources of a step's goals: another process, or a planner in this one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from star_core import Estimate, Health
from star_external.planner import Answer


@dataclass(frozen=True, slots=True)
class Hold:
    """The agents should hold their positions."""


class Source(Protocol):
    """Source of goals, polled in every tick."""

    def ask(
        self, estimate: Estimate, health: Health, agents: Mapping[str, int]
    ) -> Iterable[Answer | Hold]:
        """Yield the answers since the last tick, in order; none follows `Done` or `Failed`.

        Args:
            estimate: Of this tick.
            health: Of this tick.
            agents: Row of each agent in the step, by name.
        """
        ...

    def close(self) -> None:
        """Release all resources."""
        ...
