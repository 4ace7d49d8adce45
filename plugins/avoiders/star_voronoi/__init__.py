"""The avoider `voronoi`: each agent stays in its buffered Voronoi cell."""

from __future__ import annotations

from collections.abc import Iterable

from star_core import AvoiderSpec, deferred, hookimpl
from star_core.toolkit import positive

_OPTIONS = {
    "radius": positive(
        "Half the distance between agents, and distance from obstacles, m.", default=0.2
    ),
    "horizon": positive("Time for which an agent stays in its current cell, s.", default=0.5),
}


@hookimpl
def star_avoiders() -> Iterable[AvoiderSpec]:
    yield AvoiderSpec(
        name="voronoi",
        summary="Keeps each agent in its buffered Voronoi cell (Zhou et al. 2017).",
        make=deferred("star_voronoi.avoider:Voronoi"),
        avoids_obstacles=True,
        leads_around=True,
        options={"type": "object", "properties": _OPTIONS},
    )
