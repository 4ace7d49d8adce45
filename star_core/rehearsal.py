"""A rehearsal of a mission: its steps and where its agents are, if nothing disturbs them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows
from star_core.messages.state import AgentPhase
from star_core.mission import Action

Outcome: TypeAlias = Literal["done", "late", "failed", "raised", "unknown"]

IN_FLIGHT: Final = (AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LANDING)
MIN_MOVE: Final = 1e-6  # m, rounding error of a position
STRAIGHT: Final = 0.9999  # cosine of a change of direction that is no corner


@dataclass(frozen=True, slots=True)
class RehearsedStep:
    """A step in a rehearsal; of one that is repeated, one round.

    Attributes:
        action: The step of the mission.
        rows: Its agents.
        begun: Mission time, s.
        ended: Mission time, s; of a step of unknown duration, when the next one begins.
        timeout: Of the step, s; None if unknown.
        outcome: ``done``; ``late`` if it would have timed out before; ``failed`` for another
            reason; ``raised`` if its task raises; ``unknown`` if its duration is not known.
        problem: Why it is late or failed, what its task raises, or why its duration is not known;
            empty if it is done or waits for what cannot be rehearsed.
        on_board: Whether its agents fly trajectories on board, without setpoints.
    """

    action: Action
    rows: tuple[int, ...]
    begun: float
    ended: float
    timeout: float | None
    outcome: Outcome
    problem: str = ""
    on_board: bool = False

    @property
    def duration(self) -> float | None:
        """Its duration, s; None if unknown."""
        return self.ended - self.begun if self.outcome in {"done", "late"} else None


@dataclass(frozen=True, slots=True, eq=False)
class Rehearsal:
    """A rehearsal of a mission by agents that nothing disturbs but each other.

    Attributes:
        steps: In the order in which they begin. Those for which no agent is left are missing.
        time: (T,) mission times at equal intervals, from 0 to the end, s.
        position: (T, N, 3) of the agents in the map, m.
        goal: (T, N, 3) of the agents in the map, m; NaN where there is none.
        yaw: (T, N) rad.
        phase: (T, N) `AgentPhase`.
    """

    steps: tuple[RehearsedStep, ...]
    time: Array
    position: Array
    goal: Array
    yaw: Array
    phase: Rows

    @property
    def duration(self) -> float | None:
        """Duration of the mission, s; None if that of a step is unknown."""
        complete = all(step.duration is not None for step in self.steps)
        return float(self.time[-1]) if complete else None

    @property
    def airborne(self) -> Mask:
        """(T, N) whether agents are in the air."""
        airborne: Mask = np.isin(self.phase, IN_FLIGHT)
        return airborne

    def index(self, time: float) -> int:
        """Return the index of the last moment until a time, s."""
        return max(0, int(self.time.searchsorted(time + MIN_MOVE, "right")) - 1)

    def during(self, step: RehearsedStep) -> slice:
        """Return the moments from the begin of a step to its end."""
        return slice(self.index(step.begun), self.index(step.ended) + 1)

    def last_goals(self, step: RehearsedStep) -> Array:
        """Return the goals at the end of a step, (N, 3) m, before the next one begins."""
        goals: Array = self.goal[max(self.index(step.ended) - 1, self.index(step.begun))]
        return goals

    def path(self, step: RehearsedStep, row: int) -> Array:
        """Return the corners of the path of an agent in a step, (K, 3) m."""
        return corners(self.position[self.during(step), row])

    def sampled(self, period: float) -> tuple[Array, Array, Array, Mask]:
        """Return the tracks, linear between moments, at times that are a period apart.

        Args:
            period: s.

        Returns:
            Times, (T,) s, from 0 to the end or later; positions, (T, N, 3) m; headings, (T, N) rad;
            whether agents are in the air, (T, N).
        """
        time = np.arange(0.0, self.time[-1] + period, period)
        before = self.time.searchsorted(time + MIN_MOVE, "right") - 1
        after = np.minimum(before + 1, len(self.time) - 1)
        length = np.where(after > before, self.time[after] - self.time[before], 1.0)
        share = np.clip((time - self.time[before]) / length, 0.0, 1.0)[:, None, None]
        position = self.position[before] + share * (self.position[after] - self.position[before])
        return time, position, self.yaw[before], self.airborne[before]


def corners(path: Array) -> Array:
    """Return the ends of a path, (K, 3) m, and the points at which its direction changes.

    >>> corners(np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0], [3, 0, 0], [3, 1, 0.0]]))
    array([[0., 0., 0.],
           [3., 0., 0.],
           [3., 1., 0.]])
    """
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1) > MIN_MOVE
    path = path[np.concatenate([[True], moved])]
    way = np.diff(path, axis=0)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    turns = (way[:-1] * way[1:]).sum(axis=1) < STRAIGHT
    kept: Array = path[np.concatenate([[True], turns, [True]])] if len(way) else path
    return kept
