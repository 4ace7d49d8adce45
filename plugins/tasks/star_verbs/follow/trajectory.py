"""Piecewise polynomial trajectories, and whether agents can fly them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from star_core import Array, Rows, Trajectory
from star_core.toolkit import polynomial
from star_verbs.positions import Point, extents, offset_label, points_between, shifted

if TYPE_CHECKING:
    from star_core import Scene

SAMPLE_PERIOD: Final = 0.02  # s of a trajectory's own time
MIN_SAMPLES: Final = 20  # of a piece
CHECK_STEP: Final = 0.05  # m between checked positions; a Crazyflie spans 0.12 m
ROUNDING: Final = 1e-9


class PolynomialPath:
    """A trajectory of polynomial pieces, as a line parameterized by the time since its start.

    Args:
        duration: (P,) of each piece, s.
        coefficients: (P, 4, 8) of x, y and z, m, and of yaw, rad, over the time since the piece
            began, s: the constant first.
        lines: Line number of each piece in its file.
        turns: Whether its headings are flown; otherwise agents keep their own.

    Attributes:
        trajectory: As flown on board.
        turns: Whether its headings are flown.
        length: Its total duration, s.
        begin: (P,) time at which each piece begins, s.
        lines: (P,) line number of each piece in its file.
    """

    def __init__(
        self, duration: Array, coefficients: Array, lines: Sequence[int], *, turns: bool = True
    ) -> None:
        self.turns = turns
        self.trajectory = Trajectory(duration, coefficients)
        end = np.cumsum(duration)
        self.length = float(end[-1])
        self.begin: Array = np.concatenate([[0.0], end[:-1]])
        self.lines: Rows = np.array(lines)

    def state(self, piece: Rows, time: Array) -> tuple[Array, Array, Array]:
        """Return (K, 4) x, y, z and yaw, and their first and second derivatives.

        Args:
            piece: (K,) pieces.
            time: (K,) times since their beginnings, s.
        """
        coefficients = np.moveaxis(self.trajectory.coefficients[piece], 2, 0)  # (8, K, 4)
        return polynomial(coefficients, time[:, None])

    def at(self, time: Array) -> tuple[Array, Array]:
        """Return (K, 3) points, m, and (K, 3) velocities, m/s, at (K,) times, s.

        Times are clamped to its beginning and end.
        """
        value, first, _ = self._at(time)
        return value[:, :3], first[:, :3]

    def acceleration(self, time: Array) -> tuple[Array, Array]:
        """Return (K, 3) accelerations, m/s², and (K,) yaw rates, rad/s, at (K,) times, s."""
        _, first, second = self._at(time)
        return second[:, :3], first[:, 3]

    def yaw(self, time: Array) -> Array | None:
        """Return (K,) headings at (K,) times, rad; None if it has none."""
        return self._at(time)[0][:, 3] if self.turns else None

    def _at(self, time: Array) -> tuple[Array, Array, Array]:
        piece = np.maximum(np.searchsorted(self.begin, time, "right") - 1, 0)
        since = np.clip(time - self.begin[piece], 0.0, self.trajectory.duration[piece])
        return self.state(piece, since)


@dataclass(frozen=True, slots=True)
class Samples:
    """States along a trajectory, at both ends of every piece and densely in between.

    Attributes:
        time: (S,) since its start, s.
        line: (S,) line number of the piece in its file.
        position: (S, 3) m.
        velocity: (S, 3) m/s.
        acceleration: (S, 3) m/s².
    """

    time: Array
    line: Rows
    position: Array
    velocity: Array
    acceleration: Array

    @classmethod
    def of(cls, path: PolynomialPath) -> Samples:
        """Sample a trajectory."""
        duration = path.trajectory.duration
        counts = np.maximum(MIN_SAMPLES, np.ceil(duration / SAMPLE_PERIOD)).astype(np.int64)
        piece = np.repeat(np.arange(len(counts)), counts + 1)
        since = np.concatenate(
            [d * np.arange(n + 1) / n for d, n in zip(duration, counts, strict=True)]
        )
        states = path.state(piece, since)
        position, velocity, acceleration = (state[:, :3] for state in states)
        return cls(path.begin[piece] + since, path.lines[piece], position, velocity, acceleration)

    def where(self, index: int, file: str, suffix: str = "") -> str:
        """Return the origin of a sample, for messages."""
        return f"{file}:{self.line[index]}{suffix}: {self.time[index]:.2f} s after its start"


def is_relative(options: Mapping[str, Any]) -> bool:
    """Return whether a trajectory begins at each agent's position, by the verb's options."""
    return bool(options.get("relative", options["format"] == "poly7"))


def position_faults(
    scene: Scene, samples: Samples, offsets: Sequence[Point], file: str
) -> Iterator[str]:
    """Yield where a shifted trajectory is not flyable, and why.

    Args:
        scene: The mission's scene.
        samples: Of the trajectory.
        offsets: Of the trajectory, m; of consecutive bad samples the first is reported.
        file: Name of the file in the mission.
    """
    messages: dict[str, None] = {}
    checked = _thinned(samples.position)
    for offset in dict.fromkeys(offsets):
        suffix = offset_label(offset, len(offsets))
        bad = False
        for i in checked:
            fault = scene.position_fault(shifted(samples.position[i].tolist(), offset))
            if fault is not None and not bad:
                messages[f"{samples.where(i, file, suffix)}, {fault}"] = None
            bad = fault is not None
    yield from messages


def labelled_positions(
    samples: Samples, offsets: Sequence[Point], file: str, *, start_only: bool
) -> Iterator[tuple[str, Point]]:
    """Yield positions along a shifted trajectory, at most `CHECK_STEP` apart, with their labels.

    Args:
        samples: Of the trajectory.
        offsets: Of the trajectory for each agent, m.
        file: Name of the file in the mission.
        start_only: Whether to yield the start only.
    """
    position = samples.position[: 1 if start_only else None].tolist()
    for offset in dict.fromkeys(offsets):
        suffix = offset_label(offset, len(offsets))
        for i, (a, b) in enumerate(pairwise([*position, position[-1]])):
            label = samples.where(i, file, suffix)
            for point in points_between(a, b, CHECK_STEP):
                yield label, shifted(point, offset)


def extent_faults(scene: Scene, samples: Samples, file: str) -> Iterator[str]:
    """Yield directions in which a trajectory is too long for the room, wherever it begins."""
    spans = np.ptp(samples.position, axis=0).tolist()
    for axis, span, extent in zip("xyz", spans, extents(scene), strict=True):
        if span > extent + ROUNDING:
            where = "the heights to fly at" if axis == "z" else "the fence"
            yield f"{file}: spans {span:.2f} m along {axis}, {where} only {extent:.2f} m"


def limit_faults(scene: Scene, samples: Samples, timescale: float, file: str) -> Iterator[str]:
    """Yield where a trajectory exceeds the limits of speed or acceleration, and what would fit.

    Slowing down by a factor divides speeds by it and accelerations by its square. A jump of the
    velocity between pieces is reported if it exceeds what the limit permits in a tick.

    Args:
        scene: The mission's scene.
        samples: Of the trajectory in its own time.
        timescale: Factor by which its duration is stretched.
        file: Name of the file in the mission.
    """
    limits = scene.limits
    change = limits.acceleration * scene.period  # m/s in a tick
    jump = _norm(np.diff(samples.velocity, axis=0, prepend=samples.velocity[:1]))
    jump[1:][np.diff(samples.line) == 0] = 0.0  # only where one piece ends and the next begins
    quantities = (
        (_norm(samples.velocity), limits.speed, 1,
         "flies {:.2f} m/s, faster than limits.speed of {:g} m/s"),
        (_norm(samples.acceleration), limits.acceleration, 2,
         "accelerates by {:.2f} m/s², more than limits.acceleration of {:g} m/s²"),
        (jump, change, 1,
         "changes its velocity by {:.2f} m/s at once, more than {:g} m/s in a tick"),
    )  # fmt: skip
    fit = max(float(values.max() / limit) ** (1 / power) for values, limit, power, _ in quantities)
    slower = f"timescale: {math.ceil(fit * 100 - ROUNDING) / 100:g} would fit"
    for values, limit, power, text in quantities:
        flown = float(values.max()) / timescale**power
        if flown > limit * (1 + ROUNDING):
            where = samples.where(int(values.argmax()), file)
            yield f"{where} it {text.format(flown, limit)}; {slower}"


def _thinned(position: Array) -> list[int]:
    """Samples that are at least `CHECK_STEP` from the previous one, and the last one."""
    points = position.tolist()
    kept = [0]
    for i, point in enumerate(points):
        if math.dist(point, points[kept[-1]]) >= CHECK_STEP:
            kept.append(i)
    return kept if kept[-1] == len(points) - 1 else [*kept, len(points) - 1]


def _norm(vector: Array) -> Array:
    """(S,) lengths of (S, 3) vectors, without overflow."""
    length: Array = np.hypot(np.hypot(vector[:, 0], vector[:, 1]), vector[:, 2])
    return length
