"""The original STAR's ``config.yaml``: its environment and the numbers of its flights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from star_core.formats import Value
from star_import.calibration import pitch_deg
from star_import.import_log import ImportLog, show

UNUSED: Final = "has no counterpart in STAR"
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
    keys = file.map()
    sections = {"": file} | {name: keys[name] for name in NUMBERS if name in keys}
    numbers: dict[str, Any] = {}
    for name, section in sections.items():
        for key, (attribute, read) in NUMBERS[name].items():
            with log.collected():
                if key in section.map():
                    numbers[attribute] = read(section.map()[key])
    with log.collected():
        numbers |= _of_obstacles_and_agents(keys, log)
    log.ignore_keys(file, TOP, why=UNUSED)
    for name, section in sections.items():
        if name:
            log.ignore_keys(section, NUMBERS[name], f"{name}.", UNUSED)
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


def _positive(value: Value) -> float:
    if (number := value.number()) <= 0:
        raise value.wrong(f"{number:g}, expected a number more than 0")
    return number


def _heights(value: Value) -> tuple[float, float]:
    try:
        low, high = value.numbers()
    except ValueError:
        raise value.wrong("expected two heights, m") from None
    if low >= high:
        raise value.wrong(f"lowest {low:g} is not below highest {high:g}", "empty-range")
    return low, high


NUMBERS: Final[Mapping[str, Mapping[str, tuple[str, Callable[[Value], Any]]]]] = {
    "": {"external_timeout": ("silence", _positive)},
    "trajectory_parameters": {
        "max_velocity": ("speed", _positive),
        "takeoff_land_velocity": ("climb", _positive),
        "takeoff_height": ("height", _positive),
        "reached_threshold": ("reached", _positive),
        "protected_zone": ("zone", _positive),
        "maximum_yaw_change": ("turn", _positive),
        "planning_rate": ("rate", _positive),
        "height_range": ("heights", _heights),
    },
    "april_tag_parameters": {
        "observation_threshold": ("sight", _positive),
        "center_origin": ("centred", Value.flag),
        "camera_rotation": ("pitch_deg", pitch_deg),
    },
}
"""Attributes by section and key, and what reads their values; those at the top by ''."""
