"""The linear programme answers what trying every corner answers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from star_core import Array
from star_orca.linear_program import solve

SPEED = 1.0

angles = st.floats(0, 2 * np.pi) | st.sampled_from([k * np.pi / 4 for k in range(8)])
offsets = st.floats(-1.5, 1.5) | st.sampled_from([-0.5, 0.0, 0.5])
planes_of = st.lists(st.tuples(angles, offsets), max_size=10).map(
    lambda rows: np.array([(np.cos(t), np.sin(t), c) for t, c in rows]).reshape(-1, 3)
)
wishes = st.tuples(st.floats(-2, 2), st.floats(-2, 2))


def solved(planes: Array, wish: tuple[float, float], hard: int = 0) -> Array:
    return np.array(solve(planes, len(planes), hard, SPEED, *wish, np.empty_like(planes)))


def worst(planes: Array, velocity: Array) -> float:
    """By how much the worst half-plane is broken, m/s; negative if none is."""
    broken = planes[:, 2] - planes[:, :2] @ velocity
    return float(broken.max(initial=-np.inf))


def on_circle(normal: Array, offset: float) -> Iterator[Array]:
    """Where the line ``normal · v = offset`` meets the greatest speed."""
    squared = float(normal @ normal)
    if squared > 0 and offset**2 <= SPEED**2 * squared:
        foot = normal * offset / squared
        along = np.array([normal[1], -normal[0]]) / np.sqrt(squared)
        half = np.sqrt(max(SPEED**2 - float(foot @ foot), 0.0))
        yield foot + half * along
        yield foot - half * along


def free_corners(planes: Array, wish: Array) -> Iterator[Array]:
    """Every point at which the free velocity nearest to the wish can be."""
    yield wish
    for a, b, c in planes:
        normal = np.array([a, b])
        yield wish + (c - normal @ wish) * normal
        yield from on_circle(normal, c)
    for first, second in combinations(planes, 2):
        if abs(np.linalg.det([first[:2], second[:2]])) > 1e-12:
            yield np.linalg.solve([first[:2], second[:2]], [first[2], second[2]])


def least_bad_corners(planes: Array) -> Iterator[Array]:
    """Every point at which the worst half-plane can be broken least."""
    for plane in planes:
        yield plane[:2] * SPEED
    for first, second in combinations(planes, 2):
        yield from on_circle((first - second)[:2], (first - second)[2])
    for first, second, third in combinations(planes, 3):
        both = np.array([first - second, first - third])
        if abs(np.linalg.det(both[:, :2])) > 1e-12:
            yield np.linalg.solve(both[:, :2], both[:, 2])


def least_bad(planes: Array) -> float:
    """By how much the worst half-plane must be broken, m/s; negative if there is room."""
    inside = (v for v in least_bad_corners(planes) if np.linalg.norm(v) <= SPEED + 1e-12)
    return min((worst(planes, velocity) for velocity in inside), default=-np.inf)


@given(planes_of, wishes)
def test_infeasible_programs_minimize_the_worst_violation(
    planes: Array, wish: tuple[float, float]
) -> None:
    assert worst(planes, solved(planes, wish)) <= max(least_bad(planes), 0.0) + 1e-7


@given(planes_of, planes_of, wishes)
def test_no_hard_half_plane_is_broken_for_the_sake_of_the_others(
    hard: Array, soft: Array, wish: tuple[float, float]
) -> None:
    assume(least_bad(hard) < -1e-3)
    answer = solved(np.concatenate([hard, soft]), wish, hard=len(hard))
    assert worst(hard, answer) <= 1e-7


def test_infeasible_hard_half_planes_are_relaxed_like_others() -> None:
    closing = np.array([[1.0, 0.0, 0.2], [-1.0, 0.0, 0.1]])
    assert solved(closing, (0.0, 0.4), hard=2)[0] == pytest.approx(0.05)


@given(planes_of, wishes)
def test_no_free_velocity_is_nearer_to_the_wish_cut_to_the_speed(
    planes: Array, desired: tuple[float, float]
) -> None:
    assume(least_bad(planes) < -1e-3)
    answer = solved(planes, desired)
    wish = np.array(desired) / max(float(np.hypot(*desired)) / SPEED, 1.0)
    assert worst(planes, answer) <= 1e-9
    nearest = min(
        float(np.linalg.norm(corner - wish))
        for corner in free_corners(planes, wish)
        if worst(planes, corner) <= 1e-9 and np.linalg.norm(corner) <= SPEED + 1e-9
    )
    assert np.linalg.norm(answer - wish) == pytest.approx(nearest, abs=1e-6)


@given(planes_of, wishes)
def test_no_answer_is_faster_than_allowed(planes: Array, wish: tuple[float, float]) -> None:
    assert np.linalg.norm(solved(planes, wish)) <= SPEED + 1e-12


def test_a_free_wish_is_answered_to_the_bit() -> None:
    planes = np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5]])
    assert tuple(solved(planes, (0.1, 0.7))) == (0.1, 0.7)


def test_between_walls_that_close_in_the_answer_is_in_the_middle() -> None:
    closing = np.array([[1.0, 0.0, 0.2], [-1.0, 0.0, 0.1]])
    x, y = solved(closing, (0.0, 0.4))
    assert x == pytest.approx(0.05)
    assert abs(y) <= SPEED


def test_the_same_half_plane_twice_is_no_contradiction() -> None:
    planes = np.tile([np.cos(0.3), np.sin(0.3), 0.4], (2, 1))
    assert worst(planes, solved(planes, (-0.2, 0.1))) <= 1e-12
