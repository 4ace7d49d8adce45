"""Makes the scene of a mission from its data, also while some of it is not known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from star_core.mission_file.sound_parts import Incomplete
from star_core.mission_file.world_loader import point
from star_core.scene import Agent, Limits, Scene
from star_core.world.camera import Camera
from star_core.world.world import Fence, World

# What stands for the parts of a mission that are not known while the others are checked.
NO_WORLD: Final = World("", Fence((-math.inf,) * 3, (math.inf,) * 3))
UNKNOWN_START: Final = (math.nan,) * 3
UNLIMITED: Final[Mapping[str, Any]] = {
    "speed": math.inf,
    "acceleration": math.inf,
    "height": (-math.inf, math.inf),
    "separation": 0.0,
    "vertical_separation": 1.0,
    "uncertainty_margin": 0.0,
}


def scene(folder: Path, data: Mapping[str, Any], world: World | None, *, realtime: bool) -> Scene:
    """Return the scene of a mission.

    Args:
        folder: Of the mission.
        data: The mission, without what is wrong with it.
        world: None if it is not known.
        realtime: Whether mission time advances by itself.
    """
    unknown = UNLIMITED if isinstance(data["limits"], Incomplete) else {}
    limits = {**unknown, **data["limits"]}
    limits["height"] = tuple(limits["height"])
    return Scene(
        agents=agents(data),
        period=1 / data["rate"],
        world=world or NO_WORLD,
        limits=Limits(**limits),
        seed=data["seed"],
        realtime=realtime,
        folder=folder,
        groups=_groups(data),
    )


def agents(data: Mapping[str, Any]) -> tuple[Agent, ...]:
    """Return the agents of a mission, in the order of its ``swarm``."""
    cameras = {
        name: Camera() if isinstance(given, Incomplete) else _camera(given)
        for name, given in data.get("cameras", {}).items()
    }
    return tuple(
        Agent(
            name=name,
            start=point(given.get("start", UNKNOWN_START)),
            yaw=math.radians(given.get("yaw_deg", 0.0)),
            uri=given.get("uri"),
            camera=cameras.get(
                given.get("camera"),
                Camera() if "camera" in given or isinstance(given, Incomplete) else None,
            ),
        )
        for name, given in data["swarm"].items()
    )


def _groups(data: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """Rows of each group's agents; unknown names are reported by `checks`."""
    row = {name: i for i, name in enumerate(data["swarm"])}
    return {
        name: tuple(row[member] for member in members if member in row)
        for name, members in data.get("groups", {}).items()
    }


def uncertain_groups(written: Mapping[str, Any], data: Mapping[str, Any]) -> set[str] | None:
    """Return the names of groups whose agents are not all known; None if no name is."""
    if not isinstance(written.get("groups", {}), dict):
        return None
    agents = {*data["swarm"]}
    return {name for name, held in data["groups"].items() if not held or {*held} - agents}


def _camera(given: Mapping[str, Any]) -> Camera:
    values: dict[str, Any] = {
        name.removesuffix("_deg"): math.radians(value) if name.endswith("_deg") else value
        for name, value in given.items()
    }
    for name in values.keys() & {"matrix", "distortion", "position"}:
        values[name] = tuple(map(float, values[name]))
    return Camera(**values)
