"""An empty room, a shot in one line, and one floor for all tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from star_core import Fence, Obstacle, World
from star_core.world.quaternions import turned
from star_sim.camera_sim.camera_pose import Shot
from star_sim.camera_sim.floor_texture import Floor, floor


def _shot(
    at: Sequence[float] = (0.0, 0.0, 0.8),
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    velocity: Sequence[float] = (0.0, 0.0, 0.0),
    rates: Sequence[float] = (0.0, 0.0, 0.0),
) -> Shot:
    """A shot at a place with roll, pitch and yaw, rad."""
    return Shot(
        np.array(at, float), np.array(turned(*turn)), np.array(velocity), np.array(rates, float)
    )


def _room(*obstacles: Obstacle) -> World:
    return World("room", Fence((-5.0, -5.0, 0.0), (5.0, 5.0, 3.0)), obstacles)


@pytest.fixture(scope="session")
def take() -> Callable[..., Shot]:
    return _shot


@pytest.fixture(scope="session")
def room() -> Callable[..., World]:
    return _room


@pytest.fixture(scope="session")
def ground() -> Floor:
    return floor(0)
