"""Where receivers on board receive the base stations and anchors of a positioning system."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.rotations import rotation_from_quaternion
from star_core.world.world import Beacon, World

SAMPLES: Final = 33  # points of a line of sight that are compared with obstacles


class System(NamedTuple):
    """What a drone's receiver needs of a positioning system.

    Attributes:
        place: Attribute of `World` with its base stations or anchors.
        reach: Greatest distance at which one is received, m.
        view: Half of the angles of view of one, horizontal and vertical, rad.
        blocked: Whether obstacles between hide one.
        needed: Number of them that a position needs.
    """

    place: str
    reach: float
    view: tuple[float, float]
    blocked: bool
    needed: int

    def beacons(self, world: World) -> tuple[Beacon, ...]:
        """Return those of a world."""
        beacons: tuple[Beacon, ...] = getattr(world, self.place)
        return beacons


SYSTEMS: Final[Mapping[str, System]] = {
    # HTC states 150 by 110 degrees and up to 7 m for SteamVR base stations 2.0; beams are lost from
    # 4 m on (bitcraze/crazyflie-firmware#1025). The method of sweeps needs one of them (Bitcraze,
    # "Positioning methods").
    "lighthouse": System(
        "base_stations", 6.0, (math.radians(75), math.radians(55)), blocked=True, needed=1
    ),
    # "A theoretical minimum of 4 anchors" (Bitcraze, "Loco Positioning System"), 10 m apart at
    # most; walls of a room delay radio waves rather than block them.
    "loco": System("anchors", 10.0, (math.pi, math.pi / 2), blocked=False, needed=4),
}


def received(world: World, system: System, points: Array) -> Mask:
    """Return which base stations or anchors a drone receives: (T, K).

    Args:
        world: With K of them.
        system: They belong to.
        points: (T, 3) positions of the drone, map frame, m.
    """
    beacons = system.beacons(world)
    visible = np.zeros((len(points), len(beacons)), np.bool_)
    for k, beacon in enumerate(beacons):
        away = points - np.array(beacon.position)
        distance = np.linalg.norm(away, axis=1)
        ahead, aside, up = (away @ rotation_from_quaternion(np.array(beacon.rotation))).T
        across = np.abs(np.arctan2(aside, ahead)) <= system.view[0]
        above = np.abs(np.arctan2(up, np.hypot(ahead, aside))) <= system.view[1]
        visible[:, k] = (distance <= system.reach) & across & above
        if system.blocked:
            visible[:, k] &= unobstructed(world, beacon, points)
    return visible


def unobstructed(world: World, beacon: Beacon, points: Array) -> Mask:
    """Return whether no obstacle is on the straight line from a beacon: (T,).

    Lines are sampled; an obstacle thinner than a thirtieth of a line can be missed.
    """
    clear = np.ones(len(points), np.bool_)
    if not world.obstacles:
        return clear
    import shapely

    share = np.linspace(0.0, 1.0, SAMPLES)[1:, None, None]
    line = np.array(beacon.position) + share * (points - np.array(beacon.position))  # (S, T, 3)
    for obstacle in world.obstacles:
        low, high = obstacle.height
        level = (line[..., 2] > low) & (line[..., 2] < high)
        for polygon in map(shapely.Polygon, obstacle.polygons):
            inside = shapely.contains_xy(polygon, line[..., 0], line[..., 1])
            clear &= ~(inside & level).any(axis=0)
    return clear


def covered(world: World, name: str, points: Array) -> Mask:
    """Return where a drone receives enough of a positioning system: (T,).

    Args:
        world: With its base stations or anchors.
        name: In `SYSTEMS`.
        points: (T, 3) positions of the drone, map frame, m.
    """
    system = SYSTEMS[name]
    covered: Mask = received(world, system, points).sum(axis=1) >= system.needed
    return covered
