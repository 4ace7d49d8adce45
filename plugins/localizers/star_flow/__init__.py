"""A localizer that trusts the on-board estimate: no tags, so it drifts."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from star_core import LocalizerSpec, hookimpl

if TYPE_CHECKING:
    from star_core import Localizer, Scene

OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "max_report_age": {
            "type": "number",
            "exclusiveMinimum": 0,
            "description": "Age up to which an agent's report is valid, s.",
            "default": 0.5,
        },
        "error_std": {
            "type": "number",
            "minimum": 0,
            "description": "For studies: standard deviation along each axis of an artificial "
            "position error, m; its variance is part of the covariance.",
            "default": 0.0,
        },
        "error_time_constant": {
            "type": "number",
            "exclusiveMinimum": 0,
            "description": "For studies: correlation time of the artificial error, s.",
            "default": 1.0,
        },
        "latency": {
            "type": "number",
            "minimum": 0,
            "maximum": 2,
            "description": "Time from exposure to arrival, for on-board tag detections without a "
            "timestamp, s.",
            "default": 0.15,
        },
    },
}


def make(scene: Scene, **options: float) -> Localizer:
    from star_flow.localizer import Flow

    return Flow(scene, **options)


@hookimpl
def star_localizers() -> Iterable[LocalizerSpec]:
    yield LocalizerSpec(
        name="flow",
        summary="Trust the on-board estimate from where each agent started; it drifts.",
        make=make,
        options=OPTIONS,
    )
