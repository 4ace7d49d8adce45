"""The avoider `voronoi`: every agent stays in its buffered Voronoi cell."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from star_core import Offer, hookimpl

if TYPE_CHECKING:
    from star_core import Avoider, Scene


def _positive(default: float, description: str) -> dict[str, Any]:
    bound = {"type": "number", "exclusiveMinimum": 0}
    return {**bound, "default": default, "description": description}


_OPTIONS = {
    "radius": _positive(0.2, "Half the distance that agents keep, and that kept to obstacles, m"),
    "horizon": _positive(0.5, "Time for which an agent stays in the cell it is in, s"),
    "vertical": _positive(0.6, "Agents further apart in height than this share no border, m"),
}


@hookimpl
def star_avoiders() -> Iterable[Offer[Avoider]]:
    yield Offer(
        name="voronoi",
        summary="Every agent stays in its buffered Voronoi cell (Zhou et al. 2017).",
        make=_make,
        options={"type": "object", "properties": _OPTIONS},
    )


def _make(scene: Scene, **options: Any) -> Avoider:
    from star_voronoi.avoider import Voronoi

    return Voronoi(scene, **options)
