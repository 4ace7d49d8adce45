"""Neighbours out of cells are the neighbours found by comparing all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Array
from star_orca.neighbours import FEW, ROW, nearest, sort_into_cells

EVERY_HEIGHT = 1e9


def near_rows(
    position: Array, distance: float, vertical: float, most: int, climb: Array | None = None
) -> dict[int, list[int]]:
    """Rows of the neighbours of every row, nearest first."""
    n = len(position)
    climbs = np.zeros((n, 3))
    if climb is not None:
        climbs[:, 2] = climb
    agents, cell, start, columns = sort_into_cells(
        position,
        np.zeros((n, 3)),
        climbs,
        np.zeros(n),
        np.zeros(n),
        np.ones(n),
        np.ones(n, np.bool_),
        np.full((n, 2), np.nan),
        distance,
    )
    neighbours = {}
    for me in range(len(agents)):
        rows, squared = np.empty(most, np.int64), np.empty(most)
        limits = (distance, vertical, 1.0)
        count = nearest(agents, me, cell[me], start, columns, limits, rows, squared)
        neighbours[int(agents[me, ROW])] = [int(agents[k, ROW]) for k in rows[:count]]
    return neighbours


def looked_up(position: Array, distance: float, vertical: float, most: int) -> dict[int, list[int]]:
    """The same the naive way."""
    neighbours = {}
    for i, at in enumerate(position):
        away = np.hypot(*(position - at)[:, :2].T)
        near = (away < distance) & (np.abs(position[:, 2] - at[2]) <= vertical)
        near[i] = False
        order = np.argsort(away)
        neighbours[i] = [int(j) for j in order if near[j]][:most]
    return neighbours


def swarm(n: int, width: float = 12.0) -> Array:
    return np.random.default_rng(n).uniform([0, 0, 0], [width, 0.7 * width, 2], (n, 3))


@pytest.mark.parametrize("n", [1, 2, FEW, FEW + 1, 300])
@pytest.mark.parametrize("most", [1, 10])
def test_the_nearest_within_reach_are_found_nearest_first(n: int, most: int) -> None:
    position = swarm(n)
    assert near_rows(position, 2.0, EVERY_HEIGHT, most) == looked_up(
        position, 2.0, EVERY_HEIGHT, most
    )


def test_agents_at_other_heights_take_no_neighbour_slots() -> None:
    position = swarm(200)
    assert near_rows(position, 2.0, 0.6, 5) == looked_up(position, 2.0, 0.6, 5)


def test_agents_soon_near_in_height_are_neighbours() -> None:
    stack = np.array([[0.0, 0, 1], [0.1, 0, 2.5]])
    assert near_rows(stack, 2.0, 0.6, 5) == {0: [], 1: []}
    assert near_rows(stack, 2.0, 0.6, 5, np.array([0.5, -0.5])) == {0: [1], 1: [0]}
    assert near_rows(stack, 2.0, 0.6, 5, np.array([0.5, 0.5])) == {0: [], 1: []}
    assert near_rows(stack, 2.0, 0.6, 5, np.array([3.0, 0.0])) == {0: [1], 1: [0]}  # right through


def test_one_agent_very_far_away_changes_nothing_for_the_others() -> None:
    position = np.vstack([swarm(100), [[1e7, -3e6, 1.0]]])
    assert near_rows(position, 2.0, 9.0, 10) == looked_up(position, 2.0, 9.0, 10)


def test_a_hundred_coincident_agents_are_all_neighbours() -> None:
    neighbours = near_rows(np.ones((100, 3)), 2.0, 0.6, 200)
    assert all(sorted([i, *near]) == list(range(100)) for i, near in neighbours.items())


@pytest.mark.parametrize("n", [5, 100])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_agent_at_no_finite_position_is_nobodys_neighbour(n: int, bad: float) -> None:
    position = swarm(n)
    expected = looked_up(position[:-1], 3.0, 9.0, 10)
    position[-1, 1] = bad
    assert near_rows(position, 3.0, 9.0, 10) == expected
