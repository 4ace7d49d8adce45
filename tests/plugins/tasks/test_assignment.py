"""Which agent goes to which place."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from star_core import Array
from star_verbs.assignment import assign


def total(position: Array, place: Array) -> float:
    return float(np.linalg.norm(position - place, axis=1).sum())


@given(st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_the_distances_flown_add_up_to_the_least_there_is(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    position, place = rng.uniform(-5, 5, (n, 3)), rng.uniform(-5, 5, (n, 3))
    mine = assign(position, place)
    assert sorted(mine) == list(range(n))
    least = min(total(position, place[list(order)]) for order in permutations(range(n)))
    assert total(position, place[mine]) <= least + 1e-3


@given(st.permutations(range(8)))
def test_agents_that_stand_on_the_places_stay(order: list[int]) -> None:
    place = np.random.default_rng(0).uniform(-5, 5, (8, 3))
    assert assign(place[order], place).tolist() == order


def test_agents_in_a_row_do_not_overtake_each_other() -> None:
    line = np.arange(4.0)[:, None] * [1.0, 0.0, 0.0]
    ahead = line + np.array([10.0, 0.0, 0.0])
    assert assign(line, ahead).tolist() == [0, 1, 2, 3]
    assert assign(line, ahead[::-1]).tolist() == [3, 2, 1, 0]
