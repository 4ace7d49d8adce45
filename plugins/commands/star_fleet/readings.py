"""Values of all log variables at one time, computed on demand."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from star_core import Array, Rows
from star_sim.airframe import DRAG_XY, DRAG_Z, GRAVITY, MASS
from star_sim.drone import Drones
from star_sim.fusion import Fusion
from star_sim.report import report

U8, U16, U32, I8, I16, I32, FLOAT, HALF = 1, 2, 3, 4, 5, 6, 7, 8  # types
FORMAT: Final = {U8: "B", U16: "H", U32: "I", I8: "b", I16: "h", I32: "i", FLOAT: "f", HALF: "e"}
WHOLE: Final = {
    U8: (0, 255),
    U16: (0, 65535),
    U32: (0, 0xFFFFFFFF),
    I8: (-128, 127),
    I16: (-32768, 32767),
    I32: (-0x80000000, 0x7FFFFFFF),
}


@dataclass(slots=True)
class Source:
    """What values are taken from.

    Attributes:
        drones: (N,) records.
        sample: (N, 8) as `star_sim.estimator.believe` streams it.
        info: (N,) bits of the supervisors.
        now: s.
        uncertainty: The filter's covariances.
    """

    drones: Drones
    sample: Array
    info: Rows
    now: float
    uncertainty: Fusion


class Readings:
    """The values of all vehicles at one time, worked out when one is asked for.

    Args:
        source: What they are taken from.
        variables: All there are.
    """

    def __init__(self, source: Source, variables: Sequence[Variable]) -> None:
        self.source = source
        self._variables = variables
        self._columns: dict[int, list[Any]] = {}

    def column(self, number: int) -> list[Any]:
        """Return the values of a variable, one for each vehicle, as its type can hold them."""
        found = self._columns.get(number)
        if found is None:
            variable = self._variables[number]
            found = self._columns[number] = held(variable.read(self), variable.code)
        return found

    @cached_property
    def attitude(self) -> Array:
        """(N, 4) quaternions x, y, z, w from the body to the odometry frame, as believed."""
        n = len(self.source.drones)
        attitude = np.empty((n, 4))
        report(self.source.drones, self.source.now, attitude, np.empty(n, np.int64))
        return attitude

    @cached_property
    def covariance(self) -> Array:
        """(N, 3, 3) of the estimates of x, y and heading, m and rad."""
        return self.source.uncertainty.covariance(self.source.drones, self.source.now)

    @cached_property
    def body_velocity(self) -> Array:
        """(N, 3) velocity along the body's axes, as believed, m/s."""
        return into_body(self.attitude, self.source.drones["believed_velocity"])

    @cached_property
    def force(self) -> Array:
        """(N, 3) what an accelerometer shows, g."""
        drones = self.source.drones
        felt = -np.array([DRAG_XY, DRAG_XY, DRAG_Z]) * into_body(
            drones["attitude"], drones["velocity"]
        )
        felt[:, 2] += drones["thrust"].sum(axis=1)
        resting = (drones["position"][:, 2] <= 0) & (drones["velocity"][:, 2] == 0)
        floor = np.zeros((len(drones), 3))
        floor[:, 2] = MASS * GRAVITY - drones["thrust"].sum(axis=1)
        pressed = np.maximum(0.0, floor) * resting[:, None]
        return (felt + into_body(drones["attitude"], pressed)) / (MASS * GRAVITY)


def held(values: Any, code: int) -> list[Any]:
    """Return values as a type of variable can hold them: cut to whole numbers, and to its range.

    >>> held(np.array([1.9, -3.0]), U8)
    [1, 0]
    """
    if code in WHOLE:
        low, high = WHOLE[code]
        given = np.asarray(values, float)
        whole = np.where(np.isnan(given), 0.0, given)  # much faster than numpy's own, which counts
        return list(np.minimum(np.maximum(whole, low), high).astype(np.int64).tolist())
    return list(np.asarray(values, float).tolist())


def held_one(value: float, code: int) -> float:
    """Return one value as a type of variable can hold it; see `held`.

    >>> held_one(300.7, U8), held_one(math.nan, I16), held_one(0.5, HALF)
    (255, 0, 0.5)
    """
    if code not in WHOLE:
        return float(value)
    low, high = WHOLE[code]
    return 0 if math.isnan(value) else int(min(max(value, low), high))


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable.

    Attributes:
        name: ``group.name``.
        code: Its type.
        read: Returns its (N,) values.
    """

    name: str
    code: int
    read: Callable[[Readings], Any]


def into_body(attitude: Array, vectors: Array) -> Array:
    """Turn (N, 3) vectors into the bodies' frames."""
    x, y, z, w = -attitude[:, 0], -attitude[:, 1], -attitude[:, 2], attitude[:, 3]
    axis = np.stack([x, y, z], axis=1)
    twice = 2 * np.cross(axis, vectors)
    return np.asarray(vectors + w[:, None] * twice + np.cross(axis, twice))
