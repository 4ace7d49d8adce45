"""A plugin whose avoider `bent` has options that are no JSON Schema."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from star_core import AvoiderSpec, hookimpl

if TYPE_CHECKING:
    from star_core import Estimate, Scene, Setpoint


class Bent:
    """Avoids nothing."""

    def __init__(self, scene: Scene) -> None: ...

    def avoid(self, estimate: Estimate, planned: Setpoint) -> Setpoint:
        return planned


@hookimpl
def star_avoiders() -> Iterable[AvoiderSpec]:
    yield AvoiderSpec(name="bent", summary="No schema.", make=Bent, options={"type": "objekt"})
