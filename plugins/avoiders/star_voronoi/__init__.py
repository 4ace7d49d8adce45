"""The avoider `voronoi`: each agent stays in its buffered Voronoi cell."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from star_core import AvoiderSpec, hookimpl

if TYPE_CHECKING:
    from star_core import Avoider, Scene

_OPTIONS = {
    name: {"type": "number", "exclusiveMinimum": 0, "default": default, "description": description}
    for name, default, description in (
        ("radius", 0.2, "Half the distance between agents, and distance from obstacles, m."),
        ("horizon", 0.5, "Time for which an agent stays in its current cell, s."),
    )
}


def _make(scene: Scene, **options: Any) -> Avoider:
    from star_voronoi.avoider import Voronoi

    return Voronoi(scene, **options)


@hookimpl
def star_avoiders() -> Iterable[AvoiderSpec]:
    summary = "Keeps each agent in its buffered Voronoi cell (Zhou et al. 2017)."
    schema = {"type": "object", "properties": _OPTIONS}
    yield AvoiderSpec(name="voronoi", summary=summary, make=_make, options=schema)
