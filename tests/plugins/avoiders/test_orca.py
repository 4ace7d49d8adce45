"""The whole kernel: what it keeps, what it does not depend on, and what RVO2 answers."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from star_core import Array, Fence, Mask, Obstacle, World
from star_core.toolkit import YIELD_TIME
from star_orca.kernel import CROWD, WIDE_YIELD_TIME, orca
from star_orca.outlines import Outlines, outlines

RADIUS, SPEED, HORIZON, NEIGHBOUR_DISTANCE, MOST, PERIOD = 0.15, 1.0, 2.0, 2.0, 10, 0.1
seeds = st.integers(0, 2**32 - 1)
Polygon = tuple[tuple[float, float], ...]


def world(*polygons: Polygon, height: tuple[float, float] = (-1.0, 1.0)) -> World:
    things = (Obstacle(f"thing {i}", (polygon,), height) for i, polygon in enumerate(polygons))
    return World("room", Fence((-50.0, -50.0, 0.0), (50.0, 50.0, 3.0)), tuple(things))


NOTHING = outlines(world())
NO_FENCE = (-np.inf, -np.inf, np.inf, np.inf)


def ask(  # noqa: PLR0913 -- the kernel has more
    position: Array,
    velocity: Array,
    wish: Array,
    *,
    avoids: Mask | None = None,
    goal: Array | None = None,
    margin: float = 0.0,
    turn: float = 0.0,
    around: Outlines = NOTHING,
    virtual: bool = False,
    fence: tuple[float, ...] = NO_FENCE,
    kernel: Any = orca,
) -> Array:
    n = len(position)
    avoiding = np.ones(n, np.bool_) if avoids is None else avoids
    limits = (HORIZON, NEIGHBOUR_DISTANCE, MOST, 0.6, PERIOD, turn)
    speed = np.full(n, SPEED)
    tables = (position.copy(), velocity.copy(), wish.copy())
    edges = around.edges if len(around.edges) else None
    walls = np.zeros(n), np.array(fence), edges, *around[1:], HORIZON, RADIUS, virtual
    size = np.full(n, RADIUS), np.full(n, margin)
    goals = np.full((n, 2), np.nan) if goal is None else goal
    return cast("Array", kernel(*tables, *size, speed, avoiding, goals, *walls, *limits))


def crowd(n: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Positions, velocities and wishes of one agent to the square metre."""
    random = np.random.default_rng(seed)
    half = np.sqrt(n) / 2
    position = random.uniform(-half, half, (n, 3)) * [1, 1, 0]
    velocity, wish = random.uniform(-0.7, 0.7, (2, n, 3)) * [1, 1, 0]
    return position, velocity, wish


def turned(vectors: Array, angle: float) -> Array:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.asarray(vectors @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]))


both_turns = pytest.mark.parametrize("turn", [0.0, 0.1])  # without and with the rule of the road


@both_turns
@given(seed=seeds, angle=st.floats(0, 2 * np.pi))
def test_turning_the_room_turns_the_answer(turn: float, seed: int, angle: float) -> None:
    state = crowd(20, seed)
    answer = ask(*(turned(table, angle) for table in state), turn=turn)
    assert answer == pytest.approx(turned(ask(*state, turn=turn), angle), abs=1e-6)


@given(seeds, st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-50, 50)))
def test_it_does_not_matter_where_the_origin_is(seed: int, shift: tuple[float, ...]) -> None:
    position, velocity, wish = crowd(60, seed)
    answer = ask(position + shift, velocity, wish)
    assert answer == pytest.approx(ask(position, velocity, wish), abs=1e-6)


@both_turns
@given(seed=seeds)
def test_answers_do_not_depend_on_rows_nor_on_cells(turn: float, seed: int) -> None:
    state = crowd(60, seed)
    order = np.random.default_rng(seed).permutation(60)
    answer = ask(*(table[order] for table in state), turn=turn)
    assert answer == pytest.approx(ask(*state, turn=turn)[order], abs=1e-6)


