"""The avoider `none`: every agent flies what the planner wants, whoever is in the way."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from star_core import Offer, hookimpl

if TYPE_CHECKING:
    from star_core import Avoider, Estimate, Scene, Setpoint


class PassThrough:
    """Avoids nobody."""

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        return wanted


@hookimpl
def star_avoiders() -> Iterable[Offer[Avoider]]:
    yield Offer(name="none", summary="Avoids nobody.", make=_make)


def _make(_scene: Scene) -> Avoider:
    return PassThrough()
