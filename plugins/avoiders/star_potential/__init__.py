"""The avoider `potential`: agents and obstacles repel, as in an artificial potential field."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from star_core import AvoiderSpec, hookimpl

if TYPE_CHECKING:
    from star_core import Avoider, Scene


def _positive(default: float, description: str) -> dict[str, Any]:
    bound = {"type": "number", "exclusiveMinimum": 0}
    return {**bound, "default": default, "description": description}


_OPTIONS = {
    "radius": _positive(
        0.2, "Half the distance of greatest repulsion; all of it from obstacles, m."
    ),
    "reach": _positive(0.5, "Distance beyond that at which repulsion begins, m."),
    "gain": _positive(0.002, "Strength of the repulsion, m⁴/s."),
}


@hookimpl
def star_avoiders() -> Iterable[AvoiderSpec]:
    yield AvoiderSpec(
        name="potential",
        summary="Agents and obstacles repel, as in an artificial potential field (Khatib 1986).",
        make=_make,
        options={"type": "object", "properties": _OPTIONS},
    )


def _make(scene: Scene, **options: Any) -> Avoider:
    from star_potential.avoider import Potential

    return Potential(scene, **options)
