"""Agents that follow velocities with a lag, and fly what the avoiders return: none collide."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import pytest

from star_core import Array, Avoider, Goals, Limits, Obstacle, Scene, Setpoint
from star_core.contracts import NotesGoals
from star_core.testing import estimate, scene
from star_core.toolkit import fill_defaults

SPEED, LAG, CONTACT = 0.5, 0.25, 0.12  # m/s, s, m
Polygon = tuple[tuple[float, float], ...]


def box(left: float, low: float, right: float, high: float) -> Polygon:
    return ((left, low), (right, low), (right, high), (left, high))


class Flown(NamedTuple):
    """How a flight went: lengths in m."""

    separation: float
    clearance: float
    missing: Array


def room(n: int, *polygons: Polygon, top: float = 3.0) -> Scene:
    empty = scene(n, limits=Limits(speed=SPEED))
    things = (Obstacle(f"wall {i}", (piece,), (0.0, top)) for i, piece in enumerate(polygons))
    return replace(empty, world=replace(empty.world, obstacles=tuple(things)))


def made(name: str, around: Scene, **options: Any) -> Avoider:
    (offer,) = import_module(f"star_{name}").star_avoiders()
    part = offer.make(around, **fill_defaults(options, offer.options))
    assert isinstance(part, Avoider)
    return part


def fly(
    avoider: Avoider, around: Scene, start: Array, goal: Array, seconds: float, std: float = 0.0
) -> Flown:
    """Fly straight towards the goals, with positions of a standard deviation, m.

    The flight is over when all agents hover at their goals, or after so many seconds.
    """
    n = len(start)
    position, velocity = start.copy(), np.zeros_like(start)
    separation = clearance = np.inf
    if isinstance(avoider, NotesGoals):
        zero = np.zeros(n)
        avoider.note_goals(Goals(goal, 0 * goal, zero, zero + SPEED, np.ones(n, np.bool_)))
    for _ in range(int(seconds / around.period)):
        way = goal - position
        distance = np.linalg.norm(way, axis=1, keepdims=True)
        wish = way * np.minimum(1.5, SPEED / np.maximum(distance, 1e-9))
        planned = Setpoint(wish, np.zeros(n), np.ones(n, np.bool_))
        now = estimate(position, velocity=velocity)
        now = replace(now, covariance=np.tile(std**2 * np.eye(3), (n, 1, 1)))
        safe_velocity = avoider.avoid(now, planned).velocity
        assert np.linalg.norm(safe_velocity, axis=1).max() <= SPEED + 1e-9
        for _ in range(5):
            velocity = velocity + (safe_velocity - velocity) * (around.period / 5 / LAG)
            position = position + velocity * (around.period / 5)
        apart = np.linalg.norm(position[:, None] - position, axis=2) + 9 * np.eye(n)
        separation = min(separation, float(apart.min()))
        clearance = min(clearance, *(clear(around, point) for point in position))
        if np.linalg.norm(goal - position, axis=1).max() < 0.03 and np.abs(velocity).max() < 0.02:
            break
    return Flown(separation, clearance, np.linalg.norm(goal - position, axis=1))


def clear(around: Scene, point: Array) -> float:
    """How far a point is from the nearest box at its height, m."""
    least = np.inf
    for thing in around.world.obstacles:
        if point[2] <= thing.height[1]:
            corners = np.array(thing.polygons[0])
            beyond = np.maximum(corners.min(axis=0) - point[:2], point[:2] - corners.max(axis=0))
            least = min(least, float(np.linalg.norm(np.maximum(beyond, 0.0))))
    return least


def circle(n: int) -> Array:
    angle = 2 * np.pi * np.arange(n) / n
    radius = max(1.5, 0.6 * n / (2 * np.pi))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, 0.8)], axis=1)


all_avoiders = pytest.mark.parametrize("name", ["orca", "voronoi", "potential"])
those_that_promise = pytest.mark.parametrize("name", ["orca", "voronoi"])


@pytest.mark.parametrize(("name", "n"), [("orca", 8), ("orca", 16), ("orca", 32), ("voronoi", 8)])
def test_swaps_across_a_circle_arrive_without_collision(name: str, n: int) -> None:
    around, start = room(n), circle(n)
    flown = fly(made(name, around), around, start, start * [-1, -1, 1], 60.0)
    assert flown.separation > 2 * CONTACT
    assert flown.missing.max() < 0.15


def test_orca_passes_closer_to_agents_at_other_heights() -> None:
    around, height = room(2), 0.3
    start = np.array([[-1.5, 0.0, 0.8], [1.5, 0.02, 0.8 + height]])
    flown = fly(made("orca", around), around, start, start * [-1, 1, 1], 15.0)
    aside = 0.4 * np.sqrt(1 - (height / around.limits.vertical_separation) ** 2)
    assert np.hypot(aside, height) - 0.01 < flown.separation < np.hypot(0.4, height) - 0.02
    assert flown.missing.max() < 0.1


@pytest.mark.parametrize("gap", [0.22, 0.3])
@pytest.mark.parametrize("x", [0.0, 0.3])
def test_potential_reaches_goals_beside_obstacles(gap: float, x: float) -> None:
    around = room(1, box(-0.3, -0.3, 0.3, 0.3))
    start, goal = np.array([[-1.5, 0.9, 0.8]]), np.array([[x, 0.3 + gap, 0.8]])
    flown = fly(made("potential", around), around, start, goal, 30.0)
    assert flown.missing.max() < 0.05
    assert flown.clearance > gap - 0.05


@pytest.mark.parametrize(
    "hovering",
    [
        [(0.0, 0.0)],
        [(0.0, 0.35), (0.0, -0.35)],
        [(0.0, 0.6 * k) for k in range(-3, 4)],
        [(0.5, 0.0), (0.2, 0.6), (0.2, -0.6), (-0.4, 0.7), (-0.4, -0.7)],  # open where it comes
    ],
)
def test_voronoi_leads_around_agents_that_hover(hovering: list[tuple[float, float]]) -> None:
    start = np.array([(x, y, 0.8) for x, y in [(-1.5, 0.0), *hovering]])
    goal = start + [[4.0, 0.0, 0.0]] * (np.arange(len(start)) == 0)[:, None]
    around = room(len(start))
    flown = fly(made("voronoi", around), around, start, goal, 40.0)
    assert flown.separation > 0.4
    assert flown.missing.max() < 0.05


def test_voronoi_waits_near_a_goal_that_others_enclose() -> None:
    ring = 0.6 * circle(6)[:, :2] / 1.5
    start = np.array([(x, y, 0.8) for x, y in [(-1.5, 0.0), *ring]])
    goal = start * (np.arange(len(start)) > 0)[:, None] + [0.0, 0.0, 0.8] * np.eye(7)[:, :1]
    around = room(len(start))
    flown = fly(made("voronoi", around), around, start, goal, 60.0)
    assert flown.separation > 0.4
    assert 0.6 < flown.missing[0] < 1.1


@all_avoiders
def test_a_wall_ahead_is_not_touched(name: str) -> None:
    around = room(2, box(0.0, -3.0, 0.2, 3.0))
    start = np.array([[-1.5, 0.0, 0.8], [-1.5, 1.0, 0.8]])
    flown = fly(made(name, around), around, start, start * [-1, 1, 1], 10.0)
    assert flown.clearance > CONTACT


@pytest.mark.parametrize("obstacles", ["half-planes", "virtual-agents"])
def test_orca_keeps_wall_clearance_for_all_obstacle_models(obstacles: str) -> None:
    around = room(1, box(0.0, -3.0, 0.2, 3.0))
    avoider = made("orca", around, obstacles=obstacles, clearance=0.3)
    flown = fly(avoider, around, np.array([[-1.5, -1.0, 0.8]]), np.array([[1.5, 0.7, 0.8]]), 10.0)
    assert flown.clearance > 0.27


@all_avoiders
def test_a_wall_below_is_flown_over(name: str) -> None:
    around = room(1, box(0.0, -3.0, 0.2, 3.0), top=0.6)
    start = np.array([[-1.0, 0.0, 0.8]])
    flown = fly(made(name, around), around, start, start * [-1, 1, 1], 10.0)
    assert flown.missing.max() < 0.05


@those_that_promise
@pytest.mark.parametrize(
    ("walls", "x", "seconds"),
    [
        pytest.param(((-3.0, 0.8, 3.0, 1.0), (-3.0, -1.0, 3.0, -0.8)), 1.5, 30.0, id="corridor"),
        pytest.param(((-0.1, 0.5, 0.1, 4.0), (-0.1, -4.0, 0.1, -0.5)), 1.2, 40.0, id="doorway"),
    ],
)
def test_agents_that_meet_between_walls_pass_each_other(
    name: str, walls: tuple[tuple[float, float, float, float], ...], x: float, seconds: float
) -> None:
    around = room(2, *(box(*wall) for wall in walls))
    start = np.array([[-x, 0.0, 0.8], [x, 0.0, 0.8]])
    flown = fly(made(name, around), around, start, start * [-1, 1, 1], seconds)
    assert min(flown.separation, flown.clearance) > CONTACT
    assert flown.missing.max() < 0.15


@those_that_promise
def test_agents_stacked_at_one_place_change_heights(name: str) -> None:
    around, start = room(2), np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 1.2]])
    flown = fly(made(name, around), around, start, start[::-1], 40.0)
    assert flown.separation > 2 * CONTACT
    assert flown.missing.max() < 0.15


@all_avoiders
def test_an_agent_that_takes_off_is_given_way_to(name: str) -> None:
    around = room(2)
    avoider = made(name, around)
    position, velocity = np.array([[0.0, 0.0, 0.0], [-0.8, 0.0, 0.8]]), np.zeros((2, 3))
    nearest = np.inf
    for _ in range(100):
        velocity[0] = [0.0, 0.0, 0.4 if position[0, 2] < 0.8 else 0.0]
        wish = np.array([[0.0, 0, 0], [0.4, 0.0, 0.0]])
        planned = Setpoint(wish, np.zeros(2), np.array([False, True]))
        safe = avoider.avoid(estimate(position, velocity=velocity), planned)
        assert safe.active.tolist() == [False, True]
        velocity[1] += (safe.velocity[1] - velocity[1]) * (around.period / LAG)
        position = position + velocity * around.period
        nearest = min(nearest, float(np.linalg.norm(position[0] - position[1])))
    assert nearest > 2 * CONTACT


@all_avoiders
def test_one_that_stands_far_below_is_in_nothings_way(name: str) -> None:
    now = estimate(np.array([[0.0, 0.0, 0.0], [-0.3, 0.0, 1.0]]))
    wish = np.array([[0.0, 0, 0], [0.4, 0.0, 0.0]])
    planned = Setpoint(wish, np.zeros(2), np.array([False, True]))
    answer = made(name, room(2)).avoid(now, planned).velocity
    assert answer[1, 0] == pytest.approx(0.4, rel=0.05)
    assert (answer[0] == wish[0]).all()


@all_avoiders
def test_a_swarm_of_nothing_is_no_trouble(name: str) -> None:
    nothing = Setpoint(np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.bool_))
    assert len(made(name, room(0)).avoid(estimate(np.zeros((0, 3))), nothing).velocity) == 0


@all_avoiders
def test_two_at_one_point_part(name: str) -> None:
    start, planned = np.zeros((2, 3)), Setpoint(np.zeros((2, 3)), np.zeros(2), np.ones(2, np.bool_))
    answer = made(name, room(2)).avoid(estimate(start), planned).velocity
    assert answer[0, 0] > 0 > answer[1, 0]


@pytest.mark.parametrize("name", ["voronoi", "potential"])
@pytest.mark.parametrize("seed", range(5))
def test_answers_are_invariant_to_rotation_shift_and_row_order(name: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    position, wish = random.uniform(-1, 1, (8, 3)), random.uniform(-0.3, 0.3, (8, 3))
    around, all_of_them = room(8), np.ones(8, np.bool_)
    avoider = made(name, around)

    def ask(position: Array, wish: Array) -> Array:
        planned = Setpoint(wish, np.zeros(8), all_of_them)
        return avoider.avoid(estimate(position), planned).velocity

    expected, order = ask(position, wish), random.permutation(8)
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    assert ask(position + np.array([3, -4, 0.1]), wish) == pytest.approx(expected, abs=1e-6)
    assert ask(position[order], wish[order]) == pytest.approx(expected[order], abs=1e-6)
    assert ask(position @ turn.T, wish @ turn.T) == pytest.approx(expected @ turn.T, abs=1e-6)


def test_nothing_is_compiled_in_flight() -> None:
    from star_voronoi.avoider import within

    kernel: Any = within
    avoider = made("voronoi", room(3, box(0.5, 0.5, 0.7, 0.7)))
    count = len(kernel.signatures)
    for order in ("C", "F"):
        wish = np.asarray(np.ones((3, 3)), order=order)
        planned = Setpoint(wish, np.zeros(3), np.ones(3, np.bool_))
        avoider.avoid(estimate(np.asarray(np.eye(3), order=order)), planned)
    assert len(kernel.signatures) == count


@pytest.mark.parametrize("name", ["orca", "voronoi", "potential"])
def test_uncertain_positions_increase_the_passing_distance(name: str) -> None:
    around, start = room(2), np.array([[-1.5, 0.0, 0.8], [1.5, 0.02, 0.8]])
    exact, uncertain = (
        fly(made(name, around), around, start, start * [-1, 1, 1], 20.0, std=std)
        for std in (0.0, 0.1)
    )
    assert uncertain.separation > exact.separation + 0.1
    assert max(exact.missing.max(), uncertain.missing.max()) < 0.1 or name == "potential"


@pytest.mark.parametrize("n", [2, 4, 6])
def test_uncertain_agents_that_cross_keep_most_of_their_margins(n: int) -> None:
    around, start, std = room(n), circle(n) * [1.5, 1.5, 1.0], 0.15
    flown = fly(made("orca", around), around, start, start * [-1, -1, 1], 40.0, std=std)
    assert flown.separation > 0.4 + 0.6 * 2 * 2 * std
    assert flown.missing.max() < 0.1


def test_uncertain_agents_pass_between_others_that_hover() -> None:
    around = room(3)
    start = np.array([[-1.5, 0.0, 0.8], [0.0, 0.8, 0.8], [0.0, -0.8, 0.8]])
    goal = start * [[-1, 1, 1], [1, 1, 1], [1, 1, 1]]
    assert fly(made("orca", around), around, start, goal, 10.0, std=0.2).missing.max() < 0.1


@pytest.mark.parametrize("name", ["orca", "voronoi"])
def test_agents_reach_goals_near_to_each_other_however_uncertain(name: str) -> None:
    around, start = room(2), np.array([[-1.5, 0.0, 0.8], [1.5, 0.0, 0.8]])
    goal = np.array([[-0.25, 0.0, 0.8], [0.25, 0.0, 0.8]])
    flown = fly(made(name, around, radius=0.15), around, start, goal, 30.0, std=2.0)
    assert flown.missing.max() < 0.1


@pytest.mark.parametrize("name", ["orca", "voronoi", "potential"])
def test_uncertain_agents_keep_farther_from_walls_that_they_pass(name: str) -> None:
    around = room(1, box(-0.5, -2.0, 0.5, 0.0))
    start, goal = np.array([[-1.5, 0.22, 0.8]]), np.array([[1.5, 0.22, 0.8]])
    exact, uncertain = (
        fly(made(name, around), around, start, goal, 20.0, std=std) for std in (0.0, 0.1)
    )
    assert uncertain.clearance > exact.clearance + 0.01
    assert uncertain.missing.max() < 0.1


@pytest.mark.parametrize("name", ["orca", "voronoi"])
def test_uncertain_agents_still_reach_goals_near_walls(name: str) -> None:
    around, start = room(1, box(0.0, -2.0, 1.0, 2.0)), np.array([[-1.5, 0.0, 0.8]])
    goal = np.array([[-0.25, 0.0, 0.8]])
    assert fly(made(name, around), around, start, goal, 20.0, std=2.0).missing.max() < 0.1
