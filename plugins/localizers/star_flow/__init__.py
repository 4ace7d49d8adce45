"""A localizer that trusts the on-board estimate: no tags, so it drifts."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from star_core import LocalizerSpec, hookimpl

if TYPE_CHECKING:
    from star_core import Localizer, Scene


def make(
    scene: Scene,
    *,
    stale: float = 0.5,
    error: float = 0.0,
    error_time: float = 1.0,
    latency: float = 0.15,
) -> Localizer:
    from star_flow.localizer import Flow

    return Flow(scene, stale=stale, error=error, error_time=error_time, latency=latency)


@hookimpl
def star_localizers() -> Iterable[LocalizerSpec]:
    yield LocalizerSpec(
        name="flow",
        summary="Trust the on-board estimate from where each agent started; it drifts.",
        make=make,
        options={
            "type": "object",
            "properties": {
                "stale": {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "description": "Age past which an agent's report is not flown on, s.",
                    "default": 0.5,
                },
                "error": {
                    "type": "number",
                    "minimum": 0,
                    "description": "For studies: standard deviation along each axis of an error "
                    "that is added to every position on purpose, m; the covariance says so too.",
                    "default": 0.0,
                },
                "error_time": {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "description": "For studies: time constant with which that error is "
                    "forgotten, s.",
                    "default": 1.0,
                },
                "latency": {
                    "type": "number",
                    "minimum": 0,
                    "maximum": 2,
                    "description": "From taking an image to its arrival, for tags found on board "
                    "that do not say when they were taken, s.",
                    "default": 0.15,
                },
            },
        },
    )
