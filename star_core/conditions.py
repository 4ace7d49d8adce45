"""Conditions that end a step: what they mean in flight, and how long they wait."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from star_core.messages.events import Event
    from star_core.messages.state import Estimate, Health

ROUNDING: Final = 1e-9  # s, rounding error of mission time


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
        targets: Names of those that were found.
        events: All events so far, the newest last.
    """

    rows: tuple[int, ...]
    begun: float
    time: float
    estimate: Estimate
    health: Health
    names: Sequence[str]
    targets: Sequence[str]
    events: Sequence[Event]


class Condition:
    """A condition; its text is a clause, as in ``until 30 s have passed``."""

    __slots__ = ()

    def holds(self, now: ConditionContext) -> bool:
        """Return whether it holds."""
        raise NotImplementedError

    def holds_from(self, others: float) -> float:
        """Return from when it holds if all others than `Elapsed` hold from `others` on, s.

        With 0 it is the time before which the condition cannot hold; with infinity the time from
        which it holds whatever happens.

        >>> some = AllOf((AnyOf((TargetFound(1), Elapsed(30))), Elapsed(5)))
        >>> some.holds_from(0.0), some.holds_from(float("inf"))
        (5.0, 30.0)
        """
        return others

    @property
    def longest_wait(self) -> float:
        """The longest `Elapsed` in it, s; 0 without one."""
        return 0.0


@dataclass(frozen=True, slots=True)
class Elapsed(Condition):
    """A time has passed since the step began, s."""

    time: float

    def holds(self, now: ConditionContext) -> bool:
        return bool(now.time - now.begun >= self.time - ROUNDING)

    def holds_from(self, others: float) -> float:
        return float(self.time)

    @property
    def longest_wait(self) -> float:
        return float(self.time)

    def __str__(self) -> str:
        return f"{self.time:g} s have passed"


@dataclass(frozen=True, slots=True)
class TargetFound(Condition):
    """A number of targets, or the target of a name, is found."""

    target: int | str

    def holds(self, now: ConditionContext) -> bool:
        if isinstance(self.target, str):
            return self.target in now.targets
        return len(now.targets) >= self.target

    def __str__(self) -> str:
        is_name = isinstance(self.target, str)
        return f"{self.target!r} is found" if is_name else f"{self.target} targets are found"


@dataclass(frozen=True, slots=True)
class Near(Condition):
    """All agents of the step are within a distance, m, of a point in the map or of an agent."""

    within: float
    point: tuple[float, float, float] | None = None
    agent: str | None = None

    def holds(self, now: ConditionContext) -> bool:
        import numpy as np

        positions = now.estimate.position
        if self.agent is None:
            point = np.array(self.point, float)
        else:
            point = positions[now.names.index(self.agent)]
        distances = np.linalg.norm(positions[list(now.rows)] - point, axis=1)
        return bool((distances <= self.within).all())

    def __str__(self) -> str:
        point = self.agent or f"[{', '.join(f'{value:g}' for value in self.point or ())}]"
        return f"all are within {self.within:g} m of {point}"


@dataclass(frozen=True, slots=True)
class BatteryBelow(Condition):
    """The battery of an agent of the step is below a voltage, V."""

    voltage: float

    def holds(self, now: ConditionContext) -> bool:
        return any(bool(now.health.battery[row] < self.voltage) for row in now.rows)

    def __str__(self) -> str:
        return f"a battery is below {self.voltage:g} V"


@dataclass(frozen=True, slots=True)
class Happened(Condition):
    """An event of a kind happened since the step began."""

    event: str

    def holds(self, now: ConditionContext) -> bool:
        for event in reversed(now.events):
            if event.time < now.begun - ROUNDING:
                return False
            if event.kind == self.event:
                return True
        return False

    def __str__(self) -> str:
        return f"{self.event!r} happens"


@dataclass(frozen=True, slots=True)
class AnyOf(Condition):
    """At least one of several conditions holds."""

    conditions: tuple[Condition, ...]

    def holds(self, now: ConditionContext) -> bool:
        return any(condition.holds(now) for condition in self.conditions)

    def holds_from(self, others: float) -> float:
        return min(condition.holds_from(others) for condition in self.conditions)

    @property
    def longest_wait(self) -> float:
        return max(condition.longest_wait for condition in self.conditions)

    def __str__(self) -> str:
        return f"({' or '.join(map(str, self.conditions))})"


@dataclass(frozen=True, slots=True)
class AllOf(Condition):
    """All of several conditions hold."""

    conditions: tuple[Condition, ...]

    def holds(self, now: ConditionContext) -> bool:
        return all(condition.holds(now) for condition in self.conditions)

    def holds_from(self, others: float) -> float:
        return max(condition.holds_from(others) for condition in self.conditions)

    @property
    def longest_wait(self) -> float:
        return max(condition.longest_wait for condition in self.conditions)

    def __str__(self) -> str:
        return f"({' and '.join(map(str, self.conditions))})"


@dataclass(frozen=True, slots=True)
class Not(Condition):
    """A condition does not hold."""

    condition: Condition

    def holds(self, now: ConditionContext) -> bool:
        return not self.condition.holds(now)

    @property
    def longest_wait(self) -> float:
        return self.condition.longest_wait

    def __str__(self) -> str:
        return f"not {self.condition}"
