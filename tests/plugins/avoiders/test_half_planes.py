"""A half-plane is bounded by the velocity obstacle's nearest way out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from star_core import Array
from star_core.toolkit import YIELD_TIME
from star_orca.half_planes import WIDE, half_planes
from star_orca.neighbours import CLIMB, COLUMNS, GOAL_X, GOAL_Y, MARGIN

HORIZON, PERIOD, RADIUS, VERTICAL = 2.0, 0.1, 0.2, 0.6
APART = 2 * RADIUS
WIDE_TIME = 60.0  # s

Vector = tuple[float, float]
vectors = st.tuples(st.floats(-3, 3), st.floats(-3, 3))


def plane(
    away: Vector,
    mine: Vector,
    theirs: Vector,
    *,
    avoids: bool = True,
    above: float = 0.0,
    climb: float = 0.0,
    margin: float = 0.0,
    goals: float = math.nan,
) -> Array:
    """The half-plane of an agent at the origin beside one at `away`, `above` it, climbing."""
    agents = np.zeros((2, COLUMNS))
    agents[:, : CLIMB + 1] = [
        [0, 0, 0, *mine, RADIUS + margin, 1, 0, 0],
        [*away, above, *theirs, RADIUS + margin, avoids, 1, climb],
    ]
    agents[:, MARGIN] = margin
    agents[:, GOAL_X], agents[1, GOAL_Y] = 5.0, goals
    planes = np.empty((1, 3))
    half_planes(agents, 0, np.array([1]), 1, HORIZON, PERIOD, VERTICAL, WIDE_TIME, planes, 0)
    (only,) = planes
    return np.asarray(only)


def nearest_approach(away: Array, closing: Array, horizon: float) -> float:
    """How near two agents come within `horizon`, m."""
    speed = float(closing @ closing)
    time = min(max(float(away @ closing) / speed, 0.0), horizon) if speed > 0 else 0.0
    return float(np.linalg.norm(away - closing * time))


def way_out(away: Vector, mine: Vector, theirs: Vector) -> tuple[Array, float]:
    """Direction and length of the change of relative velocity; negative where there is room."""
    a, b, c = plane(away, mine, theirs)
    return np.array([a, b]), 2 * (c - a * mine[0] - b * mine[1])


@given(vectors, vectors, vectors)
def test_full_changes_of_separate_agents_pass_at_the_radii(
    away: Vector, mine: Vector, theirs: Vector
) -> None:
    assume(np.hypot(*away) > APART + 1e-3)
    direction, length = way_out(away, mine, theirs)
    closing = np.subtract(mine, theirs) + length * direction
    assert nearest_approach(np.array(away), closing, HORIZON) == pytest.approx(APART, abs=1e-6)


@given(vectors, vectors, vectors)
def test_no_lesser_change_in_any_direction_would_do(
    away: Vector, mine: Vector, theirs: Vector
) -> None:
    assume(np.hypot(*away) > APART + 1e-3)
    _, length = way_out(away, mine, theirs)
    assume(abs(length) > 1e-3)
    closing = np.subtract(mine, theirs)
    for angle in np.linspace(0, 2 * np.pi, 64):
        changed = closing + 0.999 * abs(length) * np.array([np.cos(angle), np.sin(angle)])
        collides = nearest_approach(np.array(away), changed, HORIZON) < APART
        assert collides == (length > 0)


@given(vectors, vectors, vectors)
def test_agents_that_overlap_are_apart_after_one_period(
    away: Vector, mine: Vector, theirs: Vector
) -> None:
    near = (away[0] * 0.09, away[1] * 0.09)
    assume(0 < np.hypot(*near) < APART)
    direction, length = way_out(near, mine, theirs)
    closing = np.subtract(mine, theirs) + length * direction
    assert np.linalg.norm(near - PERIOD * closing) == pytest.approx(APART, abs=1e-9)


@given(vectors, vectors, vectors)
def test_the_normal_has_length_one(away: Vector, mine: Vector, theirs: Vector) -> None:
    assume(abs(np.hypot(*away) - APART) > 1e-6)
    assert np.hypot(*plane(away, mine, theirs)[:2]) == pytest.approx(1.0, abs=1e-9)


def test_beside_one_that_does_not_avoid_the_whole_change_is_mine() -> None:
    away, mine, theirs = (2.0, 0.3), (0.8, 0.0), (-0.5, 0.0)
    half, full = plane(away, mine, theirs), plane(away, mine, theirs, avoids=False)
    own = half[0] * mine[0] + half[1] * mine[1]
    assert full[:2] == pytest.approx(half[:2])
    assert full[2] - own == pytest.approx(2 * (half[2] - own))


def test_one_dead_ahead_is_passed_on_the_right() -> None:
    a, b, _ = plane((1.0, 0.0), (1.0, 0.0), (0.0, 0.0))
    assert a < 0
    assert b < 0


def test_agents_at_one_point_that_fly_alike_part_along_x() -> None:
    mine = plane((0.0, 0.0), (0.3, 0.1), (0.3, 0.1))
    assert mine == pytest.approx([1.0, 0.0, 0.3 + 0.5 * APART / PERIOD])


def test_agents_meeting_within_a_period_part_along_their_line() -> None:
    a, b, _ = plane((0.0, 0.2), (0.0, 2.0), (0.0, 0.0))
    assert (a, b) == pytest.approx((0.0, -1.0))


@pytest.mark.parametrize(
    ("above", "climb", "least"),
    [(0.3, 0.0, 0.3), (-0.3, 0.0, 0.3), (0.3, 0.1, 0.3), (0.5, -0.1, 0.3), (0.3, -0.2, 0.0)],
)
def test_half_planes_at_other_heights_use_the_ellipsoid_section(
    above: float, climb: float, least: float
) -> None:
    away, mine = (1.0, 0.1), (0.9, 0.0)  # through the ellipsoid, within the horizon
    a, b, c = plane(away, mine, (0.0, 0.0), avoids=False, above=above, climb=climb)
    closing = np.array(mine) + (c - a * mine[0] - b * mine[1]) * np.array([a, b])
    section = APART * np.sqrt(1 - (least / VERTICAL) ** 2)
    assert nearest_approach(np.array(away), closing, HORIZON) == pytest.approx(section)


def test_half_planes_require_no_change_at_the_ellipsoid_height() -> None:
    a, b, c = plane((1.0, 0.0), (0.9, 0.0), (0.0, 0.0), above=VERTICAL)
    assert a * 0.9 + b * 0.0 == pytest.approx(c)


def test_separate_agents_pass_at_radii_plus_margins() -> None:
    a, b, c = plane((2.0, 0.0), (0.5, 0.0), (-0.5, 0.0), margin=0.1)
    closing = np.array([1.0, 0.0]) + 2 * (c - a * 0.5) * np.array([a, b])
    assert nearest_approach(np.array([2.0, 0.0]), closing, HORIZON) == pytest.approx(APART + 0.2)


def test_within_the_margins_agents_may_still_come_nearer_slowly() -> None:
    a, b, c = plane((0.6, 0.0), (0.0, 0.0), (0.0, 0.0), margin=0.2)  # 0.2 m beyond the radii
    assert (a, b) == pytest.approx((-1.0, 0.0))
    assert -c == pytest.approx(0.2 / YIELD_TIME / 2)  # m/s, its half of the approach


@pytest.mark.parametrize(
    ("margin", "goals", "time"),
    [
        (0.2, 3.01 * APART, WIDE_TIME),
        (0.2, -3.01 * APART, WIDE_TIME),
        (0.2, 2.99 * APART, YIELD_TIME),  # nearer to each other than the widest margins
        (0.2, math.nan, YIELD_TIME),  # the other stays
        (0.99 * WIDE / 2, 3.01 * APART, YIELD_TIME),
    ],
)
def test_wide_margins_hardly_yield_on_ways_to_goals_apart(
    margin: float, goals: float, time: float
) -> None:
    beyond = margin  # half of the margins of both
    away = (APART + beyond, 0.0)
    a, b, c = plane(away, (0.0, 0.0), (0.0, 0.0), margin=margin, goals=goals)
    assert (a, b) == pytest.approx((-1.0, 0.0))
    assert -c == pytest.approx(beyond / time / 2)


def test_no_agent_is_pushed_away_for_a_margin() -> None:
    for distance in (APART + 1e-6, 0.5, 0.6):
        assert plane((distance, 0.0), (0.0, 0.0), (0.0, 0.0), margin=0.2)[2] <= 0.0
