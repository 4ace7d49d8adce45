"""Where the goals of a step come from: another process, or a planner in this one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from star_core import Estimate, Health
from star_external.planner import Answer


@dataclass(frozen=True, slots=True)
class Hold:
    """The agents are to hold the places where they are."""


class Source(Protocol):
    """What a step asks in every tick."""

    def ask(
        self, estimate: Estimate, health: Health, agents: Mapping[str, int]
    ) -> Iterable[Answer | Hold]:
        """Yield what is wanted since the last tick, in order; nothing comes after an end.

        Args:
            estimate: Of this tick.
            health: Of this tick.
            agents: The row of each agent in the step, by its name.
        """
        ...

    def close(self) -> None:
        """Let go of what it holds."""
        ...
