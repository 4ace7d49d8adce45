"""How cameras, their links and the survey of the tags err: options of the transport ``sim``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

MODES = ("rendered", "geometric", "off")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraOptions:
    """What `OPTIONS` describes, in radians."""

    mode: str = "rendered"
    latency: float = 0.15
    jitter: float = 0.015
    drops: float = 0.0
    wrong_ids: float = 0.0
    stamped: bool = True
    noise: float = 4.0
    corner_noise: float = 0.2
    survey: float = 0.005
    survey_yaw: float = math.radians(0.5)
    mounting: float = math.radians(0.5)
    lever: float = 0.002
    covered: tuple[str, ...] = ()

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> CameraOptions:
        """Take over what a mission says."""
        values = {
            name.removesuffix("_deg"): math.radians(value) if name.endswith("_deg") else value
            for name, value in given.items()
        }
        return cls(**values | {"covered": tuple(given.get("covered", ()))})


def _number(default: float, description: str, most: float | None = None) -> dict[str, Any]:
    limits = {} if most is None else {"maximum": most}
    return {
        "type": "number",
        "minimum": 0,
        **limits,
        "default": default,
        "description": description,
    }


OPTIONS: dict[str, Any] = {
    "type": "object",
    "additionalProperties": False,
    "description": "How the agents' cameras, their links and the survey of the tags err; each as "
    "below if not given.",
    "examples": [{"mode": "geometric"}],
    "properties": {
        "mode": {
            "enum": list(MODES),
            "default": "rendered",
            "description": "rendered sends images; geometric sends the tags' corners without an "
            "image, as a camera that detects on board; off sends nothing.",
        },
        "latency": _number(0.15, "From the middle of the exposure to the arrival, s.", 5),
        "jitter": _number(0.015, "Deviation of the latency, s.", 1),
        "drops": _number(0.0, "Share of the images that never arrive.", 1),
        "wrong_ids": _number(
            0.0,
            "Share of the tags that are taken for another one in an image; where images are "
            "rendered they bear its pattern there.",
            1,
        ),
        "stamped": {
            "type": "boolean",
            "default": True,
            "description": "Whether images say when they were taken.",
        },
        "noise": _number(4.0, "Deviation of a pixel's grey value, of 255.", 64),
        "corner_noise": _number(
            0.2, "Deviation of a corner in u and in v, px; with mode: geometric.", 10
        ),
        "survey": _number(0.005, "Deviation of a sheet's place along each of its axes, m.", 1),
        "survey_yaw_deg": _number(0.5, "Deviation of a sheet's heading, degrees.", 45),
        "mounting_deg": _number(
            0.5, "Deviation of a camera's attitude about each of its axes, degrees.", 45
        ),
        "lever": _number(0.002, "Deviation of a camera's place along each axis, m.", 0.1),
        "covered": {
            "type": "array",
            "items": {"type": "string"},
            "uniqueItems": True,
            "default": [],
            "description": "Landmarks and targets that nobody can see.",
        },
    },
}