@given(seeds)
def test_two_agents_seen_from_between_them_answer_alike(seed: int) -> None:
    positions = np.random.default_rng(seed).uniform(-0.8, 0.8, (3, 3)) * [1, 1, 0]
    answer = ask(*(np.array([row, -row]) for row in positions))
    assert answer[0] == pytest.approx(-answer[1], abs=1e-12)


@given(seeds)
def test_answered_velocities_avoid_contact_within_the_horizon(seed: int) -> None:
    # Few enough, and far enough apart, that there is always a way.
    random = np.random.default_rng(seed)
    angle = np.sort(random.uniform(0, 2 * np.pi, 3)) + np.array([0.0, 0.5, 1.0])
    position = np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
    answer = ask(position, np.zeros((3, 3)), -position)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        away, closing = position[j] - position[i], answer[i] - answer[j]
        time = np.clip(away @ closing / max(closing @ closing, 1e-12), 0, HORIZON)
        assert (
            np.linalg.norm(away - closing * time)
            >= min(2 * RADIUS, float(np.linalg.norm(away))) - 1e-9
        )


def test_a_lone_agent_gets_its_wish_to_the_bit() -> None:
    wish = np.array([[0.3, -0.4, 0.2]])
    assert (ask(np.zeros((1, 3)), np.ones((1, 3)), wish, turn=0.1) == wish).all()


def test_lone_agents_are_limited_to_their_speed() -> None:
    answer = ask(np.zeros((1, 3)), np.zeros((1, 3)), np.array([[3.0, 4.0, 12.0]]))
    assert answer == pytest.approx(np.array([[3.0, 4.0, 12.0]]) / 13)


@given(seeds)
def test_no_agent_is_sent_faster_than_allowed_in_space(seed: int) -> None:
    position, velocity, wish = crowd(40, seed)
    random = np.random.default_rng(seed)
    position[:, 2], wish[:, 2] = random.uniform(0, 3, 40), random.uniform(-2, 2, 40)
    assert np.linalg.norm(ask(position, velocity, wish), axis=1).max() <= SPEED + 1e-12


def test_with_no_agent_ahead_a_wish_is_not_turned() -> None:
    position, wish = np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.array([[-0.5, 0, 0], [0.5, 0, 0]])
    assert (ask(position, np.zeros((2, 3)), wish, turn=0.1) == wish).all()


def test_with_another_agent_ahead_a_wish_is_turned_to_the_right() -> None:
    position, wish = np.array([[0.0, 0, 0], [1.9, 0, 0]]), np.array([[0.1, 0, 0], [0.1, 0, 0]])
    answer = ask(position, np.zeros((2, 3)), wish, turn=0.1)
    assert answer[0] == pytest.approx([0.1 * np.cos(0.1), -0.1 * np.sin(0.1), 0.0])


def turn_of(answer: Array) -> float:
    """How far right of the x axis a velocity leads, rad."""
    return float(-np.arctan2(answer[1], answer[0]))


def meeting(ahead: float, left: float, wish: tuple[float, float] = (-0.15, 0.0)) -> float:
    """How far right the first of two turns, rad: the other is so far ahead and left of it, m."""
    position = np.array([[0.0, 0.0, 0.0], [ahead, left, 0.0]])
    wishes = np.array([[0.15, 0.0, 0.0], [*wish, 0.0]])
    return turn_of(ask(position, np.zeros((2, 3)), wishes, turn=0.1)[0])


def test_oncoming_agents_are_kept_left_from_afar() -> None:
    assert meeting(1.9, -0.5) == pytest.approx(np.arctan((2 * RADIUS + 0.5) / 1.9))


def test_agents_oncoming_on_the_left_need_only_a_small_turn() -> None:
    assert meeting(1.5, 0.4) == pytest.approx(0.1)


def test_no_agent_turns_farther_than_the_steepest_lane() -> None:
    assert meeting(0.95, -0.8) == pytest.approx(np.radians(35.0))


def test_an_agent_that_crosses_makes_no_agent_take_a_lane() -> None:
    assert abs(meeting(1.0, 0.1, (0.0, 0.1))) == pytest.approx(0.1)


