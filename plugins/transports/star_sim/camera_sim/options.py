"""Error model of cameras, their links and the tag survey: ``sim``'s option ``camera``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from star_core.toolkit import fill_defaults
from star_sim.error_profile import IDEAL, ErrorProfile

MODES = ("rendered", "geometric", "off")


def of_profile(maximum: float, description: str) -> dict[str, Any]:
    """Return the schema of a number whose default depends on the profile."""
    return {
        "type": "number",
        "minimum": 0,
        "maximum": maximum,
        "description": f"{description.removesuffix('.')}; by default that of the profile.",
    }


def _by_profile(maximum: float, description: str) -> Any:
    return field(metadata=of_profile(maximum, description))


def _number(default: float, maximum: float, description: str, type_: str = "number") -> Any:
    schema = {"type": type_, "minimum": 0, "maximum": maximum, "description": description}
    return field(metadata=schema | {"default": default})


def _count(maximum: int, description: str) -> Any:
    return _number(0, maximum, description, "integer")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraOptions:
    """The values of the options; the metadata of a field is its schema."""

    mode: str = field(
        metadata={
            "enum": list(MODES),
            "default": "rendered",
            "description": "rendered sends images; geometric sends tag corners without images, "
            "like a camera with on-board detection; off sends nothing.",
        }
    )
    latency: float = _number(0.15, 5, "Time from the middle of the exposure to the arrival, s.")
    latency_std: float = _number(0.015, 1, "Standard deviation of the latency, s.")
    drop_rate: float = _number(0.0, 1, "Fraction of images that are lost.")
    wrong_id_rate: float = _number(
        0.0,
        1,
        "Fraction of tags in an image that get the id of another tag; rendered images show "
        "the pattern of that tag.",
    )
    timestamps: bool = field(
        metadata={
            "type": "boolean",
            "description": "Whether images carry the time of their exposure; without, localizers "
            "infer it from their arrival; by default as in the profile.",
        }
    )
    pixel_noise_std: float = _number(4.0, 64, "Standard deviation of a pixel's gray value, of 255.")
    corner_noise_std: float = _number(
        0.2, 10, "Standard deviation of a corner in u and in v, px; with mode: geometric."
    )
    latency_offset_std: float = _by_profile(
        1, "Standard deviation of each camera's constant difference from the latency, s."
    )
    survey_std: float = _by_profile(
        1, "Standard deviation of a sheet's position along each of its axes, m."
    )
    survey_yaw_std_deg: float = _by_profile(
        45, "Standard deviation of a sheet's rotation on its surface, degrees."
    )
    survey_height_std: float = _by_profile(
        1, "Standard deviation of a sheet's position across its surface, m."
    )
    survey_tilt_std_deg: float = _by_profile(
        45, "Standard deviation of a sheet's tilt about each of its axes, degrees."
    )
    mounting_std_deg: float = _by_profile(
        45, "Standard deviation of a camera's attitude about each of its axes, degrees."
    )
    mounting_position_std: float = _by_profile(
        0.1, "Standard deviation of a camera's position along each axis, m."
    )
    focal_length_std: float = _by_profile(
        0.2, "Standard deviation of a camera's focal length, as a fraction."
    )
    image_center_std: float = _by_profile(
        50, "Standard deviation of the optical axis in u and in v, px."
    )
    exposure_step: float = _number(
        0.0, 0.9, "Greatest relative change of brightness by auto-exposure, every ten images."
    )
    fixed_pattern_std: float = _number(
        0.0, 64, "Standard deviation of constant offsets of columns and of pixels, gray values."
    )
    jpeg_quality: int = _count(100, "Quality at which images are compressed; 0: not at all.")
    vibration_std_deg: float = _number(
        0.0, 10, "Standard deviation of the body's attitude by vibration at 15 Hz, degrees."
    )
    lamps: int = _count(1000, "Number of saturated reflections of lamps on the floor.")
    clutter: int = _count(
        1000, "Number of squares on the floor with a tag's paper and border, without its code."
    )
    covered: Sequence[str] = field(
        metadata={
            "type": "array",
            "items": {"type": "string"},
            "uniqueItems": True,
            "default": [],
            "description": "Landmarks and targets that are covered, so that no camera sees them.",
        }
    )


OPTIONS: dict[str, Any] = {
    "type": "object",
    "additionalProperties": False,
    "description": "Camera, link and tag-survey error model; defaults apply if not given, those "
    "without a default here by the profile.",
    "examples": [{"mode": "geometric"}],
    "properties": {each.name: dict(each.metadata) for each in fields(CameraOptions)},
}


def camera_options(profile: ErrorProfile = IDEAL, /, **options: Any) -> CameraOptions:
    """Return options as given in a mission, with defaults for the others.

    The defaults are those of `OPTIONS`, or of the profile for options that have none there.
    """
    of_profile = {
        name: getattr(profile, name)
        for name, option in OPTIONS["properties"].items()
        if "default" not in option
    }
    return CameraOptions(**fill_defaults(of_profile | options, OPTIONS))
