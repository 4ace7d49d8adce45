"""The compiled pass over the room of agents, against the tables that it makes unnecessary."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from star_core import Estimate, Obstacle, Transform
from star_core.messages.position_margin import position_margin
from star_core.testing import scene
from star_monitors.room import Room

N = 4
PILLAR = Obstacle("pillar", (((0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.5)),), (0.0, 2.0))


def numbers(low: float, high: float, *shape: int) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, shape, elements=st.floats(low, high))


@given(
    numbers(-2.4, 2.4, N, 3),
    numbers(-1.0, 1.0, N, 3),
    numbers(0.0, 0.6, N),
    arrays(np.bool_, (2, N)),
    st.sampled_from([2 / 3, 1.0]),
)
def test_enough_room_means_that_no_agent_or_pair_lacks_it(
    position: np.ndarray,
    velocity: np.ndarray,
    deviation: np.ndarray,
    masks: np.ndarray,
    min_use: float,
) -> None:
    swarm = scene(N)
    room = Room(replace(swarm, world=replace(swarm.world, obstacles=(PILLAR,))))
    covariance = deviation[:, None, None] ** 2 * np.eye(3)
    yaw, frames = np.zeros(N), Transform(np.zeros(N), np.zeros((N, 3)))
    estimate = Estimate(0.0, position, velocity, yaw, covariance, np.ones(N, np.bool_), frames)
    std = position_margin(estimate.covariance, 1.0, math.inf)
    enough, walls = room.measure(estimate, std, masks[0], masks[1], min_use)
    pairs = room.between(estimate, std, masks[1], min_use)
    if enough:
        assert walls is None or (walls.use <= 1.0).all()
        assert pairs is None or not len(pairs.first)
    elif walls is not None and pairs is None:
        assert walls.use.max() > 0.99