def test_an_agent_that_comes_far_out_on_the_right_is_left_there() -> None:
    assert meeting(1.5, -1.0) == pytest.approx(-0.1)


def test_one_that_crosses_ahead_to_the_right_is_passed_behind() -> None:
    assert meeting(1.0, 0.6, (0.0, -0.2)) == pytest.approx(-0.1)


def test_one_that_crosses_behind_to_the_right_is_passed_ahead() -> None:
    assert meeting(0.5, 1.5, (0.0, -0.2)) == pytest.approx(0.1)


FAR_WALL = ((-9.0, -0.5), (-8.9, -0.5), (-8.9, 0.5), (-9.0, 0.5))


@pytest.mark.parametrize(
    ("neighbours", "around", "time"),
    [
        (1, NOTHING, WIDE_YIELD_TIME),
        (CROWD - 1, NOTHING, WIDE_YIELD_TIME),
        (CROWD, NOTHING, YIELD_TIME),
        (1, outlines(world(FAR_WALL)), YIELD_TIME),
    ],
)
def test_wide_margins_yield_slowly_in_the_open_only(
    neighbours: int, around: Outlines, time: float
) -> None:
    beyond, margin = 0.2, 0.15  # m
    position = np.zeros((1 + neighbours, 3))
    position[1:, 0] = 2 * RADIUS + beyond
    position[2:, 1] = 1.5
    still, wish = np.zeros_like(position), np.zeros_like(position)
    wish[0, 0] = SPEED
    goal = 9.0 * np.arange(2 + 2 * neighbours, dtype=float).reshape(-1, 2)
    answer = ask(position, still, wish, goal=goal, margin=margin, around=around)
    assert answer[0, 0] == pytest.approx(beyond / time / 2)


ROOM = (-1.0, -1.0, 1.0, 1.0)


def test_agents_approach_the_fence_within_the_horizon() -> None:
    position, wish = np.array([[0.5, 0.0, 0.0]]), np.array([[0.9, 0.2, 0.0]])
    answer = ask(position, wish, wish, fence=ROOM)
    assert answer == pytest.approx(np.array([[0.5 / HORIZON, 0.2, 0.0]]))


def test_one_that_is_outside_the_fence_is_brought_back() -> None:
    position, wish = np.array([[0.0, -1.2, 0.0]]), np.array([[0.3, -0.3, 0.0]])
    answer = ask(position, wish, wish, fence=ROOM)
    assert answer == pytest.approx(np.array([[0.3, 0.2 / HORIZON, 0.0]]))


def test_agents_far_outside_return_at_half_speed() -> None:
    position, wish = np.array([[-90.0, 0.0, 0.0]]), np.zeros((1, 3))
    assert ask(position, wish, wish, fence=ROOM) == pytest.approx(np.array([[SPEED / 2, 0.0, 0.0]]))


@given(seeds)
def test_no_agent_makes_room_by_leaving_the_fence(seed: int) -> None:
    position, velocity, wish = crowd(20, seed)
    low, high = np.array([-2.0, -2.5, 0.0]), np.array([2.5, 3.0, 0.0])
    position, fence = np.clip(position, low, high), (*low[:2].tolist(), *high[:2].tolist())
    then = position + HORIZON * ask(position, velocity, wish, fence=fence, turn=0.1)
    assert (then >= low - 1e-9).all()
    assert (then <= high + 1e-9).all()


def test_an_agent_gives_way_in_full_to_one_that_does_not_avoid() -> None:
    position, wish = np.array([[0.0, 0, 0], [1.0, 0.05, 0]]), np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    answer = ask(position, wish, wish, avoids=np.array([True, False]))
    away, closing = position[1] - position[0], answer[0] - wish[1]
    time = np.clip(away @ closing / (closing @ closing), 0, HORIZON)
    assert (answer[1] == wish[1]).all()
    assert np.linalg.norm(away - closing * time) >= 2 * RADIUS - 1e-9


