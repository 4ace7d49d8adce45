"""Localizer ``apriltag``: odometry, corrected by AprilTags at known positions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from star_core import LocalizerSpec, Problem, deferred, hookimpl
from star_core.toolkit import number, positive

if TYPE_CHECKING:
    from star_core import Localizer, Scene


OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "method": {
            "enum": ["filter", "batch"],
            "default": "filter",
            "description": "filter: a Kalman filter of the pose with all errors that last; batch: "
            "the original STAR's graph of every pose since take-off, for comparison.",
        },
        "max_tags_per_landmark": {
            "type": "integer",
            "minimum": 0,
            "default": 2,
            "description": "Greatest number of tags of each landmark that are used; for ablations.",
        },
        "feedback": {
            "enum": ["none", "extpos", "extpose"],
            "default": "none",
            "description": "none: drones fly in their own odometry frames, which the core "
            "transforms to the map; extpose: new poses are sent to their estimators as well; "
            "extpos: positions only, by which the estimators correct their headings too, but "
            "slowly and in motion only.",
        },
        "latency": number(
            "Time from exposure to arrival, for images without a timestamp, s.",
            minimum=0,
            maximum=2,
            default=0.15,
        ),
        "latency_std": number(
            "Standard deviation of that time, s; half of the variance is that of its mean, which "
            "is estimated in flight.",
            minimum=0,
            maximum=2,
            default=0.025,
        ),
        "mounting_std_deg": positive(
            "Standard deviation of a camera's mounting angles, degrees; they are estimated in "
            "flight.",
            maximum=15,
            default=1.5,
        ),
        "survey_std": number(
            "Standard deviation of the landmarks' surveyed positions along each axis, m; their "
            "errors are estimated in flight.",
            minimum=0,
            default=0.015,
        ),
        "survey_std_deg": number(
            "Standard deviation of the landmarks' rotations about each axis, degrees; they are "
            "estimated in flight.",
            minimum=0,
            maximum=45,
            default=1.5,
        ),
        "guided_matching": {
            "type": "boolean",
            "default": True,
            "description": "Whether to search tags of the map that are not detected, because they "
            "are far or partly outside the image, at their expected pixels; with method: filter.",
        },
        "floor_odometry": {
            "type": "boolean",
            "default": True,
            "description": "Whether to measure motion from image to image by the floor's texture "
            "while no tag of the map is in view; the floor is the map's plane z = 0. Without "
            "texture, flow odometry is used; with method: filter.",
        },
        "processes": {
            "type": ["integer", "null"],
            "minimum": 0,
            "maximum": 64,
            "default": None,
            "description": "Number of processes that analyze images beside the tick; null: one for "
            "each camera, with a core left for the tick. Results do not depend on it.",
        },
        "max_position_std": positive(
            "Standard deviation of the position up to which an agent is located, m.", default=1.0
        ),
        "max_report_age": positive("Age up to which an agent's report is valid, s.", default=0.5),
    },
}


def make(
    scene: Scene,
    *,
    feedback: str,
    processes: int | None,
    max_position_std: float,
    max_report_age: float,
    mounting_std_deg: float,
    survey_std_deg: float,
    **settings: Any,
) -> Localizer:
    from star_apriltag.agent_estimator import Settings
    from star_apriltag.localizer import AprilTag

    return AprilTag(
        scene,
        Settings(
            mounting_std=math.radians(mounting_std_deg),
            survey_turn_std=math.radians(survey_std_deg),
            **settings,
        ),
        processes=processes,
        feedback=feedback,
        max_position_std=max_position_std,
        max_report_age=max_report_age,
    )


def check(scene: Scene, *, method: str, feedback: str, **_others: Any) -> Iterable[Problem]:
    """Yield options that contradict each other, and scenes in which no tag can be seen."""
    if method == "batch" and feedback != "none":
        reason = f"{feedback!r} goes with method: filter only"
        yield Problem(("feedback",), reason, "option-conflict")
    if not scene.world.landmarks:
        reason = f"world {scene.world.name!r} has no landmarks; use 'flow' without them"
        yield Problem((), reason, "no-tags")
    elif not any(agent.camera for agent in scene.agents):
        reason = "no agent has a camera; give agents `camera: aideck`, or use 'flow'"
        yield Problem((), reason, "missing-camera")


@hookimpl
def star_localizers() -> Iterable[LocalizerSpec]:
    yield LocalizerSpec(
        name="apriltag",
        summary="Odometry, corrected by AprilTags at known positions.",
        make=make,
        options=OPTIONS,
        check=check,
        corrects_heights=True,
        edge_clearance=0.5,  # benchmarks/heights.py
        drift=deferred("star_apriltag.expected_std:expected_std"),
    )
