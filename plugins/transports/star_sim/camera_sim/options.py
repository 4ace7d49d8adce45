"""Error model of cameras, their links and the tag survey: ``sim``'s option ``camera``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from star_core import fill_defaults

MODES = ("rendered", "geometric", "off")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraOptions:
    """The values of `OPTIONS`."""

    mode: str
    latency: float
    latency_std: float
    drop_rate: float
    wrong_id_rate: float
    timestamps: bool
    pixel_noise_std: float
    corner_noise_std: float
    survey_std: float
    survey_yaw_std_deg: float
    mounting_std_deg: float
    mounting_position_std: float
    covered: Sequence[str]


def camera_options(**given: Any) -> CameraOptions:
    """Return options as given in a mission, with the defaults of `OPTIONS` for the others."""
    return CameraOptions(**fill_defaults(given, OPTIONS))


def _number(default: float, maximum: float, description: str) -> dict[str, Any]:
    return {
        "type": "number",
        "minimum": 0,
        "maximum": maximum,
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
        "latency": _number(0.15, 5, "Time from the middle of the exposure to the arrival, s."),
        "latency_std": _number(0.015, 1, "Standard deviation of the latency, s."),
        "drop_rate": _number(0.0, 1, "Fraction of images that are lost."),
        "wrong_id_rate": _number(
            0.0,
            1,
            "Fraction of tags in an image that get the id of another tag; rendered images show "
            "the pattern of that tag.",
        ),
        "timestamps": {
            "type": "boolean",
            "default": True,
            "description": "Whether images carry the time of their exposure.",
        },
        "pixel_noise_std": _number(4.0, 64, "Standard deviation of a pixel's gray value, of 255."),
        "corner_noise_std": _number(
            0.2, 10, "Standard deviation of a corner in u and in v, px; with mode: geometric."
        ),
        "survey_std": _number(
            0.005, 1, "Standard deviation of a sheet's position along each of its axes, m."
        ),
        "survey_yaw_std_deg": _number(0.5, 45, "Standard deviation of a sheet's heading, degrees."),
        "mounting_std_deg": _number(
            0.5, 45, "Standard deviation of a camera's attitude about each of its axes, degrees."
        ),
        "mounting_position_std": _number(
            0.002, 0.1, "Standard deviation of a camera's position along each axis, m."
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
