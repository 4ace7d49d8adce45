"""The avoider `potential`: agents and obstacles repel, as in an artificial potential field."""

from __future__ import annotations

from collections.abc import Iterable

from star_core import AvoiderSpec, deferred, hookimpl
from star_core.toolkit import positive

_OPTIONS = {
    "radius": positive(
        "Half the distance of greatest repulsion; all of it from obstacles, m.", default=0.2
    ),
    "reach": positive("Distance beyond that at which repulsion begins, m.", default=0.5),
    "gain": positive("Strength of the repulsion, m⁴/s.", default=0.002),
}


@hookimpl
def star_avoiders() -> Iterable[AvoiderSpec]:
    yield AvoiderSpec(
        name="potential",
        summary="Agents and obstacles repel, as in an artificial potential field (Khatib 1986).",
        make=deferred("star_potential.avoider:Potential"),
        avoids_obstacles=True,
        options={"type": "object", "properties": _OPTIONS},
    )
