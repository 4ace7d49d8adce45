"""Which agents are near each other, in the order of x and by all pairs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core.geometry.neighbours import MANY, least, pairs


@given(st.integers(0, 2 * MANY), st.integers(0, 1000), st.floats(0.05, 3.0))
def test_pairs_are_those_that_are_nearer_than_the_reach(n: int, seed: int, reach: float) -> None:
    position = np.random.default_rng(seed).uniform(-3, 3, (n, 3))
    expected = [
        (i, j)
        for i in range(n)
        for j in range(i + 1, n)
        if math.dist(position[i], position[j]) < reach
    ]
    first, second = pairs(position, reach)
    assert sorted(zip(first.tolist(), second.tolist(), strict=True)) == expected


@given(st.integers(2, 2 * MANY), st.integers(0, 1000))
def test_the_least_distance_is_that_of_the_nearest_two(n: int, seed: int) -> None:
    position = np.random.default_rng(seed).uniform(-3, 3, (n, 3))
    expected = min(math.dist(position[i], position[j]) for i in range(n) for j in range(i))
    assert least(position) == pytest.approx(expected)


@pytest.mark.parametrize("n", [3, MANY + 1])
def test_who_is_nowhere_is_near_nobody(n: int) -> None:
    position = np.zeros((n, 3))
    position[1:] = np.nan
    assert least(position) == math.inf
    assert not len(pairs(position, 1.0)[0])


@pytest.mark.parametrize("n", [2, MANY])
def test_two_at_the_reach_are_no_pair(n: int) -> None:
    position = np.arange(n)[:, None] * [1.0, 0.0, 0.0]
    assert not len(pairs(position, 1.0)[0])
    assert len(pairs(position, np.nextafter(1.0, 2.0))[0]) == n - 1
