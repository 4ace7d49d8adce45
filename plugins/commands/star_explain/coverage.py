"""Agents that leave the coverage of what locates them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from star_core import Mission, Problem, Registry
from star_core.toolkit import Rehearsal


def coverage_problems(
    mission: Mission, registry: Registry, rehearsal: Rehearsal
) -> Iterator[Problem]:
    """Warn of steps in which agents cannot be located, with the first such position of each."""
    localizer = mission.plugins["localizer"]
    covered = registry.find("localizer", localizer.use).offer.covered
    if covered is None:
        return
    paths = np.moveaxis(rehearsal.position, 1, 0)
    inside = [covered(mission.scene, path, **localizer.options) for path in paths]
    for step in rehearsal.steps:
        during = rehearsal.during(step)
        for row in step.rows:
            outside = np.flatnonzero(~inside[row][during])
            if len(outside):
                k = during.start + int(outside[0])
                place = ", ".join(f"{value:.2f}" for value in rehearsal.position[k, row])
                yield Problem(
                    step.action.at,
                    f"{mission.scene.names[row]} leaves the coverage of "
                    f"{localizer.use!r} at [{place}], {rehearsal.time[k]:.1f} s after the start",
                    "outside-coverage",
                    warning=True,
                )
                break