@pytest.mark.parametrize("n", [2, 3, 100])
def test_agents_at_one_point_get_finite_answers_and_part(n: int) -> None:
    nothing = np.zeros((n, 3))
    answer = ask(nothing, nothing, nothing)
    assert np.isfinite(answer).all()
    assert answer[0, 0] > 0 > answer[-1, 0]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_agents_at_nonfinite_positions_are_ignored(bad: float) -> None:
    position, velocity, wish = crowd(9)
    without = ask(position[1:], velocity[1:], wish[1:])
    position[0] = bad
    answer = ask(position, velocity, wish)
    assert (answer[1:] == without).all()
    assert (answer[0] == wish[0]).all()


def test_an_agent_whose_velocity_is_not_finite_counts_as_at_rest() -> None:
    position, velocity, wish = crowd(9)
    velocity[3] = 0.0
    expected = ask(position, velocity, wish)
    velocity[3] = np.nan
    assert (ask(position, velocity, wish) == expected).all()


def test_the_machine_code_on_disk_is_that_of_the_sources() -> None:
    state = crowd(60)
    interpreted = ask(*state, turn=0.05, kernel=orca.py_func)  # type: ignore[attr-defined]
    assert ask(*state, turn=0.05) == pytest.approx(interpreted, abs=1e-9)


def room(kind: str, n: int) -> tuple[Array, Array]:
    """Starts and goals: a random crowd, or a circle or a filled disc that changes sides."""
    random = np.random.default_rng(n)
    if kind == "crowd":
        start, goal = random.uniform(-np.sqrt(n) / 2, np.sqrt(n) / 2, (2, n, 3)) * [1, 1, 0]
        return start, goal
    k = np.arange(n) + 0.5
    angle, distance = 2 * np.pi * k / n, np.full(n, max(0.6 * n / (2 * np.pi), 1.0))
    if kind == "disc":
        angle, distance = k * np.pi * (3 - np.sqrt(5)), np.sqrt(k / np.pi)
    start = np.stack([distance * np.cos(angle), distance * np.sin(angle), np.zeros(n)], axis=1)
    start[:, :2] += random.normal(0, 0.02, (n, 2))
    return start, -start


@pytest.mark.parametrize("n", [10, 100, 1000])
@pytest.mark.parametrize("kind", ["crowd", "circle", "disc"])
def test_rvo2_answers_the_same(kind: str, n: int) -> None:
    """RVO2 computes in float32: rounding may send one answer in a thousand the other way."""
    pyrvo = pytest.importorskip("pyrvo")
    position, goal = room(kind, n)
    velocity = np.zeros((n, 3))
    longest = np.linalg.norm(goal - position, axis=1).max() / SPEED
    difference = []
    for tick in range(int(0.8 * longest / PERIOD)):
        way = goal - position
        wish = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1.0)
        answer = ask(position, velocity, wish)
        if n < 1000 or tick % int(longest) == 0:  # thousands of answers at every size
            theirs = answer_of_pyrvo(pyrvo, position, velocity, wish)
            difference.append(np.linalg.norm(answer[:, :2] - theirs, axis=1))
        velocity = answer
        position = position + PERIOD * velocity
    assert (np.concatenate(difference) <= 1e-3).mean() >= 0.999


def answer_of_pyrvo(
    pyrvo: Any, position: Array, velocity: Array, wish: Array, polygons: tuple[Polygon, ...] = ()
) -> Array:
    """What RVO2 answers, (N, 2) m/s."""
    n = len(position)
    simulator = pyrvo.RVOSimulator(
        PERIOD, NEIGHBOUR_DISTANCE, MOST, HORIZON, HORIZON, RADIUS, SPEED
    )
    for i in range(n):
        simulator.add_agent(tuple(position[i, :2].tolist()))
        simulator.set_agent_velocity(i, tuple(velocity[i, :2].tolist()))
        simulator.set_agent_pref_velocity(i, tuple(wish[i, :2].tolist()))
    for polygon in polygons:
        simulator.add_obstacle(list(polygon))
    simulator.process_obstacles()
    simulator.do_step()
    return np.array([(v.x, v.y) for v in map(simulator.get_agent_velocity, range(n))])


