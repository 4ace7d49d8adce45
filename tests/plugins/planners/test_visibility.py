"""The planner ``visibility``: agents that fly around what is in their way."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from star_core import Array, Estimate, Fence, Goals, Limits, Obstacle, Plan, Planner, Scene, World
from star_core.testing import estimate, scene
from star_core.toolkit import fill_defaults
from star_core.world.outlines import box, wall
from tests.plugins.planners.inputs import VISIBILITY, goals, straight
from tests.plugins.planners.inputs import visibility as planner
from tests.sampling import share_of_examples

N = 3
tables = arrays(np.float64, (N, 3), elements=st.floats(-3, 3))
FENCE = Fence((-5, -5, 0), (5, 5, 3))  # integers, as a world file may have them
BLOCK = Obstacle("block", (box((0, 0), (1, 2), 0.0),), (0.0, 3.0))
CLOSED = [(-1.5, -1.5), (-1.5, 1.5), (1.5, 1.5), (1.5, -1.5), (-1.5, -1.5)]


def room(*obstacles: Obstacle, n: int = 1, **more: Any) -> Scene:
    return replace(scene(n), world=World("room", FENCE, obstacles), **more)


def flown(
    planner: Planner, room: Scene, start: Array, goals: Goals, seconds: float, noise: float = 0.0
) -> Iterator[tuple[Array, Plan]]:
    """Fly point masses that follow within the scene's acceleration; yield places and plans.

    The estimate is off by `noise`, m, one deviation, correlated over a second.
    """
    random = np.random.default_rng(0)
    position, velocity, error = start.copy(), np.zeros_like(start), np.zeros_like(start)
    keep = math.exp(-room.period)
    for _ in range(round(seconds / room.period)):
        error = keep * error + noise * math.sqrt(1 - keep**2) * random.normal(size=start.shape)
        plan = planner.plan(estimate(position + error, velocity=velocity), goals)
        yield position, plan
        change = plan.setpoint.velocity - velocity
        size = np.linalg.norm(change, axis=1, keepdims=True)
        most = room.limits.acceleration * room.period
        velocity = velocity + change * np.minimum(1.0, most / np.maximum(size, 1e-9))
        position = position + room.period * velocity


def clearance(track: Sequence[Array], obstacle: Obstacle) -> float:
    """How near agents come to an obstacle that is as high as the room, m."""
    ground = shapely.union_all([shapely.Polygon(piece) for piece in obstacle.polygons])
    return float(min(shapely.distance(ground, shapely.points(place[:, :2])).min()
                     for place in track))  # fmt: skip


HERE, THERE = np.array([[-2.0, 0.1, 1.0]]), [[2.0, 0.1, 1.0]]


# What is free is flown as by `straight`


@given(tables, tables, tables)
def test_in_an_empty_world_it_flies_as_straight_does(
    start: Array, goal: Array, velocity: Array
) -> None:
    empty = room(n=N)
    goal = goal * [1, 1, 0.25] + [0, 0, 1]  # within the heights
    now, targets = estimate(start), goals(goal, velocity=velocity, yaw=np.array([1.0, 2, 3]))
    plan, straight_plan = (
        planner(empty).plan(now, targets),
        straight(empty).plan(now, targets),
    )
    assert np.array_equal(plan.setpoint.velocity, straight_plan.setpoint.velocity)
    assert np.array_equal(plan.setpoint.yaw, straight_plan.setpoint.yaw)
    assert not plan.unreachable.any()


def test_a_moving_goal_in_sight_is_flown_with_among_obstacles() -> None:
    moving = goals([[-2, 0, 1.0]], velocity=np.array([[0.1, 0.2, 0.0]]))
    plan = planner(room(BLOCK)).plan(estimate(np.array([[-2, 0, 1.0]])), moving)
    assert plan.setpoint.velocity[0] == pytest.approx([0.1, 0.2, 0.0])


# Around


def test_an_agent_flies_around_a_block_and_rests_at_its_goal() -> None:
    blocked = room(BLOCK)
    track = [place for place, _ in flown(planner(blocked), blocked, HERE, goals(THERE), 15)]
    assert track[-1] == pytest.approx(np.array(THERE), abs=0.02)
    assert clearance(track, BLOCK) >= 0.2
    assert np.ptp([place[0, 2] for place in track]) < 1e-9


def test_it_does_not_slow_down_at_corners_that_allow_its_speed() -> None:
    blocked = room(BLOCK, limits=Limits(speed=0.5, acceleration=4.0))
    speeds = [
        np.linalg.norm(plan.setpoint.velocity)
        for place, plan in flown(planner(blocked), blocked, HERE, goals(THERE), 15)
        if place[0, 0] < 1.5
    ]
    assert speeds == pytest.approx([0.5] * len(speeds))


def test_it_slows_down_for_corners_at_which_it_could_not_turn() -> None:
    fast = Limits(speed=2.0, acceleration=2.0)
    blocked = room(BLOCK, limits=fast)
    track = list(flown(planner(blocked), blocked, HERE, goals(THERE, speed=2.0), 15))
    speeds = [np.linalg.norm(plan.setpoint.velocity) for _, plan in track]
    assert max(speeds[:40]) > 1.0
    assert clearance([place for place, _ in track], BLOCK) >= 0.15


@pytest.mark.parametrize("look_ahead", [0.1, 0.3, 0.6])
def test_the_line_to_what_it_steers_to_is_free(look_ahead: float) -> None:
    blocked = room(BLOCK)
    visible = planner(blocked, look_ahead=look_ahead)
    kept = shapely.Polygon(BLOCK.polygons[0]).buffer(0.2 - 1e-3)
    for place, plan in flown(visible, blocked, HERE, goals(THERE), 12):
        speed = float(np.linalg.norm(plan.setpoint.velocity))
        ahead = place[0] + plan.setpoint.velocity[0] * min(0.1 / max(speed, 1e-9), 1.0)
        assert not kept.intersects(shapely.LineString([place[0, :2], ahead[:2]]))


def test_agents_with_noisy_estimates_arrive_and_hit_nothing() -> None:
    blocked = room(BLOCK)
    noisy = flown(planner(blocked), blocked, HERE, goals(THERE), 15, noise=0.03)
    track = [place for place, _ in noisy]
    assert clearance(track, BLOCK) >= 0.06
    assert np.linalg.norm(track[-1] - THERE) < 0.15


def test_shown_paths_lead_from_agent_to_goal_by_corners() -> None:
    plan = planner(room(BLOCK, n=2)).plan(
        estimate(np.array([[-2, 0.1, 1], [-2, 3, 1]])), goals([[2, 0.1, 1], [2, 3, 1]])
    )
    first, second = (plan.paths.point[plan.paths.agent == row] for row in (0, 1))
    assert first[[0, -1]].tolist() == [[-2, 0.1, 1], [2, 0.1, 1]]
    assert (first[1:-1, 1] > 1.0).all()
    assert second.tolist() == [[-2, 3, 1], [2, 3, 1]]
    assert plan.paths.agent.tolist() == sorted(plan.paths.agent.tolist())


def test_agents_pushed_out_of_sight_of_their_path_replan() -> None:
    blocked = room(BLOCK)
    visible = planner(blocked)
    visible.plan(estimate(HERE), goals(THERE))
    pushed = np.array([[0.0, -2.0, 1.0]])  # the other side of the block
    plan = visible.plan(estimate(pushed), goals(THERE))
    assert plan.setpoint.velocity[0, 0] > 0.3
    assert (plan.paths.point[:, 1] < 0.2).all()


# A goal that moves


@pytest.mark.parametrize(("aside", "left"), [([-0.2, 1.8, 1.0], 2), ([-0.9, 1.8, 1.0], 3)])
def test_agents_pushed_past_a_corner_do_not_return_to_it(aside: Sequence[float], left: int) -> None:
    flies = planner(room(BLOCK))
    first = flies.plan(estimate(HERE), goals(THERE)).paths.point
    assert len(first) == 8  # three points round each of two corners
    then = flies.plan(estimate(np.array([aside])), goals(THERE))
    rest = first[-left:]
    np.testing.assert_allclose(then.paths.point[1:], rest)
    way = rest[0] - aside
    velocity = then.setpoint.velocity[0]
    cosine = velocity @ way / np.linalg.norm(velocity) / np.linalg.norm(way)
    assert cosine == pytest.approx(1.0)


def test_a_goal_that_moves_behind_the_block_is_followed() -> None:
    blocked = room(BLOCK)
    visible, place = planner(blocked), HERE.copy()
    for tick in range(400):
        target = goals([[2.0, 0.1 - 1.5 * math.sin(0.01 * tick), 1.0]])
        plan = visible.plan(estimate(place), target)
        assert np.linalg.norm(plan.setpoint.velocity) > 0 or tick > 100
        place = place + blocked.period * plan.setpoint.velocity
    assert np.linalg.norm(place - target.position) < 0.2


def test_planning_is_limited_per_tick_and_round_robin() -> None:
    blocked = room(BLOCK, n=5)
    positions = np.array([[-2, 0.1 * i, 1.0] for i in range(5)])
    visible, moving = planner(blocked, queries_per_tick=2), []
    for _ in range(3):
        plan = visible.plan(estimate(positions), goals(positions * [-1, 1, 1]))
        moving.append((np.linalg.norm(plan.setpoint.velocity, axis=1) > 0).tolist())
    assert moving == [
        [True, True, False, False, False],
        [True, True, True, True, False],
        [True] * 5,
    ]


@pytest.mark.parametrize(("moved", "flies"), [(0.5, True), (1.5, False)])
def test_paths_are_kept_until_replanned_if_the_goal_moves_little(
    moved: float, *, flies: bool
) -> None:
    blocked = room(BLOCK, n=2)
    positions = np.array([[-2, 0.1, 1.0], [-2, -0.1, 1.0]])
    visible = planner(blocked, queries_per_tick=1, hold_distance=1.0)
    for _ in range(2):
        visible.plan(estimate(positions), goals(positions * [-1, 1, 1]))
    plan = visible.plan(estimate(positions), goals(positions * [-1, 1, 1] + [moved, 0, 0]))
    assert (np.linalg.norm(plan.setpoint.velocity, axis=1) > 0).tolist() == [True, flies]


# What cannot be reached


@pytest.mark.parametrize(
    ("start", "goal", "why"),
    [
        ((0, 0, 1), (3, 0, 1), "[0, 0, 1] is inside obstacle 'block'"),
        ((3, 0, 1), (0, 0, 1), "[0, 0, 1] is inside obstacle 'block'"),
        (
            (3, 0, 1),
            (0.6, 0, 1),
            "[0.6, 0, 1] is 0.1 m from obstacle 'block', "
            "less than planner visibility's clearance of 0.2 m",
        ),
    ],
)
def test_an_agent_holds_that_is_or_is_sent_where_no_agent_can_be(
    start: Sequence[float], goal: Sequence[float], why: str
) -> None:
    visible = planner(room(BLOCK))
    plan = visible.plan(estimate(np.array([start], float)), goals([goal]))
    assert plan.unreachable.tolist() == [True]
    assert plan.setpoint.velocity.tolist() == [[0, 0, 0]]
    assert plan.setpoint.active.tolist() == [True]
    assert plan.reasons == {0: why}


@pytest.mark.parametrize("start", [[-2, 0, 1.0], [2, 1, 1.0]])
@pytest.mark.parametrize(("z", "side"), [(2.5, 1), (0.1, 1), (1.8 + 1e-6, 1), (1.8, 0)])
def test_a_goal_outside_the_heights_is_unreachable_not_moved(
    start: Sequence[float], z: float, side: int
) -> None:
    plan = planner(room(BLOCK)).plan(estimate(np.array([start])), goals([[2, 0, z]]))
    assert plan.unreachable.tolist() == [bool(side)]
    assert (np.linalg.norm(plan.setpoint.velocity) == 0) == bool(side)
    if side:
        assert plan.reasons[0] == (
            f"cannot fly to [2, 0, {z:g}]: {z:g} m is outside the heights to fly at, from 0.2 to "
            "1.8 m"
        )


def test_agents_slightly_outside_the_heights_may_stay() -> None:
    position = np.array([[2, 0, 1.85]])
    plan = planner(room(BLOCK)).plan(estimate(position), goals(position))
    assert plan.unreachable.tolist() == [False]


def test_only_walled_in_goals_are_unreachable() -> None:
    closed = Obstacle("cell", wall(CLOSED, 0.1), (0.0, 3.0))
    visible = planner(room(closed, n=3))
    positions = np.array([[-3, 0, 1], [0.5, 0, 1], [-3, 1, 1]], float)
    for _ in range(2):  # it stays so
        plan = visible.plan(estimate(positions), goals([[0, 0, 1], [-0.5, 0, 1], [3, 1, 1]]))
        assert plan.unreachable.tolist() == [True, False, False]
        assert (np.linalg.norm(plan.setpoint.velocity, axis=1) > 0).tolist() == [False, True, True]


def test_a_goal_that_comes_within_reach_is_flown_to() -> None:
    visible = planner(room(BLOCK))
    visible.plan(estimate(HERE), goals([[0, 0, 1.0]]))
    plan = visible.plan(estimate(HERE), goals([[2.0, 0, 1.0]]))
    assert plan.unreachable.tolist() == [False]
    assert np.linalg.norm(plan.setpoint.velocity) > 0


def test_an_agent_pushed_within_the_clearance_flies_out_first() -> None:
    blocked = room(BLOCK)
    start = np.array([[-0.58, 0.0, 1.0]])
    track = list(flown(planner(blocked), blocked, start, goals(THERE), 15))
    first = track[0][1].setpoint.velocity[0]
    assert first / np.linalg.norm(first) == pytest.approx([-1, 0, 0], abs=1e-6)
    assert clearance([place for place, _ in track], BLOCK) == pytest.approx(0.08)
    assert track[-1][0] == pytest.approx(np.array(THERE), abs=0.02)


@pytest.mark.parametrize("start", [[-0.58, 0.0, 1.0], [-2.0, 0.1, 1.0]])
def test_an_agent_pushed_along_an_obstacle_flies_out_where_it_is(start: Sequence[float]) -> None:
    flies = planner(room(BLOCK))
    flies.plan(estimate(np.array([start])), goals(THERE))
    plan = flies.plan(estimate(np.array([[-0.58, 0.8, 1.0]])), goals(THERE))
    first = plan.setpoint.velocity[0]
    assert first / np.linalg.norm(first) == pytest.approx([-1, 0, 0], abs=1e-6)


def test_agents_grazing_an_obstacle_fly_along_it() -> None:
    flies = planner(room(BLOCK))
    flies.plan(estimate(HERE), goals(THERE))
    plan = flies.plan(estimate(np.array([[-0.69, 0.5, 1.0]])), goals(THERE))
    assert plan.setpoint.velocity[0, 1] > 0.3


def test_agents_grazing_an_obstacle_reach_a_goal_beside_it() -> None:
    start, goal = np.array([[-0.69, 0.0, 1.0]]), [[-0.62, 0.0, 1.0]]
    velocity = planner(room(BLOCK)).plan(estimate(start), goals(goal)).setpoint.velocity[0]
    assert velocity[0] > 0.05


def test_an_agent_that_holds_within_the_clearance_holds_there() -> None:
    blocked = room(BLOCK)
    start = np.array([[-0.6, 0.0, 1.0]])
    for place, plan in flown(planner(blocked), blocked, start, goals(start + 0.02), 3):
        assert not plan.unreachable.any()
        assert np.abs(place - start).max() < 0.03


# Over and under


def test_an_agent_flies_over_a_low_wall_and_keeps_its_distance() -> None:
    low = Obstacle("low", (box((0, 0), (0.1, 9.9), 0.0),), (0.0, 1.0))
    over = room(low)
    start, end = np.array([[-2.0, 0, 0.8]]), [[2.0, 0, 0.8]]
    track = [place for place, _ in flown(planner(over), over, start, goals(end), 15)]
    assert track[-1] == pytest.approx(np.array(end), abs=0.02)
    above = [place[0, 2] for place in track if abs(place[0, 0]) < 0.05 + 0.2]
    assert above
    assert min(above) >= 1.2


@pytest.mark.extended
@share_of_examples(0.2)
@given(st.integers(0, 10_000))
def test_no_agent_hits_anything_among_random_blocks(seed: int) -> None:
    random = np.random.default_rng(seed)
    blocks = [
        Obstacle("block", (box((x, y), (length, width), yaw),), (0.0, top))
        for x, y, length, width, yaw, top in zip(
            *random.uniform(-3, 3, (2, 5)),
            *random.uniform(0.2, 1.5, (2, 5)),
            random.uniform(0, 3, 5),
            random.choice([0.8, 3.0], 5),
            strict=True,
        )
    ]
    crowded = room(*blocks, n=N)
    free = random.uniform([-4.5, -4.5, 0.3], [4.5, 4.5, 1.7], (100, 3))
    free = free[gaps(blocks, free) > 0.3]
    start, end = free[:N], free[N : 2 * N]
    track = list(flown(planner(crowded), crowded, start, goals(end), 30))
    assert gaps(blocks, np.concatenate([place for place, _ in track])).min() > 0.15
    arrived = np.linalg.norm(track[-1][0] - end, axis=1) < 0.05
    assert (arrived | track[-1][1].unreachable).all()


def gaps(blocks: Sequence[Obstacle], place: Array) -> Array:
    """How far (K, 3) places are from blocks that stand: beside or above, whichever is more, m."""
    spots = shapely.points(place[:, :2])
    beside = [shapely.distance(shapely.Polygon(block.polygons[0]), spots) for block in blocks]
    above = [place[:, 2] - block.height[1] for block in blocks]
    answer: Array = np.maximum(beside, above).min(axis=0)
    return answer


# What every planner owes


def test_rows_without_a_goal_or_an_estimate_are_idle() -> None:
    positions = np.array([[-2, 0, 1.0], [-2, 1, 1], [np.nan] * 3])
    now = replace(estimate(positions), valid=np.array([True, True, False]))
    targets = goals([[2, 0, 1.0]] * 3, active=np.array([False, True, True]))
    plan = planner(room(BLOCK, n=3)).plan(now, targets)
    assert plan.setpoint.active.tolist() == [False, True, False]
    assert plan.setpoint.velocity[[0, 2]].tolist() == [[0.0] * 3] * 2
    assert set(plan.paths.agent.tolist()) == {1}
    assert plan.unreachable.tolist() == [False] * 3


def problems(scene: Scene) -> list[str]:
    assert VISIBILITY.check is not None
    return [problem.message for problem in VISIBILITY.check(scene)]


def test_the_check_finds_nothing_wrong_with_a_good_scene() -> None:
    aside = Obstacle("aside", (box((3, 3), (1, 1), 0.0),), (0.0, 3.0))
    assert problems(room(aside)) == []


def test_heights_that_are_all_outside_the_fence_are_refused() -> None:
    (message,) = problems(room(limits=Limits(height=(3.5, 4.0))))
    assert message == (
        "no height to fly at is inside the fence: from 3.5 to 4 m, and the fence from 0 to 3 m"
    )


@pytest.mark.extended
def test_nothing_is_compiled_in_flight() -> None:
    code = """
