"""The original STAR's ``config.yaml``: its environment and the numbers of its flights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from star_core.formats import Value
from star_import.import_log import ImportLog

UNUSED: Final = "has no counterpart in STAR"
POSITIVE: Final = {
    "max_velocity": "speed",
    "takeoff_land_velocity": "climb",
    "takeoff_height": "height",
    "reached_threshold": "reached",
    "protected_zone": "zone",
}
"""Attributes by their keys under ``trajectory_parameters``."""


@dataclass(frozen=True, slots=True)
class Config:
    """Numbers of the original's flights; the defaults are those that it came with.

    Attributes:
        speed: Speed limit, m/s.
        climb: Speed of take-offs, m/s.
        height: Height of take-offs, m.
        reached: Goal tolerance, m.
        zone: Protected zone; agents at one goal keep twice this distance, m.
        heights: Lowest and highest flight height, m.
        silence: Time after which a silent external program counts as finished, s.
    """

    speed: float = 0.1
    climb: float = 0.2
    height: float = 0.8
    reached: float = 0.2
    zone: float = 0.2
    heights: tuple[float, float] = (0.5, 2.0)
    silence: float = 5.0


def config(file: Value, log: ImportLog) -> Config:
    """Return the numbers of a file; invalid ones are added to the problems of `log`."""
    numbers: dict[str, Any] = {}
    listed = file.map().get("trajectory_parameters")
    trajectory = {} if listed is None else listed.map()
    for key, attribute in POSITIVE.items():
        if key in trajectory:
            with log.collected():
                numbers[attribute] = _positive(trajectory[key])
    if "external_timeout" in file.map():
        with log.collected():
            numbers["silence"] = _positive(file.map()["external_timeout"])
    if "height_range" in trajectory:
        with log.collected():
            try:
                low, high = trajectory["height_range"].numbers()
            except ValueError:
                raise trajectory["height_range"].wrong("expected two heights, m") from None
            numbers["heights"] = (low, high)
    log.ignored(file, {"trajectory_parameters", "environment_file", "external_timeout"}, why=UNUSED)
    if listed is not None:
        log.ignored(listed, {*POSITIVE, "height_range"}, why=UNUSED)
    return Config(**numbers)


def _positive(value: Value) -> float:
    if (number := value.number()) <= 0:
        raise value.wrong(f"{number:g}, expected a number more than 0")
    return number