def blocks(seed: int, half: float) -> tuple[Polygon, ...]:
    """Triangles, hexagons and the like, hooks and boards, 2 m apart over a square."""
    random = np.random.default_rng(seed)
    polygons: list[Polygon] = []
    for x in np.arange(1 - half, half, 2.0):
        for y in np.arange(1 - half, half, 2.0):
            angle = (
                np.linspace(0, 2 * np.pi, random.integers(3, 7), endpoint=False) + random.random()
            )
            shapes = (
                np.stack([0.45 * np.cos(angle), 0.45 * np.sin(angle)], axis=1),
                np.array([(-4, -4), (4, -4), (4, -1), (-1, -1), (-1, 4), (-4, 4)]) / 10,
                np.array([(-4, -1), (4, -1), (4, 1), (-4, 1)]) / 10,
            )
            shape = shapes[random.integers(3)] + [x, y]
            polygons.append(tuple((float(px), float(py)) for px, py in shape))
    return tuple(polygons)


def clear(around: Outlines, position: Array) -> Array:
    """How far each agent is from the nearest edge, (N,) m."""
    away = position[:, None, :2] - around.edges[:, :2]  # (N, E, 2)
    along = np.einsum("nek,ek->ne", away, around.edges[:, 5:7])
    along = np.clip(along, 0.0, around.edges[:, 4])
    return np.asarray(
        np.linalg.norm(away - along[:, :, None] * around.edges[:, 5:7], axis=2).min(axis=1)
    )


@pytest.mark.parametrize("seed", range(4))
def test_rvo2_answers_the_same_among_obstacles(seed: int) -> None:
    """Those that are within the clearance are left out: RVO2 does not bring them out of it."""
    pyrvo = pytest.importorskip("pyrvo")
    polygons = blocks(seed, 4.0)
    room = world(*polygons)
    around, random = outlines(room), np.random.default_rng(seed)
    position, goal = random.uniform(-5, 5, (2, 80, 3)) * [1, 1, 0]
    inside = [any(thing.contains((x, y, 0.0)) for thing in room.obstacles) for x, y, _ in position]
    free = ~np.array(inside) & (clear(around, position) > RADIUS)
    position, goal = position[free], goal[free]
    velocity = np.zeros_like(position)
    difference = []
    for _ in range(40):
        way = goal - position
        wish = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1.0)
        answer = ask(position, velocity, wish, around=around)
        theirs = answer_of_pyrvo(pyrvo, position, velocity, wish, polygons)
        outside = clear(around, position) > RADIUS + 1e-5
        difference.append(np.linalg.norm(answer[:, :2] - theirs, axis=1)[outside])
        velocity = answer
        position = position + PERIOD * velocity
    together = np.concatenate(difference)
    assert len(together) > 1000
    assert (together <= 1e-3).mean() >= 0.999


@settings(max_examples=20)
@given(seed=seeds, angle=st.floats(0, 2 * np.pi), virtual=st.booleans())
def test_turning_the_room_with_its_obstacles_turns_the_answer(
    seed: int, angle: float, *, virtual: bool
) -> None:
    state, pieces = crowd(12, seed), blocks(seed, 2.0)
    turned_pieces = (
        tuple(map(tuple, turned(np.pad(np.array(piece), ((0, 0), (0, 1))), angle)[:, :2].tolist()))
        for piece in pieces
    )
    around, about = outlines(world(*pieces)), outlines(world(*turned_pieces))
    answer = ask(*(turned(table, angle) for table in state), around=about, virtual=virtual)
    expected = turned(ask(*state, around=around, virtual=virtual), angle)
    # Where two ways out are equally near, rounding chooses.
    assert (np.linalg.norm(answer - expected, axis=1) <= 1e-5).mean() >= 0.8


@settings(max_examples=20)
@given(seed=seeds, virtual=st.booleans())
def test_answers_among_obstacles_are_finite_and_limited(seed: int, *, virtual: bool) -> None:
    position, velocity, wish = crowd(20, seed)
    answer = ask(
        position, velocity, wish, around=outlines(world(*blocks(seed, 3.0))), virtual=virtual
    )
    assert np.isfinite(answer).all()
    assert np.linalg.norm(answer, axis=1).max() <= SPEED + 1e-12


