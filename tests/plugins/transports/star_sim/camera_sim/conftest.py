"""An empty room, a shot in one line, and one floor for all tests."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from star_core import Fence, Obstacle, World
from star_core.world.quaternions import turned
from star_sim.camera_sim.camera_pose import Shot
from star_sim.camera_sim.floor_texture import Floor, floor


def take(
    at: ArrayLike = (0.0, 0.0, 0.8),
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    velocity: ArrayLike = (0.0, 0.0, 0.0),
    rates: ArrayLike = (0.0, 0.0, 0.0),
) -> Shot:
    """Return a shot at a position with roll, pitch and yaw, rad."""
    return Shot(
        np.array(at, float), np.array(turned(*turn)), np.array(velocity), np.array(rates, float)
    )


def room(*obstacles: Obstacle) -> World:
    return World("room", Fence((-5.0, -5.0, 0.0), (5.0, 5.0, 3.0)), obstacles)


@cache
def ground() -> Floor:
    return floor(0)
