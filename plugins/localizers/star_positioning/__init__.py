"""A localizer that fuses positions of a positioning system with on-board odometry."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from star_core import LocalizerSpec, Problem, Scene, deferred, hookimpl
from star_core.toolkit import positive

OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "max_report_age": positive("Age up to which an agent's report is valid, s.", default=0.5),
    },
}


def check(scene: Scene, **_options: Any) -> Iterable[Problem]:
    """Require a transport that measures positions."""
    if not scene.measures_positions:
        yield Problem(
            (),
            "the transport measures no positions; in simulation, write "
            "transport: {use: sim, positioning: {std: 0.03}}, or use localizer flow or apriltag",
            "no-positioning",
        )


@hookimpl
def star_localizers() -> Iterable[LocalizerSpec]:
    yield LocalizerSpec(
        name="positioning",
        summary="Fuse positions measured by a positioning system with on-board odometry.",
        make=deferred("star_positioning.localizer:Positioning"),
        options=OPTIONS,
        check=check,
        corrects_heights=True,
        drift=deferred("star_positioning.odometry:expected_std"),
    )
