"""Trajectories as scripts use them: module ``uav_trajectory`` of ``crazyflie_py``."""

from __future__ import annotations

import csv
import math
from os import PathLike
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from star_core import Array, InputError
from star_core.toolkit import polynomial

GRAVITY: Final = 9.81  # m/s²
COLUMNS: Final = 33  # of a piece: its duration, and eight coefficients for each of four axes


class Polynomial:
    """A polynomial; `p` has its coefficients, the constant first."""

    def __init__(self, p: ArrayLike) -> None:
        self.p = np.asarray(p, np.float64)

    def eval(self, t: float) -> float:
        """Return its value at `t`."""
        return float(np.polynomial.polynomial.polyval(t, self.p))

    def derivative(self) -> Polynomial:
        """Return its derivative."""
        return Polynomial(np.polynomial.polynomial.polyder(self.p))


class TrajectoryOutput:
    """State of a trajectory: `pos`, `vel`, `acc`, `omega`, `yaw`, `roll` and `pitch`."""

    def __init__(self) -> None:
        self.pos: Array = np.zeros(3)
        self.vel: Array = np.zeros(3)
        self.acc: Array = np.zeros(3)
        self.omega: Array = np.zeros(3)
        self.yaw = self.roll = self.pitch = 0.0


class Polynomial4D:
    """A piece of a trajectory, of a duration: polynomials of x, y, z and yaw."""

    def __init__(self, duration: float, px: Array, py: Array, pz: Array, pyaw: Array) -> None:
        self.duration = float(duration)
        self.px, self.py, self.pz, self.pyaw = map(Polynomial, (px, py, pz, pyaw))

    def derivative(self) -> Polynomial4D:
        """Return its derivative."""
        derived = (p.derivative().p for p in (self.px, self.py, self.pz, self.pyaw))
        return Polynomial4D(self.duration, *derived)

    def eval(self, t: float) -> TrajectoryOutput:
        """Return its state at `t`, s: attitude and rates are those of a drone that flies it."""
        state = TrajectoryOutput()
        value, first, second = polynomial(coefficients(self).T, t)
        state.pos, state.vel, state.acc = value[:3], first[:3], second[:3]
        state.yaw = float(value[3])
        third = self.derivative().derivative().derivative()
        jerk = np.array([p.eval(t) for p in (third.px, third.py, third.pz)])
        thrust = state.acc + np.array([0.0, 0.0, GRAVITY])
        most = max(float(np.linalg.norm(thrust)), 1e-9)
        up = thrust / most
        heading = np.array([math.cos(state.yaw), math.sin(state.yaw), 0.0])
        left = np.cross(up, heading)
        left /= max(float(np.linalg.norm(left)), 1e-9)
        ahead = np.cross(left, up)
        turn = (jerk - (up @ jerk) * up) / most
        state.omega = np.array([-(turn @ left), turn @ ahead, up[2] * first[3]])
        state.pitch = math.asin(min(1.0, max(-1.0, -float(ahead[2]))))
        state.roll = math.atan2(left[2], up[2])
        return state


def coefficients(piece: Any) -> Array:
    """Return (4, K) coefficients of x, y, z and yaw of a piece of any such class."""
    rows = [np.asarray(p.p, np.float64) for p in (piece.px, piece.py, piece.pz, piece.pyaw)]
    most = max(map(len, rows))
    return np.array([np.pad(row, (0, most - len(row))) for row in rows])


class Trajectory:
    """Pieces one after the other, in `polynomials`; `duration` is that of all of them, s."""

    def __init__(self) -> None:
        self.polynomials: list[Polynomial4D] = []
        self.duration = 0.0

    def n_pieces(self) -> int:
        """Return the number of pieces."""
        return len(self.polynomials)

    def loadcsv(self, filename: str | PathLike[str]) -> None:
        """Read a file with a line for each piece, after a header.

        Raises:
            InputError: A line has not the numbers of a piece.
        """
        self.polynomials = []
        with open(filename, newline="", encoding="utf-8") as file:  # noqa: PTH123 -- a script's
            for number, row in enumerate(csv.reader(file), start=1):
                values = [value for value in row if value.strip()]
                if number == 1 or not values:
                    continue
                try:
                    piece = np.array(values, np.float64)
                except ValueError as error:
                    raise InputError(
                        f"{filename}:{number}: {error}", "invalid-trajectory"
                    ) from error
                if len(piece) < COLUMNS:
                    text = f"{filename}:{number}: has {len(piece)} numbers, expected {COLUMNS}"
                    raise InputError(text, "invalid-trajectory")
                self.polynomials.append(Polynomial4D(piece[0], *piece[1:COLUMNS].reshape(4, 8)))
        self.duration = sum(piece.duration for piece in self.polynomials)

    def eval(self, t: float) -> TrajectoryOutput:
        """Return its state at `t`, s, which is not outside of it.

        Raises:
            ValueError: It is.
        """
        if not 0 <= t <= self.duration:
            raise ValueError(f"{t} s is outside of the trajectory, from 0 to {self.duration} s")
        for piece in self.polynomials:
            if t <= piece.duration:
                return piece.eval(t)
            t -= piece.duration
        return self.polynomials[-1].eval(self.polynomials[-1].duration)
