"""Agents that come nearer to each other than the expected drift of their positions permits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Final

import numpy as np

from star_core import MAX_MARGIN, Mission, Problem, Registry, fill_defaults
from star_explain.tracks import PERIOD, Tracks

MIN_SPEED: Final = 0.1  # m/s, relative: two agents that are slower do not pass each other
MAX_RISK: Final = 0.01  # probability from which on there is a warning


def drift_problems(mission: Mission, registry: Registry, tracks: Tracks) -> Iterator[Problem]:
    """Warn if agents probably come closer than the separation because their positions drift.

    By their estimated positions, two agents whose goals are near to each other keep the separation,
    or twice the radius of the avoider if that is more; while they pass each other, it is enlarged
    by the margins for their uncertain positions. Their real distance is smaller than the separation
    if the error along the line between them, which is normal with the variances of both, exceeds
    the rest. The risk of a pair is that of its worst moment, and that of the mission at most the
    sum over the pairs.

    Args:
        mission: The mission.
        registry: Registry of its plugins.
        tracks: Where its agents are in the dry run.
    """
    limits, scene = mission.scene.limits, mission.scene
    localizer, avoider = mission.parts["localizer"], mission.parts["avoider"]
    offer = registry.find("localizer", localizer.use).offer
    time, position, yaw, airborne = tracks.sampled(PERIOD)
    std = offer.drift(scene, time, position, yaw, **fill_defaults(localizer.options, offer.options))
    options = fill_defaults(avoider.options, registry.find("avoider", avoider.use).offer.options)
    radius = options.get("radius", 0.0)
    base = max(limits.separation, 2 * radius if isinstance(radius, int | float) else 0.0)
    total, worst, where = 0.0, 0.0, ""
    for first, second in combinations(range(len(scene.agents)), 2):
        offset = position[:, first] - position[:, second]
        planned = np.hypot(offset[:, 0], offset[:, 1])
        margin = limits.uncertainty_margin * (std[:, first] + std[:, second])
        passing = np.linalg.norm(np.gradient(offset, PERIOD, axis=0), axis=1) > MIN_SPEED
        kept = base + np.where(passing, np.minimum(margin, MAX_MARGIN * base), 0.0)
        rest = (np.maximum(planned, kept) - limits.separation) / np.hypot(
            std[:, first], std[:, second]
        )
        together = airborne[:, first] & airborne[:, second]
        together &= np.abs(offset[:, 2]) < limits.vertical_separation
        rest = np.where(together, rest, np.inf)
        at = int(rest.argmin())
        risk = math.erfc(rest[at] / math.sqrt(2)) / 2
        total += risk
        if risk > worst:
            worst = risk
            where = (
                f"{scene.named((first, second))} are {planned[at]:.1f} m apart after about "
                f"{time[at]:.0f} s of the dry run, when positions by {localizer.use!r} have a "
                f"standard deviation of {std[at, [first, second]].max():.2f} m"
            )
    if total > MAX_RISK:
        yield Problem(
            ("localizer",),
            f"{where}; agents come closer than limits.separation ({limits.separation:g} m) with a "
            f"probability of up to {100 * min(1.0, total):.0f} %: keep them farther apart, "
            "shorten the mission, or locate them by landmarks",
            "drift-exceeds-separation",
            warning=True,
        )
