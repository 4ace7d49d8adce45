"""Piecewise trajectories: pieces, and the queue of pieces that drones have yet to fly."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Mask, Rows, Trajectory
from star_core.toolkit import polynomial, transformed
from star_sim.airframe import NEVER, STEP, STEPS_PER_CYCLE
from star_sim.drone import TRAJECTORY, Drones, Record

ORDER: Final = 7
HOVER_TIME: Final = 3.0  # s after a climb or a trajectory; then the drone comes down
DESCENT_SPEED: Final = 0.3  # m/s
DESCENT_MARGIN: Final = 0.2  # m below the floor, at which a descent ends


@dataclass(frozen=True, slots=True)
class Piece:
    """One stretch of a trajectory, as the simulated commander follows it.

    Attributes:
        coefficients: (4, 8) of x, y, z, m, and yaw, rad, over the fraction of time passed; constant
            first.
        duration: s.
    """

    coefficients: Array
    duration: float

    @classmethod
    def over_time(cls, coefficients: Array, duration: float) -> Piece:
        """Return the piece of (4, 8) coefficients over the time in seconds.

        >>> Piece.over_time(np.ones((4, 8)), 2.0).coefficients[0]
        array([  1.,   2.,   4.,   8.,  16.,  32.,  64., 128.])
        """
        return cls(coefficients * duration ** np.arange(ORDER + 1), duration)

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Return value, first and second derivative (each (4,)) `time` seconds after its start."""
        u = min(max(time / self.duration, 0.0), 1.0)
        value, slope, curve = polynomial(self.coefficients.T, u)
        return value, slope / self.duration, curve / self.duration**2

    def slower(self, factor: float) -> Piece:
        """Return the piece stretched to `factor` times its duration."""
        return replace(self, duration=self.duration * factor)

    def backwards(self) -> Piece:
        """Return the piece reversed in time."""
        turned = np.zeros_like(self.coefficients)
        for k in range(ORDER + 1):  # (1 - u)^k
            for j in range(k + 1):
                turned[:, j] += self.coefficients[:, k] * math.comb(k, j) * (-1) ** j
        return replace(self, coefficients=turned)

    def moved(self, shift: Array, turn: float = 0.0) -> Piece:
        """Return the piece rotated about the origin by `turn`, rad, then shifted by (3,) m."""
        return replace(self, coefficients=transformed(self.coefficients, turn, shift))


def pieces_of(trajectory: Trajectory) -> tuple[Piece, ...]:
    """Return the pieces of a trajectory, in its own frame and time."""
    return tuple(map(Piece.over_time, trajectory.coefficients, trajectory.duration.tolist()))


def descent(pose: Array, depth: float) -> Piece:
    """Return the straight descent from a pose, (4,) m and rad, by `depth`, m."""
    coefficients = np.zeros((4, ORDER + 1))
    coefficients[:, 0] = pose
    coefficients[2, 1] = -depth
    return Piece(coefficients, depth / DESCENT_SPEED)


def enter(drone: Record, piece: Piece, began: float, *, lands: bool = False) -> None:
    """Make a drone follow a piece that began at `began`, s; its motors may stop at its end."""
    drone["trajectory"] = piece.coefficients
    drone["trajectory_start"] = began
    drone["trajectory_duration"] = piece.duration
    drone["landing"] = lands
    drone["finished"] = 0
    drone["mode"] = TRAJECTORY


class _Waiting(NamedTuple):
    """A piece that has yet to begin: when, s, and whether it follows what was commanded."""

    begins: float
    piece: Piece
    comes_down: bool = False


class Queue:
    """Pieces that drones have yet to fly; the kernel holds only the current piece of each drone.

    The remaining pieces of a drone are dropped if it flies something else when the next is due.

    Attributes:
        next_step: Number of the step of 2 ms at which a piece is due next, or `NEVER`.
    """

    def __init__(self, drones: Drones) -> None:
        self._drones = drones
        self._waiting: dict[int, deque[_Waiting]] = {}
        self._down = np.zeros(len(drones), np.bool_)
        self.next_step = NEVER

    def fly(self, row: int, pieces: Sequence[Piece], now: float) -> None:
        """Make a drone fly pieces in sequence from mission time `now`, s, on."""
        begins = accumulate((piece.duration for piece in pieces[:-1]), initial=now)
        waiting = deque(map(_Waiting, begins, pieces))
        waiting.popleft()
        self._down[row] = False
        enter(self._drones[row], pieces[0], now)
        self._waiting[row] = waiting
        if waiting:
            self.next_step = min(self.next_step, _step(waiting[0].begins))

    def come_down(self, row: int, pose: Array, over: float, depth: float) -> float:
        """Let a drone descend `HOVER_TIME` after its last piece, if nothing takes over before.

        Args:
            row: Of the drone.
            pose: (4,) at the end of its last piece, m and rad.
            over: When that ends, s.
            depth: Height of the pose above the floor, at most, m.

        Returns:
            When the descent ends, s.
        """
        cycle = STEP * STEPS_PER_CYCLE  # a kernel is not to be called in the middle of one
        begins = math.ceil((over + HOVER_TIME) / cycle - 1e-6) * cycle
        waiting = self._waiting.setdefault(row, deque())
        piece = descent(pose, depth + DESCENT_MARGIN)
        waiting.append(_Waiting(begins, piece, comes_down=True))
        self.next_step = min(self.next_step, _step(waiting[0].begins))
        return begins + piece.duration

    def come_down_from_climb(self, row: int, now: float) -> float:
        """Let a drone descend `HOVER_TIME` after the climb that it began at `now`, s.

        Returns:
            When the descent ends, s.
        """
        drone = self._drones[row]
        climb = Piece(drone["trajectory"], float(drone["trajectory_duration"]))
        start, top = climb.at(0.0)[0], climb.at(math.inf)[0]
        return self.come_down(row, top, now + climb.duration, max(top[2] - start[2], 0.0))

    def drop(self, rows: Rows) -> None:
        """Drop the remaining pieces of some drones."""
        self._down[rows] = False
        if self._waiting:
            for row in rows.tolist():
                self._waiting.pop(row, None)
            self._look_ahead()

    def advance(self, step: int) -> None:
        """Start the pieces that are due at a step."""
        for row, waiting in self._waiting.items():
            if self._drones["mode"][row] != TRAJECTORY:
                waiting.clear()
            while waiting and _step(waiting[0].begins) <= step:
                began, piece, self._down[row] = waiting.popleft()
                enter(self._drones[row], piece, began)
        self._look_ahead()

    def coming_down(self) -> Mask:
        """Return which drones descend, or have descended, after what was commanded: (N,)."""
        self._down &= self._drones["mode"] == TRAJECTORY
        return self._down

    def _look_ahead(self) -> None:
        self._waiting = {row: waiting for row, waiting in self._waiting.items() if waiting}
        steps = (_step(waiting[0].begins) for waiting in self._waiting.values())
        self.next_step = min(steps, default=NEVER)


def _step(time: float) -> int:
    """Return the number of the first step that is not before a time, s."""
    return math.ceil(time / STEP - 1e-6)
