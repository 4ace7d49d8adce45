"""Paths that lead agents past each other nearer than the margins for their positions ask for."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Final

import numpy as np

from star_core import Array, Mask, Mission, Problem, Registry
from star_core.toolkit import MAX_MARGIN_RATIO, Rehearsal
from star_explain.separation import kept_distance

PERIOD: Final = 1.0  # s
MIN_SPEED: Final = 0.1  # m/s, of agents that move, and relative, of two that pass each other
BESIDE: Final = 2  # agents that pass at once from which on an agent cannot make way to one side
DURATION: Final = 5  # periods in a row; passing a few agents takes less
MIN_SHARE: Final = 0.5  # of the agents that move
MIN_MARGIN: Final = 0.5  # of the distance without margins: less hardly slows agents


def jam_problems(mission: Mission, registry: Registry, rehearsal: Rehearsal) -> Iterator[Problem]:
    """Warn if most agents have to pass others for a while, nearer than they keep apart.

    Two agents keep the separation, or twice the radius of the avoider if that is more, and while
    they pass each other the margins for their uncertain positions as well. Within the margins
    they give way to each other, which leads nowhere for an agent with others on both sides.
    """
    limits, scene = mission.scene.limits, mission.scene
    localizer = mission.plugins["localizer"]
    offer = registry.find("localizer", localizer.use).offer
    time, position, yaw, airborne = rehearsal.sampled(PERIOD)
    std = offer.drift(scene, time, position, yaw, **localizer.options)
    base = kept_distance(mission)
    margin = np.minimum(limits.uncertainty_margin * std, MAX_MARGIN_RATIO * base / 2)
    if 2 * margin.max() < MIN_MARGIN * base:
        return
    velocity = np.gradient(position, PERIOD, axis=0) if len(time) > 1 else 0 * position
    crowds = [
        crowd(position[k], velocity[k], airborne[k], margin[k], base, limits.vertical_separation)
        for k in range(len(time))
    ]
    jammed = [moving > 1 and len(distance) > MIN_SHARE * moving for moving, distance, _ in crowds]
    for tight, run in itertools.groupby(range(len(time)), key=jammed.__getitem__):
        rows = [*run]
        if tight and len(rows) >= DURATION:
            distance, kept = (
                float(np.median(np.concatenate([crowds[k][part] for k in rows]))) for part in (1, 2)
            )
            if kept - base < MIN_MARGIN * base:
                continue
            yield Problem(
                ("localizer",),
                f"paths lead agents past each other at {distance:.2f} m, and with the drift of "
                f"{localizer.use!r} they keep {kept:.2f} m apart from about {time[rows[0]]:.0f} s "
                "of the rehearsal on: they slow down or jam; give them more space, shorten the "
                "mission, or locate them better",
                "margins-exceed-paths",
                warning=True,
            )
            return


def crowd(
    position: Array, velocity: Array, airborne: Mask, margin: Array, base: float, vertical: float
) -> tuple[int, Array, Array]:
    """Return how many agents move, and how near those pass others that cannot make way.

    Args:
        position: (N, 3) m.
        velocity: (N, 3) m/s.
        airborne: (N,) whether agents fly.
        margin: (N,) for their positions, m.
        base: Distance that two keep without margins, m.
        vertical: Difference in height from which on agents do not matter, m.

    Returns:
        The number of agents that move; (K,) distance at which the agents that cannot make way pass
        the second nearest, and (K,) the distance that they keep from it, m.
    """
    moves = airborne & (np.linalg.norm(velocity[:, :2], axis=1) > MIN_SPEED)
    rows, others = np.flatnonzero(moves), np.flatnonzero(airborne)
    offset = position[rows, None] - position[others]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    closing = velocity[rows, None, :2] - velocity[others, :2]
    kept = base + margin[rows, None] + margin[others]
    passes = (distance < kept) & (np.hypot(closing[..., 0], closing[..., 1]) > MIN_SPEED)
    passes &= (np.abs(offset[..., 2]) < vertical) & (rows[:, None] != others)
    stuck = passes.sum(axis=1) >= BESIDE
    away = np.where(passes, distance, np.inf)[stuck]
    if not len(away):
        return len(rows), np.zeros(0), np.zeros(0)
    second = np.argsort(away, axis=1, kind="stable")[:, BESIDE - 1, None]
    return (
        len(rows),
        np.take_along_axis(away, second, axis=1)[:, 0],
        np.take_along_axis(kept[stuck], second, axis=1)[:, 0],
    )
