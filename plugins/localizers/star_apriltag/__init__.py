"""Localizer ``apriltag``: AprilTags whose places are known correct the drift of odometry."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from star_core import LocalizerSpec, Problem, hookimpl

if TYPE_CHECKING:
    from star_core import Localizer, Scene

OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "method": {
            "enum": ["smoother", "batch"],
            "default": "smoother",
            "description": "smoother: fixed-lag, gated, with odometry calibrated in flight; batch: "
            "the original STAR's graph of every pose since take-off, for comparison.",
        },
        "tags_per_landmark": {
            "type": "integer",
            "minimum": 0,
            "default": 2,
            "description": "Of each landmark no more than so many tags are used, for ablations.",
        },
        "feedback": {
            "enum": ["none", "extpos", "extpose"],
            "default": "none",
            "description": "none: drones fly in their own odometry frames, which the core turns "
            "into the map; extpose: new fixes are sent to their estimators as well; extpos: of "
            "these the positions only, from which the estimators correct their headings too, but "
            "slowly and in motion only.",
        },
        "latency": {
            "type": "number",
            "minimum": 0,
            "maximum": 2,
            "default": 0.15,
            "description": "From taking an image to its arrival, for images that do not say when "
            "they were taken, s.",
        },
        "camera_deviation_deg": {
            "type": "number",
            "exclusiveMinimum": 0,
            "maximum": 15,
            "default": 1.0,
            "description": "How wrong a camera's mounting angles may be, degrees, one deviation; "
            "they are estimated in flight.",
        },
        "survey": {
            "type": "number",
            "minimum": 0,
            "default": 0.005,
            "description": "What the places of the landmarks are good for, m, one deviation; part "
            "of the covariance that is reported.",
        },
        "lag": {
            "type": "number",
            "minimum": 1,
            "maximum": 20,
            "default": 2.5,
            "description": "For how long poses are optimised again, with method: smoother, s.",
        },
        "guided": {
            "type": "boolean",
            "default": True,
            "description": "Whether tags of the map that are not detected, for they are too far or "
            "partly out of sight, are looked for where they should be; with method: smoother.",
        },
        "floor": {
            "type": "boolean",
            "default": False,
            "description": "Whether the floor's texture measures the way from image to image, "
            "where it has any; the floor is the map's plane z = 0; with method: smoother.",
        },
        "processes": {
            "type": ["integer", "null"],
            "minimum": 0,
            "maximum": 64,
            "default": None,
            "description": "How many processes look at images beside the tick; null: one for each "
            "camera, but a core is left for the tick. Results do not depend on it.",
        },
        "worst": {
            "type": "number",
            "exclusiveMinimum": 0,
            "default": 1.0,
            "description": "Deviation of the position up to which an agent is fit to fly, m.",
        },
        "stale": {
            "type": "number",
            "exclusiveMinimum": 0,
            "default": 0.5,
            "description": "Age past which an agent's report is not flown on, s.",
        },
    },
}


def make(  # noqa: PLR0913 -- a mission's own options
    scene: Scene,
    *,
    method: str = "smoother",
    tags_per_landmark: int = 2,
    feedback: str = "none",
    latency: float = 0.15,
    camera_deviation_deg: float = 1.0,
    survey: float = 0.005,
    lag: float = 2.5,
    guided: bool = True,
    floor: bool = False,
    processes: int | None = None,
    worst: float = 1.0,
    stale: float = 0.5,
) -> Localizer:
    from star_apriltag.group import Settings
    from star_apriltag.localizer import AprilTag

    return AprilTag(
        scene,
        Settings(
            method=method,
            tags_per_landmark=tags_per_landmark,
            latency=latency,
            camera_deviation=math.radians(camera_deviation_deg),
            lag=lag,
            guided=guided,
            floor=floor,
        ),
        processes=processes,
        feedback=feedback,
        survey=survey,
        worst=worst,
        stale=stale,
    )


def check(
    scene: Scene,
    *,
    method: str = "smoother",
    feedback: str = "none",
    lag: float = 2.5,
    latency: float = 0.15,
    **_others: Any,
) -> Iterable[Problem]:
    """Say what would leave this localizer blind, and which options do not go together."""
    if method == "batch" and feedback != "none":
        yield Problem(("feedback",), f"{feedback!r} goes with method: smoother only")
    if lag < latency + 1.0:
        yield Problem(("lag",), f"{lag:g} s is not 1 s more than the latency of {latency:g} s")
    if not scene.world.landmarks:
        yield Problem((), f"world {scene.world.name!r} has no landmarks; use 'flow' without them")
    elif not any(agent.camera for agent in scene.agents):
        yield Problem((), "no agent has a camera; give agents `camera: aideck`, or use 'flow'")


@hookimpl
def star_localizers() -> Iterable[LocalizerSpec]:
    yield LocalizerSpec(
        name="apriltag",
        summary="Odometry, corrected by AprilTags whose places are known.",
        make=make,
        options=OPTIONS,
        check=check,
    )
