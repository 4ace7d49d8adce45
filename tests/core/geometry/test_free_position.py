"""Positions to land at: nearest, clear of agents, obstacles at any height below, and the fence."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Fence, Obstacle, World
from star_core.geometry.free_position import (
    AGENT_CLEARANCE,
    EXTRA_CLEARANCE,
    OBSTACLE_CLEARANCE,
    free_position,
    is_free,
)

START = np.array([0.0, 0.0, 1.5])
FENCE = Fence((-3.0, -3.0, 0.0), (3.0, 3.0, 2.0))
NO_AGENT = np.zeros((0, 2))


def table(foot: float, crest: float) -> World:
    """Return a room with a table of 0.4 m by 0.4 m below the agent."""
    square = ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2))
    return World("room", FENCE, (Obstacle("table", (square,), (foot, crest)),))


def test_the_own_position_is_preferred() -> None:
    position = free_position(START, World("room", FENCE), np.array([[0.25, 0.0]]), AGENT_CLEARANCE)
    assert position is not None
    assert position.tolist() == [0.0, 0.0]


def test_a_position_aside_keeps_the_extra_clearance() -> None:
    aside = free_position(START, World("room", FENCE), np.array([[0.1, 0.0]]), AGENT_CLEARANCE)
    assert aside is not None
    away = np.linalg.norm(aside - [0.1, 0.0])
    assert AGENT_CLEARANCE + EXTRA_CLEARANCE <= away < AGENT_CLEARANCE + EXTRA_CLEARANCE + 0.05


@pytest.mark.parametrize(
    ("heights", "free"),
    [((0.0, 0.7), [False]), ((0.8, 0.9), [False]), ((1.4, 1.8), [False]), ((1.6, 1.9), [True])],
)
def test_obstacles_count_at_every_height_below(
    heights: tuple[float, float], free: list[bool]
) -> None:
    below = is_free(START[None, :2], table(*heights), NO_AGENT, 0.25, START[2])
    assert below.tolist() == free
    aside = free_position(START, table(*heights), NO_AGENT, 0.25)
    assert aside is not None
    assert free == [True] or max(abs(aside)) >= 0.2 + OBSTACLE_CLEARANCE


def test_no_position_is_free_where_the_agent_can_fly_nowhere() -> None:
    nowhere = free_position(
        START, table(0.0, 1.0), NO_AGENT, 0.25, accepts=lambda ends: np.zeros(len(ends), np.bool_)
    )
    assert nowhere is None
