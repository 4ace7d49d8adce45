"""The avoider `orca` between the swarm's tables, and agents that fly what it answers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import star_orca
from star_core import Array, Avoider, AvoiderSpec, Limits, Problem, Scene, Setpoint
from star_core.testing import estimate, scene
from star_core.toolkit import fill_defaults
from star_orca.avoider import Orca

SPEED = 0.5
HEAD_ON = np.array([[-0.4, 0.0, 0.8], [0.4, 0.0, 0.8]])
TOWARDS_EACH_OTHER = np.array([[0.4, 0.0, 0.1], [-0.4, 0.0, -0.1]])


def offer() -> AvoiderSpec:
    (only,) = star_orca.star_avoiders()
    return only


def orca(room: Scene, **options: Any) -> Avoider:
    """Return the avoider with these options, and the defaults of the schema for the others."""
    return offer().make(room, **fill_defaults(options, offer().options))


def setpoint(velocity: Array, active: tuple[bool, ...] | None = None) -> Setpoint:
    n = len(velocity)
    return Setpoint(
        velocity, np.arange(float(n)), np.ones(n, np.bool_) if active is None else np.array(active)
    )


def fly(start: Array, goal: Array, *, seconds: float = 60.0, radius: float = 0.2) -> float:
    """Fly points without mass or noise to their goals, and return how near two of them came, m.

    Raises:
        TimeoutError: They are not all within 5 cm of their goals in `seconds`.
    """
    room = scene(len(start), limits=Limits(speed=SPEED))
    avoider = orca(room, radius=radius, response=0.0)  # points without mass
    position, velocity, nearest = start, np.zeros_like(start), np.inf
    for _ in range(int(seconds / room.period)):
        way = goal - position
        distance = np.linalg.norm(way, axis=1, keepdims=True)
        if distance.max() < 0.05:
            return float(nearest)
        wish = way * np.minimum(SPEED / np.maximum(distance, 1e-9), 1.0)
        velocity = avoider.avoid(estimate(position, velocity=velocity), setpoint(wish)).velocity
        position = position + room.period * velocity
        apart = np.linalg.norm(position[:, None] - position, axis=2)  # (N, N)
        nearest = min(nearest, apart[~np.eye(len(start), dtype=bool)].min())
    raise TimeoutError(f"still {distance.max():.2f} m to go after {seconds} s")


def circle(n: int, radius: float) -> Array:
    angle = 2 * np.pi * np.arange(n) / n
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, 0.8)], axis=1)


@pytest.mark.parametrize("n", [2, 3, 4, 5, 8, 16])
def test_exact_swaps_across_a_circle_resolve(n: int) -> None:
    start = circle(n, max(1.5, n / 4))
    assert fly(start, start * [-1, -1, 1]) >= 0.4 - 1e-3


def test_parked_agents_are_passed() -> None:
    start = np.array([[-1.5, 0.0, 0.8], [0.0, 0.0, 0.8]])
    assert fly(start, start * [-1, 1, 1]) >= 0.4 - 1e-3


def test_a_wider_radius_keeps_agents_further_apart() -> None:
    start = circle(2, 1.5)
    assert fly(start, start * [-1, -1, 1], radius=0.35) >= 0.7 - 1e-3


def test_unsure_agents_are_avoided_as_wider_ones() -> None:
    spread = np.diag(np.square([0.06, 0.06, 0.0]))[None]
    now = estimate(HEAD_ON * [2, 1, 1], velocity=TOWARDS_EACH_OTHER)
    uncertain = replace(now, covariance=np.concatenate([spread, 0 * spread]))
    wish = setpoint(TOWARDS_EACH_OTHER)
    enlarged = orca(scene(2), radius=0.2, uncertainty_margin=2.0).avoid(uncertain, wish)
    wider = orca(scene(2), radius=0.2 + 0.06, uncertainty_margin=0.0).avoid(
        now, wish
    )  # each by half of what one is off
    assert enlarged.velocity == pytest.approx(wider.velocity)
    exact = orca(scene(2), radius=0.2, uncertainty_margin=0.0).avoid(uncertain, wish)
    assert not np.allclose(exact.velocity, enlarged.velocity)


def test_default_radius_includes_the_uncertainty_margin() -> None:
    now = estimate(HEAD_ON, velocity=TOWARDS_EACH_OTHER)
    now = replace(now, covariance=np.tile(np.diag([0.0036, 0.0036, 0.0]), (2, 1, 1)))
    wish, exact = setpoint(TOWARDS_EACH_OTHER), Limits(uncertainty_margin=0.0)
    by_default = orca(scene(2)).avoid(now, wish).velocity
    assert by_default == pytest.approx(
        orca(scene(2), uncertainty_margin=2.0).avoid(now, wish).velocity
    )
    treated = orca(scene(2, limits=exact)).avoid(now, wish).velocity
    assert treated == pytest.approx(
        orca(scene(2), uncertainty_margin=0.0).avoid(now, wish).velocity
    )
    assert not np.allclose(by_default, treated)


def test_agents_that_do_not_avoid_are_passed() -> None:
    room = scene(2, limits=Limits(speed=SPEED))
    avoider, position = orca(room, response=0.0), np.array([[-1.0, 0.0, 0.8], [0.0, 0.0, 0.8]])
    velocity, nearest = np.zeros((2, 3)), np.inf
    for _ in range(int(15 / room.period)):
        way = np.array([1.5, 0.0, 0.8]) - position[0]
        wish = np.array([way * min(SPEED / np.linalg.norm(way), 1.0), np.zeros(3)])
        safe = avoider.avoid(estimate(position, velocity=velocity), setpoint(wish, (True, False)))
        velocity = safe.velocity
        position = position + room.period * velocity
        nearest = min(nearest, float(np.linalg.norm(position[0] - position[1])))
    assert np.linalg.norm(position[0] - [1.5, 0.0, 0.8]) < 0.05
    assert nearest >= 0.4 - 1e-3


def test_heights_headings_and_climbs_pass_through() -> None:
    wish = setpoint(TOWARDS_EACH_OTHER)
    safe = orca(scene(2)).avoid(estimate(HEAD_ON, velocity=TOWARDS_EACH_OTHER), wish)
    assert (safe.velocity[:, 2] == wish.velocity[:, 2]).all()
    assert (safe.yaw == wish.yaw).all()
    assert not np.allclose(safe.velocity[:, :2], wish.velocity[:, :2])


def test_agents_one_above_the_other_do_not_avoid_each_other() -> None:
    above = HEAD_ON + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.7]])
    level = TOWARDS_EACH_OTHER * [1, 1, 0]
    now, wish = estimate(above, velocity=level), setpoint(level)
    assert (orca(scene(2)).avoid(now, wish).velocity == wish.velocity).all()
    wider = scene(2, limits=Limits(vertical_separation=0.8))
    assert (orca(wider).avoid(now, wish).velocity != wish.velocity).any()


def test_empty_is_sent_faster_than_the_scene_allows() -> None:
    wish = setpoint(np.array([[3.0, 4.0, 0.0]]))
    safe = orca(scene(1, limits=Limits(speed=0.7)), response=0.0).avoid(estimate(HEAD_ON[:1]), wish)
    assert np.linalg.norm(safe.velocity) == pytest.approx(0.7)


@pytest.mark.parametrize("speed", [0.5, 0.7])
def test_reversals_respect_the_acceleration_limit(speed: float) -> None:
    room = scene(1, limits=Limits(speed=SPEED, acceleration=2.0))
    now = estimate(np.array([[0.0, 0.0, 0.8]]), velocity=np.array([[speed, 0.0, 0.0]]))
    asked = orca(room, response=0.2).avoid(now, setpoint(np.array([[-SPEED, 0.0, 0.0]]))).velocity
    np.testing.assert_allclose(asked, [[min(speed - 2.0 * 0.2, SPEED), 0.0, 0.0]])
    slower = estimate(np.array([[0.0, 0.0, 0.8]]), velocity=np.array([[-0.2, 0.0, 0.0]]))
    asked = (
        orca(room, response=0.2).avoid(slower, setpoint(np.array([[-SPEED, 0.0, 0.0]]))).velocity
    )
    np.testing.assert_allclose(asked, [[-SPEED, 0.0, 0.0]])  # within reach: to the bit


def test_overspeed_agents_are_still_limited_to_their_speed() -> None:
    room = scene(1, limits=Limits(speed=SPEED, acceleration=0.1))
    now = estimate(np.array([[0.0, 0.0, 0.8]]), velocity=np.array([[0.9, 0.0, 0.0]]))
    asked = orca(room).avoid(now, setpoint(np.array([[0.0, SPEED, 0.0]]))).velocity
    assert np.linalg.norm(asked) == pytest.approx(SPEED)


def test_inactive_rows_are_unchanged_and_avoided_fully() -> None:
    now, avoider = estimate(HEAD_ON, velocity=TOWARDS_EACH_OTHER), orca(scene(2), response=0.0)
    both = avoider.avoid(now, setpoint(TOWARDS_EACH_OTHER))
    alone = avoider.avoid(now, setpoint(TOWARDS_EACH_OTHER, (True, False)))
    assert (alone.velocity[1] == TOWARDS_EACH_OTHER[1]).all()
    assert alone.active.tolist() == [True, False]
    change = np.linalg.norm([both.velocity[0], alone.velocity[0]] - TOWARDS_EACH_OTHER[0], axis=1)
    assert change[1] > 1.5 * change[0]


def test_invalid_rows_are_unchanged_and_avoided_fully() -> None:
    now, avoider = estimate(HEAD_ON, velocity=TOWARDS_EACH_OTHER), orca(scene(2), response=0.0)
    unknown = avoider.avoid(
        replace(now, valid=np.array([True, False])), setpoint(TOWARDS_EACH_OTHER)
    )
    inactive = avoider.avoid(now, setpoint(TOWARDS_EACH_OTHER, (True, False)))
    assert (unknown.velocity == inactive.velocity).all()
    assert unknown.active.all()


def test_a_row_whose_place_is_not_known_is_in_emptys_way() -> None:
    position = HEAD_ON.copy()
    position[1] = np.nan
    now = replace(estimate(position), valid=np.array([True, False]))
    wish = setpoint(TOWARDS_EACH_OTHER)
    assert (orca(scene(2)).avoid(now, wish).velocity == wish.velocity).all()


def test_tables_in_column_order_are_answered_alike() -> None:
    now, avoider = estimate(HEAD_ON, velocity=TOWARDS_EACH_OTHER), orca(scene(2), response=0.0)
    columns = replace(now, position=np.asfortranarray(HEAD_ON))
    wish = setpoint(TOWARDS_EACH_OTHER)
    assert (avoider.avoid(columns, wish).velocity == avoider.avoid(now, wish).velocity).all()


def test_a_swarm_of_empty_is_no_trouble() -> None:
    empty = np.zeros((0, 3))
    assert len(orca(scene(0)).avoid(estimate(empty), setpoint(empty)).velocity) == 0


def test_the_offer_makes_the_avoider_with_whole_numbers_too() -> None:
    made = orca(scene(2), radius=1, horizon=2, communication_radius=4)
    assert isinstance(made, Orca)


def checked(**options: float) -> list[Problem]:
    """What the avoider's own check finds wrong with these options, and its defaults."""
    spec = offer()
    assert spec.check is not None
    return list(spec.check(scene(2), **fill_defaults(options, spec.options)))


