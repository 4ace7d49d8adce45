"""Which agents are near each other, along the longer side of the swarm and by all pairs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core.geometry.neighbours import MANY, Pairs


@given(
    st.integers(0, 2 * MANY), st.integers(0, 1000), st.floats(0.05, 3.0), st.sampled_from([1, 5])
)
def test_pairs_are_those_that_are_nearer_than_the_reach(
    n: int, seed: int, reach: float, length: int
) -> None:
    position = np.random.default_rng(seed).uniform(-3, 3, (n, 3)) * [1, length, 1]
    expected = [
        (i, j)
        for i in range(n)
        for j in range(i + 1, n)
        if math.dist(position[i], position[j]) < reach
    ]
    near = Pairs.of(position, reach)
    assert sorted(zip(near.first.tolist(), near.second.tolist(), strict=True)) == expected
    assert near.distance == pytest.approx(
        [math.dist(position[i], position[j]) for i, j in zip(near.first, near.second, strict=True)]
    )


@given(st.integers(0, 2 * MANY), st.integers(0, 1000), st.floats(0.05, 3.0))
def test_a_wider_search_holds_the_narrower_one(n: int, seed: int, reach: float) -> None:
    position = np.random.default_rng(seed).uniform(-3, 3, (n, 3))
    wide, narrow = Pairs.of(position, 4.0).within(reach), Pairs.of(position, reach)
    assert wide.first.tolist() == narrow.first.tolist()
    assert wide.second.tolist() == narrow.second.tolist()


@pytest.mark.parametrize("n", [3, MANY + 1])
def test_an_agent_without_a_position_is_in_no_pair(n: int) -> None:
    position = np.zeros((n, 3))
    position[1:] = np.nan
    assert not len(Pairs.of(position, 1.0).first)


@pytest.mark.parametrize("n", [2, MANY])
def test_two_at_the_reach_are_no_pair(n: int) -> None:
    position = np.arange(n)[:, None] * [1.0, 0.0, 0.0]
    assert not len(Pairs.of(position, 1.0).first)
    assert len(Pairs.of(position, np.nextafter(1.0, 2.0)).first) == n - 1


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_infinite_positions_are_in_no_pair_and_hide_none(axis: int) -> None:
    position = np.random.default_rng(axis).uniform(-3, 3, (2 * MANY, 3))
    position[::5, axis], position[::7, axis] = np.inf, -np.inf
    finite = np.flatnonzero(np.isfinite(position).all(axis=1))
    near, alone = Pairs.of(position, 1.0), Pairs.of(position[finite], 1.0)
    pairs = zip(finite[alone.first].tolist(), finite[alone.second].tolist(), strict=True)
    assert sorted(zip(near.first.tolist(), near.second.tolist(), strict=True)) == sorted(pairs)
