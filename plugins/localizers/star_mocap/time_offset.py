"""The latency of measurements that carry no time, by correlating the speeds of two streams."""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Odometry, PoseFixes, Rows

FIRST: Final = 0.03  # s, before it is estimated: a frame or two, and the network
FIRST_STD: Final = 0.03  # s
MAX_LATENCY: Final = 0.25  # s
STEP: Final = 0.005  # s, of the grid on which speeds are compared
SPAN: Final = 0.3  # s, over which speeds are differences of heights
WINDOW: Final = 10.0  # s of flight that are compared
PERIOD: Final = 0.5  # s between two estimates
MAX_STD: Final = 4e-3  # s of an estimate that is used
MODEL_STD: Final = 1.5e-3  # s, by which the clocks of the reports differ from each other
MIN_TIME: Final = 1.5  # s of both streams
EARLIEST: Final = -0.05  # s, of the search: a peak at 0 needs its neighbours
MAX_SPEED: Final = 3.0  # m/s; more is an edge that the ranger sees
MAX_GAP: Final = 0.15  # s between two samples, above which speeds between them are unknown
AGENTS: Final = 8  # that are compared, those with the most motion


class Latency(NamedTuple):
    """An estimate; by default that before anything is measured.

    Attributes:
        seconds: From the measurement to its arrival, s.
        std: Standard deviation, s.
    """

    seconds: float = FIRST
    std: float = FIRST_STD


class TimeOffset:
    """Estimates the latency that all measurements of a system have in common.

    The vertical speed of an agent by its odometry at t is that by its measurements at t + latency.
    Both are differences of heights over the same span, so neither lags; horizontal speeds of
    on-board estimators lag, by some 20 ms in the simulator. The latency with the greatest
    correlation over the last `WINDOW` counts, by the vertex of a parabola through three steps. Its
    variance is that of least squares: the variance of what one stream does not explain of the
    other, over the squares of the slopes, with `SPAN` as the time in which errors are independent.

    Attributes:
        latency: The best estimate so far.
    """

    def __init__(self, agents: int) -> None:
        self.latency = Latency()
        self._reported: list[deque[tuple[float, float]]] = [deque() for _ in range(agents)]
        self._measured: list[deque[tuple[float, float]]] = [deque() for _ in range(agents)]
        self._due = 0.0  # s

    def add(self, now: float, odometry: Odometry, fixes: PoseFixes) -> None:
        """Add the samples of a tick at mission time `now`, s, and estimate if it is time.

        Args:
            now: s.
            odometry: New samples.
            fixes: New measurements, with the agents that they are of, in the order of arrival.
        """
        _append(self._reported, odometry.agent, odometry.time, odometry.height)
        _append(self._measured, fixes.agent, fixes.arrived, fixes.position[:, 2])
        if now >= self._due:
            self._due = now + PERIOD
            estimate = self.estimate()
            if estimate is not None and estimate.std <= max(MAX_STD, self.latency.std):
                self.latency = Latency(estimate.seconds, math.hypot(estimate.std, MODEL_STD))

    def estimate(self) -> Latency | None:
        """Return an estimate by the last `WINDOW`; None without enough motion."""
        streams = [
            pair
            for reported, measured in zip(self._reported, self._measured, strict=True)
            if (pair := _speeds(np.array(measured), np.array(reported))) is not None
        ]
        streams.sort(key=lambda pair: -float(np.nanvar(pair[0])))
        return latency_of(streams[:AGENTS])


def latency_of(streams: list[tuple[Array, Array]]) -> Latency | None:
    """Return the latency between pairs of speeds on a grid of `STEP`; None if it is ambiguous.

    Args:
        streams: Of each agent (T,) speeds by its measurements and by its odometry, at the times of
            both, m/s; NaN where unknown.
    """
    lags = np.arange(round(EARLIEST / STEP), round(MAX_LATENCY / STEP) + 2)
    score = np.zeros(len(lags))
    for k, lag in enumerate(lags.tolist()):
        products = squares = others = 0.0
        for measured, flown in streams:
            first, second = _shifted(measured, flown, lag)
            both = np.isfinite(first + second)
            if np.count_nonzero(both) < MIN_TIME / STEP:
                continue
            first, second = first[both] - first[both].mean(), second[both] - second[both].mean()
            products += float(first @ second)
            squares += float(first @ first)
            others += float(second @ second)
        score[k] = products / math.sqrt(squares * others) if squares * others > 0 else 0.0
    best = int(np.argmax(score))
    if not 0 < best < len(lags) - 1 or score[best] <= 0:
        return None  # nothing moves, or it is out of range
    before, top, after = score[best - 1 : best + 2]
    bend = before - 2 * top + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    seconds = max(0.0, (lags[best] + shift) * STEP)
    unexplained = slopes = 0.0
    for measured, flown in streams:
        first, second = _shifted(measured, flown, int(lags[best]))
        slope = np.gradient(second, STEP)
        both = np.isfinite(first + second + slope)
        if not both.any():
            continue
        first, second = first[both] - first[both].mean(), second[both] - second[both].mean()
        unexplained += float(((first - second) ** 2).sum())
        slopes += float((slope[both] ** 2).sum())
    if slopes == 0.0:
        return None
    samples = sum(len(measured) for measured, _ in streams)
    return Latency(seconds, math.sqrt(unexplained / samples / slopes * (SPAN / STEP)))


def _shifted(measured: Array, flown: Array, lag: int) -> tuple[Array, Array]:
    """Return both streams where one is `lag` steps later than the other."""
    if lag <= 0:
        return measured[: len(measured) + lag], flown[-lag:] if lag else flown
    return measured[lag:], flown[:-lag]


def _append(
    samples: list[deque[tuple[float, float]]], agent: Rows, time: Array, height: Array
) -> None:
    """Add the samples of each agent that are newer than its last, and drop what is too old."""
    for row, at, value in zip(agent.tolist(), time.tolist(), height.tolist(), strict=True):
        of_agent = samples[row]
        if math.isfinite(value) and (not of_agent or at > of_agent[-1][0]):
            of_agent.append((at, value))
        while of_agent and of_agent[-1][0] - of_agent[0][0] > WINDOW:
            of_agent.popleft()


def _speeds(measured: Array, reported: Array) -> tuple[Array, Array] | None:
    """Return the vertical speeds of an agent by two series of heights on one grid, m/s.

    Args:
        measured: (K, 2) times and heights.
        reported: (M, 2) times and heights.
    """
    if len(measured) < 2 or len(reported) < 2:  # noqa: PLR2004 -- for a difference
        return None
    begin, end = max(measured[0, 0], reported[0, 0]), min(measured[-1, 0], reported[-1, 0])
    if end - begin < MIN_TIME + SPAN:
        return None
    grid = np.arange(begin + SPAN / 2, end - SPAN / 2, STEP)
    flown = _rate(grid, reported)
    return _rate(grid, measured), np.where(np.abs(flown) < MAX_SPEED, flown, np.nan)


def _rate(time: Array, samples: Array) -> Array:
    """Return the mean rate of change in `SPAN` about each time, (T,); NaN in gaps of samples."""
    ends = []
    for half in (-SPAN / 2, SPAN / 2):
        at = np.interp(time + half, *samples.T)
        after = np.clip(np.searchsorted(samples[:, 0], time + half), 1, len(samples) - 1)
        at[samples[after, 0] - samples[after - 1, 0] > MAX_GAP] = np.nan
        ends.append(at)
    rate: Array = (ends[1] - ends[0]) / SPAN
    return rate
