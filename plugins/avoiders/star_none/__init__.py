"""The avoider `none`: passes the planner's setpoints through, without avoidance."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from star_core import AvoiderSpec, hookimpl

if TYPE_CHECKING:
    from star_core import Avoider, Estimate, Scene, Setpoint


class PassThrough:
    """Does not avoid anything."""

    def avoid(self, estimate: Estimate, planned: Setpoint) -> Setpoint:
        return planned


@hookimpl
def star_avoiders() -> Iterable[AvoiderSpec]:
    yield AvoiderSpec(
        name="none",
        summary="Passes setpoints through unchanged.",
        make=_make,
        uncertain_positions=True,  # it keeps no distances that could grow
    )


def _make(_scene: Scene) -> Avoider:
    return PassThrough()
