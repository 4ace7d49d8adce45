"""The kinds of conditions in mission files: what they mean in flight, and how long they wait."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Final

from star_core.formats import Condition, ConditionContext

ROUNDING: Final = 1e-9  # s, rounding error of mission time


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

    @property
    def has_elapsed(self) -> bool:
        return True

    def __str__(self) -> str:
        return f"{self.time:g} s have passed"


@dataclass(frozen=True, slots=True)
class TimeReached(Condition):
    """A mission time is reached, s."""

    time: float

    def holds(self, now: ConditionContext) -> bool:
        return bool(now.time >= self.time - ROUNDING)

    def holds_from(self, others: float) -> float:
        return min(others, self.time)  # of a step that begins at the start of the mission, or later

    @property
    def longest_wait(self) -> float:
        return float(self.time)

    def __str__(self) -> str:
        return f"it is {self.time:g} s after the start"


@dataclass(frozen=True, slots=True)
class NamedAgents:
    """The agents that a condition names.

    Attributes:
        names: Of the agents.
        every: Whether the condition must hold for each of them, and not only for one.
    """

    names: tuple[str, ...]
    every: bool

    def hold(self, test: Callable[[tuple[str, ...]], bool]) -> bool:
        """Return whether a test of some agents, of which one suffices, succeeds."""
        groups = tuple((name,) for name in self.names) if self.every else (self.names,)
        return all(map(test, groups))

    def __str__(self) -> str:
        which = "" if len(self.names) == 1 else "each of " if self.every else "one of "
        return f"{which}{', '.join(self.names)}"


@dataclass(frozen=True, slots=True)
class TargetFound(Condition):
    """A number of targets, or the target of a name, is found; by some agents if they are named."""

    target: int | str
    agents: NamedAgents | None = None

    def holds(self, now: ConditionContext) -> bool:
        if self.agents is None:
            return self._is_met(now.targets)
        finders = now.targets.items()
        return self.agents.hold(
            lambda names: self._is_met([target for target, by in finders if by in names])
        )

    def _is_met(self, targets: Collection[str]) -> bool:
        if isinstance(self.target, str):
            return self.target in targets
        return len(targets) >= self.target

    def __str__(self) -> str:
        is_name = isinstance(self.target, str)
        text = f"{self.target!r} is found" if is_name else f"{self.target} targets are found"
        return text if self.agents is None else f"{text} by {self.agents}"


@dataclass(frozen=True, slots=True)
class Near(Condition):
    """All agents of the step, or those named, are within a distance, m, of a point or an agent."""

    within: float
    point: tuple[float, float, float] | None = None
    agent: str | None = None
    agents: NamedAgents | None = None

    def holds(self, now: ConditionContext) -> bool:
        import numpy as np

        positions = now.estimate.position
        if self.agent is None:
            point = np.array(self.point, float)
        else:
            point = positions[now.names.index(self.agent)]
        if self.agents is None:
            distances = np.linalg.norm(positions[list(now.rows)] - point, axis=1)
            return bool((distances <= self.within).all())
        distances = np.linalg.norm(positions - point, axis=1)
        return self.agents.hold(
            lambda names: bool((distances[now.rows_of(names)] <= self.within).any())
        )

    def __str__(self) -> str:
        point = self.agent or f"[{', '.join(f'{value:g}' for value in self.point or ())}]"
        subject = "all are" if self.agents is None else f"{self.agents} is"
        return f"{subject} within {self.within:g} m of {point}"


@dataclass(frozen=True, slots=True)
class BatteryBelow(Condition):
    """The battery of an agent of the step, or of those named, is below a voltage, V."""

    voltage: float
    agents: NamedAgents | None = None

    def holds(self, now: ConditionContext) -> bool:
        if self.agents is None:
            return self._is_low(now, now.rows)
        return self.agents.hold(lambda names: self._is_low(now, now.rows_of(names)))

    def _is_low(self, now: ConditionContext, rows: Iterable[int]) -> bool:
        return any(bool(now.health.battery[row] < self.voltage) for row in rows)

    def __str__(self) -> str:
        battery = "a battery" if self.agents is None else f"the battery of {self.agents}"
        return f"{battery} is below {self.voltage:g} V"


@dataclass(frozen=True, slots=True)
class Happened(Condition):
    """An event of a kind happened since the step began; to some agents if they are named."""

    event: str
    agents: NamedAgents | None = None

    def holds(self, now: ConditionContext) -> bool:
        if self.agents is None:
            return self._happened(now, ())
        return self.agents.hold(lambda names: self._happened(now, names))

    def _happened(self, now: ConditionContext, names: Collection[str]) -> bool:
        for event in reversed(now.events):
            if event.time < now.begun - ROUNDING:
                return False
            if event.kind == self.event and (not names or event.is_about(names)):
                return True
        return False

    def __str__(self) -> str:
        return f"{self.event!r} happens" + ("" if self.agents is None else f" to {self.agents}")


@dataclass(frozen=True, slots=True)
class _Several(Condition):
    conditions: tuple[Condition, ...]

    @property
    def parts(self) -> tuple[Condition, ...]:
        return self.conditions


@dataclass(frozen=True, slots=True)
class AnyOf(_Several):
    """At least one of several conditions holds."""

    def holds(self, now: ConditionContext) -> bool:
        return any(condition.holds(now) for condition in self.conditions)

    def holds_from(self, others: float) -> float:
        return min(condition.holds_from(others) for condition in self.conditions)

    def __str__(self) -> str:
        return f"({' or '.join(map(str, self.conditions))})"


@dataclass(frozen=True, slots=True)
class AllOf(_Several):
    """All of several conditions hold.

    >>> some = AllOf((AnyOf((TargetFound(1), Elapsed(30))), Elapsed(5)))
    >>> some.holds_from(0.0), some.holds_from(float("inf"))
    (5.0, 30.0)
    """

    def holds(self, now: ConditionContext) -> bool:
        return all(condition.holds(now) for condition in self.conditions)

    def holds_from(self, others: float) -> float:
        return max((condition.holds_from(others) for condition in self.conditions), default=0.0)

    def __str__(self) -> str:
        return f"({' and '.join(map(str, self.conditions))})"


@dataclass(frozen=True, slots=True)
class Not(Condition):
    """A condition does not hold."""

    condition: Condition

    def holds(self, now: ConditionContext) -> bool:
        return not self.condition.holds(now)

    @property
    def parts(self) -> tuple[Condition, ...]:
        return (self.condition,)

    def __str__(self) -> str:
        return f"not {self.condition}"
