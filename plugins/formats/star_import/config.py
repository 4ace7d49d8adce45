"""The original STAR's ``config.yaml``: its environment and the numbers of its flights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from star_core.formats import Value
from star_import.calibration import pitch_deg
from star_import.import_log import ImportLog, show

UNUSED: Final = "has no counterpart in STAR"
POSITIVE: Final = {
    "max_velocity": "speed",
    "takeoff_land_velocity": "climb",
    "takeoff_height": "height",
    "reached_threshold": "reached",
    "protected_zone": "zone",
    "maximum_yaw_change": "turn",
    "planning_rate": "rate",
}
"""Attributes by their keys under ``trajectory_parameters``."""
TOP: Final = (
    "trajectory_parameters",
    "april_tag_parameters",
    "environment_file",
    "external_timeout",
    "obstacle_expansion_factor",
    "offset_agents",
)


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
        turn: Greatest change of yaw between two plans, degrees.
        rate: Plans per second.
        expansion: Factor by which obstacles are enlarged; they end flat up to 1.
        sight: Distance within which a tag that is seen counts, m.
        centred: Whether positions of tags are those of their centers.
        pitch_deg: How far down cameras look, degrees.
    """

    speed: float = 0.1
    climb: float = 0.2
    height: float = 0.8
    reached: float = 0.2
    zone: float = 0.2
    heights: tuple[float, float] = (0.5, 2.0)
    silence: float = 5.0
    turn: float = 6.0
    rate: float = 8.0
    expansion: float = 0.0
    sight: float = 1.0
    centred: bool = False
    pitch_deg: float = 45.0


def config(file: Value | None, log: ImportLog) -> Config:
    """Return the numbers of a file; invalid ones are added to the problems of `log`.

    Without a file they are the defaults.
    """
    if file is None:
        return Config()
    numbers: dict[str, Any] = {}
    keys = file.map()
    trajectory = keys.get("trajectory_parameters")
    tags = keys.get("april_tag_parameters")
    of_trajectory = {} if trajectory is None else trajectory.map()
    of_tags = {} if tags is None else tags.map()
    for key, attribute in POSITIVE.items():
        if key in of_trajectory:
            with log.collected():
                numbers[attribute] = _positive(of_trajectory[key])
    if "external_timeout" in keys:
        with log.collected():
            numbers["silence"] = _positive(keys["external_timeout"])
    if "height_range" in of_trajectory:
        with log.collected():
            try:
                low, high = of_trajectory["height_range"].numbers()
            except ValueError:
                raise of_trajectory["height_range"].wrong("expected two heights, m") from None
            numbers["heights"] = (low, high)
    with log.collected():
        numbers |= _of_tags(of_tags)
    with log.collected():
        numbers |= _of_obstacles_and_agents(keys, log)
    log.ignore_keys(file, TOP, why=UNUSED)
    if trajectory is not None:
        log.ignore_keys(trajectory, {*POSITIVE, "height_range"}, "trajectory_parameters.", UNUSED)
    if tags is not None:
        read = {"observation_threshold", "center_origin", "camera_rotation"}
        log.ignore_keys(tags, read, "april_tag_parameters.", UNUSED)
    return Config(**numbers)


def _of_obstacles_and_agents(keys: Mapping[str, Value], log: ImportLog) -> dict[str, Any]:
    """Return the expansion of obstacles, and log what is not done with them and with agents."""
    if "offset_agents" in keys and any(keys["offset_agents"].numbers()):
        where = keys["offset_agents"].begins_at
        log.changed(where, "agents start where crazyflies.yaml has them, without 'offset_agents'")
    if "obstacle_expansion_factor" not in keys:
        return {}
    factor = keys["obstacle_expansion_factor"]
    if factor.number() > 1:
        text = f"obstacles are not enlarged {show(factor.number())} times; the planner's clearance"
        log.changed(factor.begins_at, f"{text} keeps agents away from them")
    return {"expansion": factor.number()}


def _of_tags(keys: Mapping[str, Value]) -> dict[str, Any]:
    """Return the numbers about tags."""
    numbers: dict[str, Any] = {}
    if "observation_threshold" in keys:
        numbers["sight"] = _positive(keys["observation_threshold"])
    if "center_origin" in keys:
        numbers["centred"] = keys["center_origin"].flag()
    if "camera_rotation" in keys:
        numbers["pitch_deg"] = pitch_deg(keys["camera_rotation"])
    return numbers


def _positive(value: Value) -> float:
    if (number := value.number()) <= 0:
        raise value.wrong(f"{number:g}, expected a number more than 0")
    return number