import numpy as np, pkgutil, importlib, star_visibility
from numba.core.dispatcher import Dispatcher
from tests.plugins.planners.test_visibility import *
low = Obstacle("low", (box((0, 0), (0.1, 9.9), 0.0),), (0.0, 1.0))
table = Obstacle("table", (box((-2, 0), (1, 1), 0.0),), (1.3, 1.4))
over = room(low, table, BLOCK, n=2)
visible = planner(over)
modules = [importlib.import_module("star_visibility." + m.name)
           for m in pkgutil.iter_modules(star_visibility.__path__)]
def signatures():
    return sorted((m.__name__, name, len(f.signatures)) for m in modules
                  for name, f in vars(m).items() if isinstance(f, Dispatcher))
before = signatures()
start = np.array([[-2.0, 0, 0.8], [0.0, 1.1, 0.8]])
for _ in flown(visible, over, start, goals([[2.0, 0, 0.8], [0, 0, 1]]), 9):
    pass
assert signatures() == before, set(signatures()) ^ set(before)
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[3])


# Planning takes as many ticks as it needs


def parted() -> tuple[Obstacle, ...]:
    """A closed wall, and blocks of many heights: it takes long to find no way."""
    random = np.random.default_rng(4)
    blocks = [
        Obstacle(
            f"block {k}",
            (
                box(
                    random.uniform(-4, 4, 2).tolist(),
                    random.uniform(0.2, 0.6, 2).tolist(),
                    float(k),
                ),
            ),
            (foot := float(random.choice([0.0, random.uniform(0.3, 1.5)])), foot + 0.4),
        )
        for k in range(30)
    ]
    return (Obstacle("across", wall([(0.0, -5.0), (0.0, 5.0)], 0.1), (0.0, 3.0)), *blocks)


