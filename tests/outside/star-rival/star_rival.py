"""A plugin whose avoider has the name of another distribution's: `gentle`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from star_core import AvoiderSpec, hookimpl

if TYPE_CHECKING:
    from star_core import Estimate, Scene, Setpoint


class Gentle:
    """Avoids nothing."""

    def __init__(self, scene: Scene) -> None: ...

    def avoid(self, estimate: Estimate, planned: Setpoint) -> Setpoint:
        return planned


@hookimpl
def star_avoiders() -> Iterable[AvoiderSpec]:
    yield AvoiderSpec(name="gentle", summary="Another of that name.", make=Gentle)
