"""The errors of a recorded flight: time offset, alignment, and the measures of the paper."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import fftconvolve
from scipy.spatial.transform import Rotation

from star_core import Array, InputError, Mask, Run

Alignment: TypeAlias = Literal["none", "yaw", "rigid"]

MAX_GAP: Final = 0.1  # s between two true positions, above which those between are unknown
STEP: Final = 0.01  # s, of the grid on which speeds are correlated
SPAN: Final = 0.2  # s, over which speeds are differences of positions
MAX_SPEED: Final = 20.0  # m/s: more is an outlier, which must not decide
MAX_TIME: Final = 24 * 3600.0  # s of ground truth
SEARCH: Final = 0.05  # s about the greatest correlation
MIN_SAMPLES: Final = 10


class Errors(NamedTuple):
    """The position errors of an agent, or of all, between take-off and landing.

    Attributes:
        samples: Number of ticks with a true position.
        coverage: Their share of all ticks.
        mse: Mean square distance in space, m².
        mse_std: Its standard deviation over the ticks, m².
        rmse: Square root of `mse`, m.
        worst: Greatest distance, m.
        nees: Mean squared error along an axis over its variance; 1 if the variances are right.
        path_length: Of the true path, m.
    """

    samples: int
    coverage: float
    mse: float
    mse_std: float
    rmse: float
    worst: float
    nees: float
    path_length: float


NOT_COMPARED: Final = Errors(0, 0.0, math.nan, math.nan, math.nan, math.nan, math.nan, 0.0)


class Evaluation(NamedTuple):
    """A flight compared with ground truth.

    Attributes:
        agents: Errors by agent.
        every: Of all agents.
        offset: Added to the times of the ground truth, s.
        rotation: (3, 3) by which the ground truth was turned into the map.
        translation: (3,) by which it was then moved, m.
    """

    agents: Mapping[str, Errors]
    every: Errors
    offset: float
    rotation: Array
    translation: Array


class Compared(NamedTuple):
    """Samples of an agent's flight.

    Attributes:
        row: Of the agent.
        time: (T,) of its ticks between take-off and landing, s.
        estimate: (T, 3) m.
        std: (T, 3) of it, m.
        track: (K, 4) ground truth: times and positions.
    """

    row: int
    time: Array
    estimate: Array
    std: Array
    track: Array

    def truth(self, offset: float) -> Array:
        """Return the true positions at the ticks, (T, 3) m; NaN where unknown."""
        return at(self.time, self.track, offset)


def evaluate(
    run: Run, tracks: Mapping[str, Array], *, offset: float | None = 0.0, align: Alignment = "none"
) -> Evaluation:
    """Return the errors of a flight.

    Args:
        run: The record.
        tracks: By agent (K, 4) times, s, and positions, m.
        offset: To add to those times, s; None finds the one with the least mean square error, near
            the greatest correlation of the speeds.
        align: What turns and moves the ground truth into the map to the least mean square error:
            nothing, a heading and a translation, or a rotation and a translation (Umeyama, IEEE
            TPAMI 13(4), 1991, without scale). It is the same for all agents.

    Raises:
        InputError: They have no time in common.
    """
    flights = [_compared(run, run.agents.index(agent), track) for agent, track in tracks.items()]
    flights = [flight for flight in flights if len(flight.time)]
    if not flights:
        raise InputError(f"{run.folder}: no agent with ground truth has flown", "no-record")
    if offset is None:
        offset = _best_offset(flights, align)
    rotation, translation = _alignment(flights, offset, align)
    results: dict[str, Errors] = {}
    pooled = []
    for flight in flights:
        truth = flight.truth(offset) @ rotation.T + translation
        finite: Mask = np.isfinite(truth.sum(axis=1))
        compared = flight.estimate - truth, flight.std, finite, _length(truth[finite])
        pooled.append(compared)
        results[run.agents[flight.row]] = _errors(*compared)
    if not any(errors.samples for errors in results.values()):
        text = f"{run.folder}: the ground truth and the flight have no time in common"
        raise InputError(f"{text}; find their offset by --offset auto", "no-record")
    error, std, finite = (np.concatenate([each[k] for each in pooled]) for k in range(3))
    every = _errors(error, std, finite, sum(length for *_, length in pooled))
    agents = {name: results.get(name, NOT_COMPARED) for name in run.agents}
    return Evaluation(agents, every, offset, rotation, translation)


def recorded_truth(run: Run) -> dict[str, Array]:
    """Return the ground truth in a record, by agent; empty if it has none."""
    if "truth_position" not in run.arrays:
        return {}
    tracks = {}
    for row, name in enumerate(run.agents):
        position = run.arrays["truth_position"][:, row]
        finite = np.isfinite(position.sum(axis=1))
        if np.count_nonzero(finite) > 1:
            tracks[name] = np.column_stack([run.arrays["time"], position])[finite]
    return tracks


def at(time: Array, track: Array, offset: float) -> Array:
    """Return the positions of a track at times, (T, 3) m; NaN outside of it and in its gaps."""
    times = track[:, 0] + offset
    positions = np.column_stack([np.interp(time, times, axis) for axis in track[:, 1:].T])
    after = np.clip(np.searchsorted(times, time), 1, len(times) - 1)
    exact = np.isclose(times[after], time, atol=1e-9) | np.isclose(
        times[after - 1], time, atol=1e-9
    )
    gap = times[after] - times[after - 1] > MAX_GAP
    outside = (time < times[0] - 1e-9) | (time > times[-1] + 1e-9)
    positions[outside | (gap & ~exact)] = np.nan
    return positions


def _compared(run: Run, row: int, track: Array) -> Compared:
    estimate = run.arrays["estimate_position"][:, row]
    rows = run.in_flight()[:, row] & np.isfinite(estimate.sum(axis=1))
    std = run.arrays["estimate_position_std"][rows, row]
    return Compared(row, run.arrays["time"][rows], estimate[rows], std, track)


def _errors(offset: Array, std: Array, finite: Mask, length: float) -> Errors:
    if not finite.any():
        return NOT_COMPARED
    error = offset[finite]
    squared = np.vecdot(error, error)
    normalized = (error / np.maximum(std[finite], 1e-9)) ** 2
    mse = float(squared.mean())
    return Errors(
        int(finite.sum()),
        float(finite.mean()),
        mse,
        float(squared.std()),
        math.sqrt(mse),
        math.sqrt(float(squared.max())),
        float(normalized.mean()),
        length,
    )


def _length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _alignment(flights: list[Compared], offset: float, align: Alignment) -> tuple[Array, Array]:
    """Return the rotation and translation of the ground truth to the least mean square error."""
    if align == "none":
        return np.eye(3), np.zeros(3)
    truths = [flight.truth(offset) for flight in flights]
    finite = [np.isfinite(truth.sum(axis=1)) for truth in truths]
    source = np.concatenate([truth[rows] for truth, rows in zip(truths, finite, strict=True)])
    target = np.concatenate(
        [flight.estimate[rows] for flight, rows in zip(flights, finite, strict=True)]
    )
    if len(source) < MIN_SAMPLES:
        return np.eye(3), np.zeros(3)
    middle, goal = source.mean(axis=0), target.mean(axis=0)
    if align == "rigid":
        rotation, _ = Rotation.align_vectors(target - goal, source - middle)
        matrix: Array = rotation.as_matrix()
    else:
        flat_source, flat_target = (source - middle)[:, :2], (target - goal)[:, :2]
        cross = float(
            (flat_source[:, 0] * flat_target[:, 1] - flat_source[:, 1] * flat_target[:, 0]).sum()
        )
        matrix = Rotation.from_euler(
            "z", math.atan2(cross, float((flat_source * flat_target).sum()))
        ).as_matrix()
    return matrix, goal - matrix @ middle


def _best_offset(flights: list[Compared], align: Alignment) -> float:
    """Return the offset with the least mean square error near the greatest correlation of speeds.

    Raises:
        InputError: The ground truth lasts too long, or nothing moves.
    """
    start = min(flight.track[0, 0] for flight in flights)
    lasts = max(flight.track[-1, 0] for flight in flights) - start
    if lasts > MAX_TIME:
        text = f"the ground truth lasts more than {MAX_TIME / 3600:g} h; cut it"
        raise InputError(text, "out-of-range")
    begin = min(flight.time[0] for flight in flights)
    flown = np.arange(0.0, max(flight.time[-1] for flight in flights) - begin, STEP)
    grid = np.arange(0.0, lasts, STEP)
    score = np.zeros(len(grid) + len(flown) - 1)
    for flight in flights:
        true = _speeds(grid, flight.track[:, 0] - start, flight.track[:, 1:])
        own = _speeds(flown, flight.time - begin, flight.estimate)
        score += fftconvolve(true, own[::-1])
    if not score.max(initial=0.0) > 0:
        text = "the offset of the ground truth cannot be found: nothing moves"
        raise InputError(text, "no-record")
    shift = (int(np.argmax(score)) - (len(flown) - 1)) * STEP  # by which the truth is later
    coarse = begin - start - shift

    def cost(further: float) -> float:
        offset = coarse + further
        rotation, translation = _alignment(flights, offset, align)
        squared = [
            np.sum((flight.estimate - flight.truth(offset) @ rotation.T - translation) ** 2, axis=1)
            for flight in flights
        ]
        mean = np.nanmean(np.concatenate(squared)) if squared else math.inf
        return float(mean) if math.isfinite(mean) else math.inf

    bounds = (-SEARCH, SEARCH)
    best = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-5})
    return float(coarse + best.x)


def _speeds(grid: Array, time: Array, position: Array) -> Array:
    """Return the speeds of a track on a grid of times, m/s; 0 where unknown."""
    ends = [
        np.column_stack([np.interp(grid + half, time, axis) for axis in position.T])
        for half in (-SPAN / 2, SPAN / 2)
    ]
    speed: Array = np.linalg.norm(ends[1] - ends[0], axis=1) / SPAN
    return np.where(speed < MAX_SPEED, speed, 0.0)