def test_only_the_agent_of_a_long_search_holds() -> None:
    hall = room(*parted(), n=2)
    visible = planner(hall)
    positions = np.array([[-4.6, 4.6, 1.0], [4.6, -4.6, 1.0]])
    targets = goals([[4.6, 4.6, 1.0], [4.6, 4.6, 1.0]])
    ticks = 0
    while not (plan := visible.plan(estimate(positions), targets)).unreachable.any():
        assert plan.setpoint.velocity[0].tolist() == [0, 0, 0]
        ticks += 1
        assert ticks < 1000
    assert ticks > 2
    assert plan.reasons == {0: "no path leads from [-4.6, 4.6, 1] to [4.6, 4.6, 1]"}
    assert np.linalg.norm(plan.setpoint.velocity[1]) > 0


# Farther around, for uncertain positions


def with_std(now: Estimate, std: float) -> Estimate:
    n = len(now.yaw)
    return replace(now, covariance=np.tile(np.diag([std**2, std**2, 0.0]), (n, 1, 1)))


def nearest_to_block(std: float, room: Scene, *, seconds: float = 15.0) -> float:
    """How near a point mass with an uncertain position comes to `BLOCK`, m; it must arrive."""
    made = planner(room)
    uncertain: Any = SimpleNamespace(plan=lambda now, target: made.plan(with_std(now, std), target))
    track = [place for place, _ in flown(uncertain, room, HERE, goals(THERE), seconds)]
    assert track[-1] == pytest.approx(np.array(THERE), abs=0.02)
    return clearance(track, BLOCK)


