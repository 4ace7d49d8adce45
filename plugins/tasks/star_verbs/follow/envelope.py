"""Checks of a trajectory against limits and world. Does not import numpy."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from star_verbs.follow.polyline import dense
from star_verbs.follow.routes import FINE
from star_verbs.places import fault, rooms
from star_verbs.slots import shifted_by

if TYPE_CHECKING:
    from star_core import Scene
    from star_verbs.follow.trajectory import Moment, Point, Trajectory

TICK = 0.02  # s of a trajectory's own time between samples
FEWEST = 20  # least number of samples of a piece
STEP = 0.1  # m between checked points; a Crazyflie spans 0.12 m with its propellers
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Sample:
    """A sample of a trajectory: its state, its time, s, and the line of its piece in the file."""

    time: float
    line: int
    moment: Moment


def samples(trajectory: Trajectory) -> list[Sample]:
    """Densely spaced samples of a trajectory, including both ends of every piece."""
    found = []
    for begin, piece in zip(trajectory.begins, trajectory.pieces, strict=True):
        count = max(FEWEST, math.ceil(piece.duration / TICK))
        found += [
            Sample(begin + time, piece.line, piece.at(time))
            for time in (piece.duration * i / count for i in range(count + 1))
        ]
    return found


def thinned(found: Sequence[Sample]) -> list[Sample]:
    """Samples that are at least `STEP` from the previous one, and the last one."""
    kept = [found[0]]
    for sample in found[1:]:
        if math.dist(sample.moment.point, kept[-1].moment.point) >= STEP / 2:
            kept.append(sample)
    return kept if kept[-1] is found[-1] else [*kept, found[-1]]


def place_faults(
    scene: Scene, found: Sequence[Sample], shifts: Sequence[Point], name: str
) -> Iterator[str]:
    """Return where a shifted trajectory is not flyable, and why.

    Args:
        scene: The mission's scene.
        found: Samples of the trajectory.
        shifts: Offsets of the trajectory, m; of consecutive bad samples the first is reported.
        name: Name of the file in the mission.
    """
    messages: dict[str, None] = {}
    for shift in dict.fromkeys(shifts):
        dx, dy, dz = shift
        beside = shifted_by(shift, len(shifts))
        bad = False
        for sample in found:
            x, y, z = sample.moment.point
            why = fault(scene, (x + dx, y + dy, z + dz))
            if why is not None and not bad:
                label = f"{name}:{sample.line}{beside}: {sample.time:.2f} s after its start"
                messages[f"{label}, {why}"] = None
            bad = why is not None
    yield from messages


def trajectory_positions(
    found: Sequence[Sample], shifts: Sequence[Point], name: str
) -> Iterator[tuple[str, Point]]:
    """Yield positions along a shifted trajectory, at most `FINE` apart, with their labels.

    Args:
        found: Samples of the trajectory.
        shifts: Offset of the trajectory for each agent, m.
        name: Name of the file in the mission.
    """
    for shift in dict.fromkeys(shifts):
        dx, dy, dz = shift
        beside = shifted_by(shift, len(shifts))
        for a, b in pairwise([*found, found[-1]]):
            label = f"{name}:{a.line}{beside}: {a.time:.2f} s after its start"
            for x, y, z in dense(a.moment.point, b.moment.point, FINE):
                yield label, (x + dx, y + dy, z + dz)


def room_faults(scene: Scene, found: Sequence[Sample], name: str) -> Iterator[str]:
    """Report directions in which a trajectory is too long for the room, wherever it begins."""
    room = rooms(scene)
    for i, axis in enumerate("xyz"):
        values = [sample.moment.point[i] for sample in found]
        span = max(values) - min(values)
        if span > room[i] + ROUNDING:
            where = "the heights to fly at" if axis == "z" else "the fence"
            yield f"{name}: spans {span:.2f} m along {axis}, {where} only {room[i]:.2f} m"


def limit_faults(
    scene: Scene, found: Sequence[Sample], timescale: float, name: str
) -> Iterator[str]:
    """Report where a trajectory exceeds the limits of speed or acceleration, and what would fit.

    Slowing down by a factor divides speeds by it and accelerations by its square. A jump of the
    velocity between pieces is reported if it exceeds what the limit permits in a tick.

    Args:
        scene: The mission's scene.
        found: Samples of the trajectory in its own time.
        timescale: Factor by which its duration is stretched.
        name: Name of the file in the mission.
    """
    limits = scene.limits
    change = limits.acceleration * scene.period  # m/s in a tick
    fast, speed = _most((math.hypot(*s.moment.velocity), s) for s in found)
    hard, acceleration = _most((math.hypot(*s.moment.acceleration), s) for s in found)
    joints = [(a, b) for a, b in pairwise(found) if a.time == b.time and a is not b]
    rough, jump = _most(
        [(math.dist(a.moment.velocity, b.moment.velocity), b) for a, b in joints] or [(0.0, fast)]
    )
    fit = max(speed / limits.speed, math.sqrt(acceleration / limits.acceleration), jump / change)
    slower = f"timescale: {math.ceil(fit * 100 - ROUNDING) / 100:g} would fit"
    for sample, value, most, power, text in (
        (fast, speed, limits.speed, 1, "flies {:.2f} m/s, faster than limits.speed of {:g} m/s"),
        (hard, acceleration, limits.acceleration, 2,
         "accelerates by {:.2f} m/s², more than limits.acceleration of {:g} m/s²"),
        (rough, jump, change, 1,
         "changes its velocity by {:.2f} m/s at once, more than {:g} m/s in a tick"),
    ):  # fmt: skip
        flown = value / timescale if power == 1 else value / timescale / timescale
        if flown > most * (1 + ROUNDING):
            where = f"{name}:{sample.line}: {sample.time:.2f} s after its start"
            yield f"{where} it {text.format(flown, most)}; {slower}"


def _most(values: Iterable[tuple[float, Sample]]) -> tuple[Sample, float]:
    """The sample with the greatest value, the first of equal ones, and its value."""
    value, sample = max(values, key=lambda pair: pair[0])
    return sample, value
