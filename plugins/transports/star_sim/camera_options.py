"""Error model of cameras, their links and the tag survey: options of the transport ``sim``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

MODES = ("rendered", "geometric", "off")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraOptions:
    """The values of `OPTIONS`, with angles in radians."""

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
        """Return the options given in a mission."""
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
    "description": "Camera, link and tag-survey error model; defaults apply if not given.",
    "examples": [{"mode": "geometric"}],
    "properties": {
        "mode": {
            "enum": list(MODES),
            "default": "rendered",
            "description": "rendered sends images; geometric sends tag corners without images, "
            "like a camera with on-board detection; off sends nothing.",
        },
        "latency": _number(0.15, "From the middle of the exposure to the arrival, s.", 5),
        "jitter": _number(0.015, "Standard deviation of the latency, s.", 1),
        "drops": _number(0.0, "Fraction of images that are lost.", 1),
        "wrong_ids": _number(
            0.0,
            "Fraction of tags in an image that get the id of another tag; rendered images show "
            "the pattern of that tag.",
            1,
        ),
        "stamped": {
            "type": "boolean",
            "default": True,
            "description": "Whether images carry the time of their exposure.",
        },
        "noise": _number(4.0, "Standard deviation of a pixel's grey value, of 255.", 64),
        "corner_noise": _number(
            0.2, "Standard deviation of a corner in u and in v, px; with mode: geometric.", 10
        ),
        "survey": _number(
            0.005, "Standard deviation of a sheet's position along each of its axes, m.", 1
        ),
        "survey_yaw_deg": _number(0.5, "Standard deviation of a sheet's heading, degrees.", 45),
        "mounting_deg": _number(
            0.5, "Standard deviation of a camera's attitude about each of its axes, degrees.", 45
        ),
        "lever": _number(
            0.002, "Standard deviation of a camera's position along each axis, m.", 0.1
        ),
        "covered": {
            "type": "array",
            "items": {"type": "string"},
            "uniqueItems": True,
            "default": [],
            "description": "Landmarks and targets that are covered, so that no camera sees them.",
        },
    },
}
