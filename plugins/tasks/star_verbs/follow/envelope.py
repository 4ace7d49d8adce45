"""Whether a trajectory stays within limits and world. Nothing here imports numpy."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from star_verbs.places import fault, rooms

if TYPE_CHECKING:
    from star_core import Scene
    from star_verbs.follow.trajectory import Moment, Point, Trajectory

TICK = 0.02  # s of a trajectory's own time between the moments that are looked at
FEWEST = 20  # moments of a piece that are looked at, however short it is
STEP = 0.1  # m: how finely its line is looked at; a Crazyflie spans 0.12 m with its propellers
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Sample:
    """A moment of a trajectory, when it is, s, and the line of the file that says so."""

    time: float
    line: int
    moment: Moment


def samples(trajectory: Trajectory) -> list[Sample]:
    """Moments of a trajectory, close to each other, with both ends of every piece."""
    found = []
    for begin, piece in zip(trajectory.begins, trajectory.pieces, strict=True):
        count = max(FEWEST, math.ceil(piece.duration / TICK))
        found += [
            Sample(begin + time, piece.line, piece.at(time))
            for time in (piece.duration * i / count for i in range(count + 1))
        ]
    return found


def thinned(found: Sequence[Sample]) -> list[Sample]:
    """Those of some samples that are `STEP` from the one before, and the last one."""
    kept = [found[0]]
    for sample in found[1:]:
        if math.dist(sample.moment.point, kept[-1].moment.point) >= STEP / 2:
            kept.append(sample)
    return kept if kept[-1] is found[-1] else [*kept, found[-1]]


def place_faults(
    scene: Scene, found: Sequence[Sample], shifts: Sequence[Point], name: str
) -> Iterator[str]:
    """Say where on a trajectory that is shifted no agent can be, and why not.

    Args:
        scene: The mission's scene.
        found: Moments of the trajectory.
        shifts: How far it is shifted, m; each run of bad places of one is told by its first.
        name: What the mission calls the file.
    """
    told: dict[str, None] = {}
    for dx, dy, dz in dict.fromkeys(shifts):
        bad = False
        for sample in found:
            x, y, z = sample.moment.point
            why = fault(scene, (x + dx, y + dy, z + dz))
            if why is not None and not bad:
                told[f"{name}:{sample.line}: {sample.time:.2f} s after its start, {why}"] = None
            bad = why is not None
    yield from told


def room_faults(scene: Scene, found: Sequence[Sample], name: str) -> Iterator[str]:
    """Say in which direction a trajectory is too long for the room, wherever it begins."""
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
    """Say where a trajectory is faster, or speeds up more, than the limits let, and what would fit.

    Slowed down by a factor, speeds are divided by it and accelerations by its square. A change of
    velocity from one piece to the next is told if it is more than the limit allows in a tick.

    Args:
        scene: The mission's scene.
        found: Moments of the trajectory in its own time.
        timescale: How many times its own time it is flown in.
        name: What the mission calls the file.
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
    for sample, value, most, power, told in (
        (fast, speed, limits.speed, 1, "flies {:.2f} m/s, faster than limits.speed of {:g} m/s"),
        (hard, acceleration, limits.acceleration, 2,
         "speeds up by {:.2f} m/s², more than limits.acceleration of {:g} m/s²"),
        (rough, jump, change, 1,
         "changes its velocity by {:.2f} m/s at once, more than {:g} m/s in a tick"),
    ):  # fmt: skip
        flown = value / timescale if power == 1 else value / timescale / timescale
        if flown > most * (1 + ROUNDING):
            where = f"{name}:{sample.line}: {sample.time:.2f} s after its start"
            yield f"{where} it {told.format(flown, most)}; {slower}"


def _most(values: Iterable[tuple[float, Sample]]) -> tuple[Sample, float]:
    """The sample with the greatest value, the first of equal ones, and its value."""
    value, sample = max(values, key=lambda pair: pair[0])
    return sample, value