def test_paths_keep_the_margin_for_an_uncertain_position() -> None:
    blocked = room(BLOCK)
    assert 0.2 <= nearest_to_block(0.0, blocked) <= 0.25
    assert 0.4 <= nearest_to_block(0.1, blocked) <= 0.45
    assert 0.6 <= nearest_to_block(5.0, blocked) <= 0.65


def test_zero_uncertainty_margin_gives_the_exact_position_path() -> None:
    blocked = room(BLOCK)
    exact = replace(blocked, limits=replace(blocked.limits, uncertainty_margin=0.0))
    assert nearest_to_block(0.2, exact) == nearest_to_block(0.0, blocked)


def test_a_narrow_gap_is_flown_with_the_widest_clearance_it_has() -> None:
    """The gap has room for 0.2 m more than the clearance, and the way around it is long."""
    sides = [box((0, y), (0.5, 6.0), 0.0) for y in (-3.55, 3.55)]
    gap = room(Obstacle("gap", tuple(sides), (0.0, 3.0)))
    made, now = planner(gap), with_std(estimate(np.array([[-1.0, 1.0, 1.0]])), 5.0)
    plan = made.plan(now, goals([[1.0, -1.0, 1.0]]))
    assert not plan.unreachable.any()
    assert made._clearances._flown_level.tolist() == [2]


