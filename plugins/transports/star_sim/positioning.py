"""A simulated positioning system, such as motion capture, base stations or anchors."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from star_core import Array, Mask, PoseFixes, Rows
from star_core.toolkit import Fault, quaternion_from_euler, yaw_from_quaternion
from star_sim.airframe import STEP
from star_sim.drone import Drones
from star_sim.sensors import streams

_STREAM: Final = 7337
_STREAM_OF_SYSTEM: Final = 7339  # of delays, of the order of markers, and of faults
UNLABELLED: Final = -1
BLOCK: Final = 64  # measurements whose random numbers are drawn at once
AXES: Final = 3
DRAWS: Final = 5  # normal numbers for each measurement: position, heading, dropout


class Positioning:
    """Measures the poses of all drones at a constant rate; measurements arrive late or not at all.

    The error of a position along each axis is a first-order Gauss-Markov process, in its steady
    state from the start; those of two drones are independent. Dropouts of a drone begin at random,
    as a Poisson process. Each drone has its own random stream.

    Args:
        seed: Of the flight.
        agents: Number of drones.
        std: Standard deviation along each axis, m.
        yaw_std_deg: Standard deviation of headings, degrees; None measures none.
        correlation_time: Time constant of the error of positions, s.
        rate: Measurements of each drone, 1/s.
        latency: Time until a measurement arrives, s.
        dropout_rate: Mean number of dropouts, 1/s.
        dropout_time: Duration of a dropout, s.
        jitter: Standard deviation of a further delay, s: the absolute value of a normal number.
        timestamps: Whether measurements carry their times.
        markers: Whether they are positions without a name.

    Attributes:
        faults: That are simulated.
        next_step: Number of the step of 2 ms before which the next measurement is taken.
    """

    def __init__(  # noqa: PLR0913 -- one for each option
        self,
        seed: int,
        agents: int,
        *,
        std: float,
        yaw_std_deg: float | None,
        correlation_time: float,
        rate: float,
        latency: float,
        dropout_rate: float,
        dropout_time: float,
        jitter: float = 0.0,
        timestamps: bool = True,
        markers: bool = False,
    ) -> None:
        self._streams = streams(seed, _STREAM, agents)
        self._std, self._correlation_time = std, correlation_time
        self._yaw_std = None if yaw_std_deg is None else math.radians(yaw_std_deg)
        self._period, self._latency = 1 / rate, latency
        self._dropout_chance = -math.expm1(-dropout_rate / rate)
        self._dropout_time = dropout_time
        self._keep = math.exp(-self._period / correlation_time) if correlation_time > 0 else 0.0
        self._error = np.zeros((agents, AXES))
        self._dropped_until = np.full(agents, -np.inf)  # s
        self._draws = np.zeros((agents, BLOCK, DRAWS))
        self._taken = 0  # measurements of each drone so far
        self._sent: deque[tuple[float, PoseFixes]] = deque()  # time of arrival, s
        self._random = np.random.default_rng([seed, _STREAM_OF_SYSTEM])
        self._jitter, self._timestamps, self._markers = jitter, timestamps, markers
        self._arrives = 0.0  # s, when the last measurement does
        self.faults: Sequence[Fault] = ()
        self.next_step = 0

    def take(self, drones: Drones, step: int) -> None:
        """Measure the drones if a measurement is due before a step."""
        if step < self.next_step:
            return
        k = self._taken % BLOCK
        if k == 0:
            for row, stream in enumerate(self._streams):
                self._draws[row, :, :4] = stream.standard_normal((BLOCK, 4))
                self._draws[row, :, 4] = stream.random(BLOCK)
        keep = self._keep if self._taken else 0.0
        draws = self._draws[:, k]
        fresh = self._std * math.sqrt(1 - keep * keep) * draws[:, :AXES]
        self._error = keep * self._error + fresh
        self._taken += 1
        self.next_step = math.ceil(self._taken * self._period / STEP - 1e-6)
        now = step * STEP
        begins = draws[:, 4] < self._dropout_chance
        self._dropped_until = np.where(
            begins & (self._dropped_until <= now), now + self._dropout_time, self._dropped_until
        )
        offset, lost = failing(self.faults, len(self._error), now, self._random)
        rows: Rows = np.flatnonzero((self._dropped_until <= now) & ~lost)
        if self._markers:
            rows = self._random.permutation(rows)
        if not len(rows):
            return
        column = np.ones(len(rows))
        attitude, yaw_std = np.full((len(rows), 4), np.nan), 0.0
        if self._yaw_std is not None and not self._markers:
            yaw_std = self._yaw_std
            yaw = yaw_from_quaternion(drones["attitude"][rows]) + yaw_std * draws[rows, 3]
            attitude = quaternion_from_euler(0 * yaw, 0 * yaw, yaw)
        late = self._latency
        if self._jitter:
            late += abs(self._jitter * self._random.standard_normal())
        self._arrives = max(self._arrives, now + late)
        fixes = PoseFixes(
            agent=self._labels(rows, now),
            taken=(now if self._timestamps else np.nan) * column,
            arrived=self._arrives * column,
            position=drones["position"][rows] + self._error[rows] + offset[rows],
            attitude=attitude,
            position_std=self._std * column,
            attitude_std=yaw_std * column,
            correlation_time=self._correlation_time * column,
        )
        self._sent.append((self._arrives, fixes))

    def _labels(self, rows: Rows, now: float) -> Rows:
        """Return the rows whose names the measurements have."""
        if self._markers:
            return np.full(len(rows), UNLABELLED)
        labels = np.arange(len(self._error))
        for fault in self.faults:
            if fault.mode == "wrong" and fault.values["swap"] and (failing := fault.rows(now)):
                labels[list(failing)] = np.roll(labels[list(failing)], -1)
        named: Rows = labels[rows]
        return named

    def arrived(self, now: float) -> PoseFixes:
        """Return the measurements that arrived until `now`, s, since the last call."""
        tables = []
        while self._sent and self._sent[0][0] <= now + STEP / 2:
            tables.append(self._sent.popleft()[1])
        return PoseFixes.merged(tables)


def failing(
    faults: Sequence[Fault], agents: int, now: float, random: np.random.Generator
) -> tuple[Array, Mask]:
    """Return by how much faults displace positions, (N, 3) m, and which they lose, (N,)."""
    offset, lost = np.zeros((agents, AXES)), np.zeros(agents, np.bool_)
    for fault in faults:
        rows: Rows = np.array(list(fault.rows(now)), np.int64)
        if fault.mode == "off":
            lost[rows] = True
        elif fault.mode == "intermittent":
            lost[rows] |= random.random(len(rows)) < fault.values["loss"]
        elif not fault.values["swap"]:
            offset[rows] += fault.values["offset"]
    return offset, lost