WALL = ((1.0, -5.0), (1.2, -5.0), (1.2, 5.0), (1.0, 5.0))


@pytest.mark.parametrize("virtual", [True, False])
@pytest.mark.parametrize("wish", [(1.0, 0.0, 0.0), (0.7, 0.7, 0.0), (0.2, -0.9, 0.0)])
def test_no_agent_is_sent_into_a_wall(wish: tuple[float, float, float], *, virtual: bool) -> None:
    position, velocity = np.zeros((1, 3)), np.zeros((1, 3))
    for _ in range(300):
        velocity = ask(
            position, velocity, np.array([wish]), around=outlines(world(WALL)), virtual=virtual
        )
        position = position + PERIOD * velocity * [1, 0, 0]  # the wall goes on for ever
        assert position[0, 0] <= 1.0 - RADIUS + (0.03 if virtual else 1e-6)


@pytest.mark.parametrize("virtual", [True, False])
def test_one_that_is_within_the_clearance_is_brought_out_of_it(*, virtual: bool) -> None:
    nothing = np.zeros((1, 3))
    near = np.array([[1.0 - RADIUS / 2, 0.0, 0.0]])
    answer = ask(near, nothing, nothing, around=outlines(world(WALL)), virtual=virtual)
    assert answer == pytest.approx(np.array([[-RADIUS / 2 / HORIZON, 0.0, 0.0]]))


@pytest.mark.parametrize("height", [(0.2, 1.0), (-1.0, -0.2)])
def test_what_is_at_another_height_is_in_nobodys_way(height: tuple[float, float]) -> None:
    wish = np.array([[1.0, 0.0, 0.0]])
    around = outlines(world(WALL, height=height))
    assert (ask(np.zeros((1, 3)), wish, wish, around=around) == wish).all()


def test_no_agent_is_pushed_into_a_wall_by_another() -> None:
    position = np.array([[0.8, 0.0, 0.0], [0.6, 0.0, 0.0]])
    coming = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    answer = ask(position, coming, coming, around=outlines(world(WALL)))
    assert answer[0, 0] <= (0.2 - RADIUS) / HORIZON + 1e-9


def test_stacked_agents_do_not_climb_towards_each_other() -> None:
    stack = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.5]])
    towards, apart = (
        np.array([[0.0, 0, 0.4], [0.0, 0, -0.4]]),
        np.array([[0.0, 0, -0.4], [0.0, 0, 0.4]]),
    )
    assert (ask(stack, np.zeros((2, 3)), towards)[:, 2] == 0.0).all()
    assert (ask(stack, np.zeros((2, 3)), apart)[:, 2] == apart[:, 2]).all()


def test_agents_one_above_the_other_near_each_other_ever_slower() -> None:
    stack = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.8]])
    towards = np.array([[0.0, 0, 0.4], [0.0, 0, -0.4]])
    assert ask(stack, np.zeros((2, 3)), towards)[:, 2] == pytest.approx([0.05, -0.05])


@pytest.mark.parametrize(("share", "free"), [(0.7, False), (0.8, True)])
def test_stacking_applies_within_three_quarters_of_the_radii(share: float, *, free: bool) -> None:
    stack = np.array([[0.0, 0.0, 0.0], [share * 2 * RADIUS, 0.0, 0.8]])
    towards = np.array([[0.0, 0, 0.4], [0.0, 0, -0.4]])
    assert (ask(stack, np.zeros((2, 3)), towards)[:, 2] == towards[:, 2]).all() == free


def test_avoiding_agents_yield_all_room_to_climbing_ones() -> None:
    stack = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.8]])
    rising, sinking = (
        np.array([[0.0, 0, 0.4], [0.0, 0, 0]]),
        np.array([[0.0, 0, 0], [0.0, 0, -0.4]]),
    )
    answer = ask(stack, rising, sinking, avoids=np.array([False, True]))
    assert answer[1, 2] == 0.0