def test_uncertain_agents_still_reach_goals_at_the_clearance() -> None:
    blocked = room(BLOCK)
    goal = [[-0.5 - 0.26, 0.1, 1.0]]
    made = planner(blocked)
    uncertain: Any = SimpleNamespace(plan=lambda now, target: made.plan(with_std(now, 5.0), target))
    *_, (place, plan) = flown(uncertain, blocked, HERE, goals(goal), 15)
    assert place == pytest.approx(np.array(goal), abs=0.02)
    assert not plan.unreachable.any()


def test_varying_covariance_does_not_change_the_path() -> None:
    blocked = room(BLOCK)
    made, ends = planner(blocked), set()
    for tick in range(80):
        std = 0.12 - 0.1 * abs(math.sin(tick / 20))  # from 0.12 m to 0.02 m and back, in 3 s
        made.plan(with_std(estimate(HERE, time=tick / 20), std), goals(THERE))
        ends.add(tuple(made._tracked.path[0, 0].tolist()))
    assert len(ends) == 1


def virtual(*obstacles: Obstacle, solid: tuple[Obstacle, ...] = ()) -> Scene:
    return replace(scene(1), world=World("room", FENCE, solid, virtual=obstacles))


def test_virtual_obstacles_are_flown_around() -> None:
    space = virtual(BLOCK)
    aim = goals([(2, 0, 1)])
    steps = list(flown(planner(space), space, np.array([[-2.0, 0, 1]]), aim, 20))
    track = [position for position, _ in steps]
    assert math.dist(track[-1][0], (2, 0, 1)) < 0.05
    assert clearance(track, BLOCK) > 0.15


@pytest.mark.parametrize(("start", "goal"), [((0, 0, 1), (2, 0, 1)), ((2, 0, 1), (0, 0, 1))])
def test_agents_start_and_end_in_virtual_obstacles(start: Any, goal: Any) -> None:
    space = virtual(BLOCK)
    steps = list(flown(planner(space), space, np.array([start], float), goals([goal]), 12))
    assert math.dist(steps[-1][0][0], goal) < 0.05
    assert not steps[-1][1].unreachable.any()
    options = fill_defaults({}, VISIBILITY.options)
    assert VISIBILITY.check_goals is not None
    assert not list(VISIBILITY.check_goals(space, [goal], **options))


def test_solid_obstacles_stay_solid_beside_virtual_ones() -> None:
    enclosed = Obstacle("room", wall(CLOSED, 0.1), (0.0, 3.0))
    space = virtual(BLOCK, solid=(enclosed,))
    steps = list(flown(planner(space), space, np.array([[-4.0, 0, 1]]), goals([(0, 0, 1)]), 3))
    assert steps[-1][1].unreachable.all()
    assert "'room'" in steps[-1][1].reasons[0] or "no path" in steps[-1][1].reasons[0]