def test_neighbours_must_be_seen_by_uncertain_agents_too() -> None:
    assert not checked(radius=0.2, communication_radius=1.1, uncertainty_margin=0.0)
    (problem,) = checked(radius=0.2, communication_radius=1.1)
    assert "1.2 m" in problem.message
    assert problem.warning


def test_a_communication_radius_within_the_radii_is_refused() -> None:
    (problem,) = checked(radius=0.5, communication_radius=0.9, uncertainty_margin=0.0)
    assert problem.path == ("communication_radius",)
    assert problem.message == (
        "0.9 m is not more than 1 m, the distance to keep between two agents: "
        "neighbours would be detected too late"
    )
    assert not checked()


def test_agents_on_trajectories_keep_velocities_that_need_no_avoiding() -> None:
    room = scene(2, limits=Limits(speed=SPEED))
    position = np.array([[0.0, 0.0, 0.8], [1.2, 0.0, 0.8]])
    aside = setpoint(np.array([[0.2, 0.4, 0.0], [0.2, 0.0, 0.0]]))
    still = np.zeros((2, 3))
    followed = replace(aside, position=position, acceleration=still)
    now = estimate(position, velocity=aside.velocity)
    turned = orca(room).avoid(now, aside).velocity
    kept = orca(room).avoid(now, followed).velocity
    assert abs(turned[0] - aside.velocity[0]).max() > 0.02  # by the rule of the road
    assert kept.tolist() == aside.velocity.tolist()
    towards = replace(
        setpoint(TOWARDS_EACH_OTHER), position=HEAD_ON, acceleration=still
    )  # which needs it
    avoided = orca(room).avoid(estimate(HEAD_ON, velocity=TOWARDS_EACH_OTHER), towards).velocity
    assert abs(avoided - TOWARDS_EACH_OTHER).max() > 0.1
