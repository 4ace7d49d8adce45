"""What the core changes in setpoints before they are sent."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import (
    Agent,
    Array,
    Corrected,
    Estimate,
    Fence,
    Limits,
    Obstacle,
    Scene,
    Setpoint,
    World,
)
from star_core.geometry.neighbours import Pairs
from star_core.safety.braking import BRAKING_GAIN
from star_core.safety.filter import SafetyFilter, direct
from star_core.safety.walls import BESIDE
from star_core.testing import estimate

FENCE = Fence((-3.0, -3.0, 0.0), (3.0, 3.0, 2.0))
SPEED, BRAKES, APART, ABOVE, TICK = 1.0, 2.0, 0.2, 0.5, 0.05


def scene(n: int) -> Scene:
    return Scene(
        agents=tuple(Agent(f"cf{i}", (0.0, 0.0, 0.0)) for i in range(n)),
        period=TICK,
        world=World("room", FENCE),
        limits=Limits(
            SPEED, BRAKES, separation=APART, vertical_separation=ABOVE, uncertainty_margin=0.0
        ),
    )


def setpoint(velocity: Any, active: Any = None) -> Setpoint:
    array = np.array(velocity, float)
    n = len(array)
    return Setpoint(
        array, np.zeros(n), np.ones(n, np.bool_) if active is None else np.array(active)
    )


def filtered(position: Any, velocity: Any, active: Any = None) -> tuple[Array, Corrected]:
    """What is sent to agents that should fly so, and the agents that were corrected."""
    planned = setpoint(velocity, active)
    now = estimate(np.array(position, float))
    sent, corrected = apply(SafetyFilter(scene(len(planned.yaw))), now, planned, planned)
    return sent.velocity, corrected


def apply(
    guard: SafetyFilter, now: Estimate, safe: Setpoint, planned: Setpoint
) -> tuple[Setpoint, Corrected]:
    return guard.filter(now, safe, planned, Pairs.of(now.position, guard.reach))


def unchanged(corrected: Corrected) -> bool:
    reasons = corrected.fence, corrected.speed, corrected.separation, corrected.obstacle
    return not np.any(reasons)


def flown(position: Any, wish: Any, seconds: float = 6.0) -> Array:
    """Where agents go, (T, N, 3), that follow what is sent within their brakes, a tick late."""
    guard, path = SafetyFilter(scene(len(position))), [np.array(position, float)]
    velocity = late = np.zeros_like(path[0])
    for _ in range(round(seconds / TICK)):
        now: Estimate = replace(estimate(path[-1]), velocity=velocity)
        sent, _ = apply(guard, now, setpoint(wish), setpoint(wish))
        change = late - velocity
        length = np.maximum(np.linalg.norm(change, axis=1, keepdims=True), 1e-12)
        velocity = velocity + change * np.minimum(1.0, BRAKES * TICK / length)
        late = sent.velocity
        path.append(path[-1] + TICK * velocity)
    return np.array(path)


@pytest.mark.parametrize("wish", [(1, 0, 0), (0, -1, 0), (0.6, 0.6, 0.4), (0, 0, -1), (0, 0, 1)])
def test_no_agent_leaves_the_fence(wish: tuple[float, float, float]) -> None:
    path = flown([[0.0, 0.0, 1.0]], [wish])[:, 0]
    assert (path >= np.array(FENCE.low) - 0.01).all()
    assert (path <= np.array(FENCE.high) + 0.01).all()
    assert any(
        abs(path[-1, k] - (FENCE.high if wish[k] > 0 else FENCE.low)[k]) < 0.1
        for k in range(3)
        if wish[k]
    )  # and it comes near


def test_agents_outside_the_fence_are_drawn_back_and_may_return() -> None:
    velocity, corrected = filtered([[3.5, 0.0, 1.0]], [[0.5, 0.2, 0.0]])
    assert velocity.tolist() == [[-0.2, 0.2, 0.0]]
    assert corrected.fence.tolist() == [True]
    back, corrected = filtered([[3.5, 0.0, 1.0]], [[-0.5, 0.2, 0.0]])
    assert back.tolist() == [[-0.5, 0.2, 0.0]]
    assert unchanged(corrected)


def test_agents_falling_through_the_fence_return_within_limits() -> None:
    now = estimate(np.array([[0.0, 0.0, -0.1]]), velocity=np.array([[0.0, 0.0, -2.5]]))
    planned = setpoint([[0.9, 0.0, 0.0]])
    sent, _ = apply(SafetyFilter(scene(1)), now, planned, planned)
    assert sent.velocity[0, 2] > 0.8
    assert np.linalg.norm(sent.velocity) <= SPEED * (1 + 1e-6)


def test_no_agent_is_faster_than_the_limit() -> None:
    velocity, corrected = filtered([[0.0, 0.0, 1.0]], [[3.0, 0.0, 0.0]])
    assert velocity[0] == pytest.approx([1.0, 0.0, 0.0])
    assert corrected.speed.tolist() == [True]


FREE = st.tuples(*[st.floats(-100.0, 100.0)] * 3)


@given(st.lists(FREE, min_size=3, max_size=3), st.lists(st.booleans(), min_size=3, max_size=3))
def test_excessive_velocities_are_scaled_and_slow_ones_kept(
    wish: list[tuple[float, float, float]], active: list[bool]
) -> None:
    wide = replace(scene(3), world=World("hall", Fence((-1e6,) * 3, (1e6,) * 3)))
    planned = setpoint(wish, active)
    now = estimate(np.arange(3)[:, None] * [1000.0, 0.0, 0.0])
    sent, _ = apply(SafetyFilter(wide), now, planned, planned)
    lengths = np.linalg.norm(planned.velocity, axis=1)
    factor = np.minimum(1.0, SPEED / np.maximum(lengths, 1e-300)) * np.array(active)
    assert sent.velocity == pytest.approx(planned.velocity * factor[:, None], abs=1e-12)
    assert sent.active.tolist() == active


def test_drones_with_response_lag_stop_inside_the_fence() -> None:
    guard, wish = SafetyFilter(scene(1)), setpoint([[SPEED, 0.0, 0.0]])
    position, velocity = np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3))
    for _ in range(200):
        now = replace(estimate(position), velocity=velocity)
        sent, _ = apply(guard, now, wish, wish)
        velocity = velocity + (1 - math.exp(-TICK / 0.35)) * (sent.velocity - velocity)
        position = position + TICK * velocity
        assert position[0, 0] <= FENCE.high[0] + 0.005
    assert position[0, 0] > FENCE.high[0] - 0.02


@pytest.mark.parametrize("across", [0.0, 0.05, 0.15])
def test_two_that_fly_at_each_other_stop_apart(across: float) -> None:
    path = flown(
        [[-1.5, across, 1.0], [1.5, 0.0, 1.0]], [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], seconds=5.0
    )
    assert np.linalg.norm(path[:, 0] - path[:, 1], axis=1).min() >= APART - 1e-6


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ([0.0, 0.0, 1.8], [0.0, 0.0, 0.2]),
        ([0.02, 0.0, 1.6], [0.0, 0.0, 0.4]),
        ([-1.0, 0.0, 1.2], [1.0, 0.05, 0.9]),
        ([-0.8, 0.3, 1.6], [0.8, -0.3, 0.6]),
        ([0.1, 0.0, 1.3], [0.0, 0.1, 0.9]),
    ],
)
def test_head_on_agents_stop_outside_the_ellipsoid(first: list[float], second: list[float]) -> None:
    towards = SPEED * np.subtract(second, first) / np.linalg.norm(np.subtract(second, first))
    path = flown([first, second], [towards, -towards], seconds=5.0)
    flattened = (path[:, 0] - path[:, 1]) / [APART, APART, ABOVE]
    distances = np.linalg.norm(flattened, axis=1)
    nearest = float(distances.min())
    assert nearest >= min(1.0, float(distances[0])) - 2e-3
    assert nearest < 2.0  # they may come near


def test_stacked_agents_that_are_too_close_part_vertically() -> None:
    velocity, corrected = filtered([[0.0, 0.0, 1.2], [0.0, 0.0, 0.8]], np.zeros((2, 3)))
    assert velocity.tolist() == [[0.0, 0.0, 0.1], [0.0, 0.0, -0.1]]
    assert corrected.separation.all()


def test_an_ellipsoid_with_equal_axes_is_a_sphere_to_the_bit() -> None:
    random = np.random.default_rng(0)
    direction = np.zeros((1, 3))
    for position, velocity in random.uniform(-1, 1, (50, 2, 2, 3)):
        room, approach = direct(direction, 0, 0, 1, position, velocity, APART, 1.0)
        offset = position[0] - position[1]
        distance = math.sqrt(sum(float(x) * float(x) for x in offset))
        assert room == distance - APART
        assert direction[0].tolist() == (offset / distance).tolist()
        assert approach == pytest.approx(-direction[0] @ (velocity[0] - velocity[1]))


def test_many_that_fly_at_one_place_stop_apart() -> None:
    angle = np.linspace(0, math.tau, 8, endpoint=False)
    ring = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.ones(8)])
    wish = np.column_stack([-np.cos(angle), -np.sin(angle), np.zeros(8)])
    path = flown(ring, wish)
    for i in range(8):
        for j in range(i):
            assert np.linalg.norm(path[:, i] - path[:, j], axis=1).min() >= APART - 1e-6


def test_agents_brake_for_an_unsteered_agent() -> None:
    velocity, corrected = filtered(
        [[0.0, 0.0, 1.0], [0.3, 0.0, 1.0]], [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], [True, False]
    )
    assert 0 <= velocity[0, 0] < 0.35
    assert corrected.separation.tolist() == [True, False]


def test_agents_brake_for_an_agent_without_velocity() -> None:
    planned = setpoint([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], [True, False])
    position = np.array([[0.0, 0.0, 1.0], [0.3, 0.0, 1.0]])
    silent = estimate(position, velocity=np.array([[0.0] * 3, [math.nan] * 3]))
    sent, corrected = apply(SafetyFilter(scene(2)), silent, planned, planned)
    still, _ = filtered(position, planned.velocity, [True, False])
    assert sent.velocity[0].tolist() == still[0].tolist()
    assert corrected.separation.tolist() == [True, False]


def test_a_separation_of_zero_lets_agents_collide() -> None:
    planned = setpoint([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    now = estimate(np.array([[0.0, 0.0, 1.0], [0.3, 0.0, 1.0]]))
    free = replace(scene(2), limits=Limits(speed=SPEED, separation=0.0))
    sent, corrected = apply(SafetyFilter(free), now, planned, planned)
    assert sent.velocity.tolist() == planned.velocity.tolist()
    assert unchanged(corrected)


def test_an_agent_that_flies_apart_or_side_by_side_is_left_alone() -> None:
    position = [[0.0, 0.0, 1.0], [0.15, 0.0, 1.0], [0.3, 0.3, 1.0]]
    wish = [[-0.5, 0.1, 0.0], [0.5, 0.1, 0.0], [0.5, 0.5, 0.0]]
    velocity, corrected = filtered(position, wish)
    assert velocity.tolist() == wish
    assert unchanged(corrected)


def test_two_in_one_place_part_along_x_or_not_at_all() -> None:
    velocity, _ = filtered([[0.0, 0.0, 1.0]] * 2, [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]])
    assert np.isfinite(velocity).all()
    assert velocity[0, 0] >= velocity[1, 0] - 1e-3


def test_what_the_avoider_leaves_out_brakes() -> None:
    planned = setpoint([[0.5, 0.0, 0.0], [0.5, 0.0, 0.0]])
    safe = setpoint([[0.5, 0.0, 0.0], [math.nan] * 3], [True, False])
    now = estimate(np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0]]))
    sent, _ = apply(SafetyFilter(scene(2)), now, safe, planned)
    assert sent.active.all()
    assert sent.velocity.tolist() == [[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]


def test_inactive_rows_are_never_sent() -> None:
    planned = setpoint([[0.5, 0.0, 0.0]], [False])
    sent, corrected = apply(
        SafetyFilter(scene(1)), estimate(np.array([[9.0, 0.0, 1.0]])), planned, planned
    )
    assert not sent.active.any()
    assert unchanged(corrected)


def test_an_agent_that_is_nowhere_is_in_no_agents_way() -> None:
    velocity, corrected = filtered(
        [[0.0, 0.0, 1.0], [math.nan] * 3], [[1.0, 0.0, 0.0]] * 2, [True, False]
    )
    assert velocity[0].tolist() == [1.0, 0.0, 0.0]
    assert unchanged(corrected)


@given(st.integers(1, 12), st.integers(0, 10_000))
def test_what_is_sent_is_always_safe_or_comes_from_others(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    position = rng.uniform([-1, -1, 0.2], [1, 1, 1.8], (n, 3))
    active = rng.random(n) < 0.8
    velocity, _ = filtered(position, rng.normal(0, 1, (n, 3)), active)
    assert np.linalg.norm(velocity[active], axis=1).max(initial=0) <= SPEED + 2e-3
    for i in range(n):
        for j in range(i):
            if not (active[i] and active[j]):
                continue
            offset = position[i] - position[j]
            gradient = offset / [1.0, 1.0, (ABOVE / APART) ** 2]
            slope = float(np.linalg.norm(gradient))
            closing = float(gradient @ (velocity[j] - velocity[i])) / slope
            apart = math.sqrt(float(gradient @ offset))  # heights shrunk
            room = max(0.0, (apart - APART) * apart / slope)
            assert closing <= math.sqrt(2 * 2 * BRAKES * room) + 2e-3


def test_a_setpoint_that_is_half_too_fast_is_slowed_and_counted() -> None:
    velocity, corrected = filtered([[0.0, 0.0, 1.0]], [[1.5 * SPEED, 0.0, 0.0]])
    assert velocity[0] == pytest.approx([SPEED, 0.0, 0.0])
    assert corrected.speed.tolist() == [True]


def approach(distance: float, std: float, margin: float) -> float:
    """Return the speed, m/s, at which two agents are let approach each other at a distance, m."""
    room = scene(2)
    guard = SafetyFilter(replace(room, limits=replace(room.limits, uncertainty_margin=margin)))
    now = estimate(np.array([[0.0, 0.0, 1.0], [distance, 0.0, 1.0]]))
    now = replace(now, covariance=np.tile(np.diag([std**2, std**2, 0.0]), (2, 1, 1)))
    planned = setpoint([[SPEED, 0, 0], [-SPEED, 0, 0]])
    sent, _ = apply(guard, now, planned, planned)
    return float(sent.velocity[0, 0] - sent.velocity[1, 0])


def test_agents_brake_earlier_for_uncertain_positions() -> None:
    assert approach(0.6, std=0.025, margin=2.0) == pytest.approx(approach(0.5, 0.0, 2.0), abs=2e-3)


def test_the_distance_for_uncertain_positions_is_at_most_tripled() -> None:
    assert approach(0.8, std=5.0, margin=2.0) == pytest.approx(approach(0.4, 0.0, 2.0), abs=2e-3)


def test_nearby_goals_are_reached_however_uncertain() -> None:
    assert 0.0 < approach(0.3, std=5.0, margin=2.0) < 0.25 * approach(0.3, std=5.0, margin=0.0)


def test_without_a_margin_positions_are_exact() -> None:
    assert approach(0.5, std=5.0, margin=0.0) == approach(0.5, std=0.0, margin=0.0)


PILLAR = Obstacle("pillar", (((0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0)),), (0.0, 1.5))
HANGING = replace(PILLAR, name="hanging", height=(1.4, 2.0))


def sent_beside(
    position: Any, velocity: Any, std: float, *obstacles: Obstacle, margin: float = 2.0
) -> tuple[Array, Corrected]:
    """Return what is sent to an agent with a standard deviation, m, and what was corrected."""
    room = scene(1)
    limits = replace(room.limits, uncertainty_margin=margin)
    guard = SafetyFilter(replace(room, world=World("room", FENCE, obstacles), limits=limits))
    now = estimate(np.array([position], float))
    now = replace(now, covariance=np.diag([std**2, std**2, 0.0])[None])
    planned = setpoint([velocity])
    sent, corrected = apply(guard, now, planned, planned)
    return sent.velocity[0], corrected


def test_uncertain_agents_brake_earlier_before_the_fence() -> None:
    uncertain, _ = sent_beside([2.6, 0, 1], [SPEED, 0, 0], 0.1)
    exact, _ = sent_beside([2.8, 0, 1], [SPEED, 0, 0], 0.0)
    assert uncertain == pytest.approx(exact)
    assert sent_beside([2.6, 0, 1], [SPEED, 0, 0], 0.1, margin=0.0)[0][0] > exact[0]


def test_fence_margin_yields_and_does_not_apply_to_heights() -> None:
    assert 0.0 < sent_beside([2.9, 0, 1], [SPEED, 0, 0], 5.0)[0][0] < 0.05
    assert sent_beside([0, 0, 1.9], [0, 0, SPEED], 5.0)[0][2] == pytest.approx(
        sent_beside([0, 0, 1.9], [0, 0, SPEED], 0.0)[0][2]
    )


def test_only_uncertain_agents_brake_before_obstacles() -> None:
    towards = [SPEED, 0.3, 0]
    exact, unchanged = sent_beside([-0.3, 0, 1], towards, 0.0, PILLAR)
    assert not unchanged.obstacle.any()
    uncertain, corrected = sent_beside([-0.3, 0, 1], towards, 0.1, PILLAR)
    assert corrected.obstacle.tolist() == [True]
    assert 0.0 < uncertain[0] < 0.15 < exact[0]
    assert uncertain[1] == pytest.approx(exact[1])  # along the side it is free
    for position, velocity in (([-0.3, 0, 1], [-0.5, 0, 0]), ([-0.3, 0, 1.7], [0.5, 0, 0])):
        assert sent_beside(position, velocity, 0.1, PILLAR)[0] == pytest.approx(velocity)


def test_an_uncertain_agent_inside_an_obstacle_is_led_out() -> None:
    assert sent_beside([0.2, 0, 1], [0, 0, 0], 0.1, PILLAR)[0][0] < -0.1


@pytest.mark.parametrize(
    ("z", "obstacle", "towards"), [(1.25, HANGING, 1.0), (1.35, HANGING, 1.0), (1.65, PILLAR, -1.0)]
)
def test_agents_brake_below_and_above_obstacles(
    z: float, obstacle: Obstacle, towards: float
) -> None:
    wish = [0.1, 0, 0.3 * towards]
    sent, corrected = sent_beside([0.4, 0, z], wish, 0.0, obstacle)
    gap = min(abs(z - end) for end in obstacle.height)
    assert corrected.obstacle.tolist() == [True]
    assert sent[0] == pytest.approx(0.1)
    assert sent[2] * towards == pytest.approx(max(0.0, BRAKING_GAIN * (gap - BESIDE)), abs=1e-9)
    for position, velocity in (
        ([0.4, 0, z], [0.1, 0, -0.3 * towards]),
        ([-0.3, 0, z], wish),
        ([0.4, 0, z - 0.5 * towards], wish),
    ):
        assert sent_beside(position, velocity, 0.0, obstacle)[0] == pytest.approx(velocity)


@pytest.mark.parametrize("obstacles", [(), (HANGING,)])
def test_agents_that_part_vertically_keep_below_obstacles(obstacles: tuple[Obstacle, ...]) -> None:
    room = scene(2)
    guard = SafetyFilter(replace(room, world=World("room", FENCE, obstacles)))
    now = estimate(np.array([[0.4, 0, 0.9], [0.4, 0, 1.3]]))  # above each other, too near
    planned = setpoint(np.zeros((2, 3)))
    sent, _ = apply(guard, now, planned, planned)
    assert (sent.velocity[1, 2] > 0.05) == (not obstacles)
    assert sent.velocity[0, 2] < -0.05


@pytest.mark.parametrize(
    ("position", "velocity", "sent", "follows"),
    [
        ([1.1, 0, 1], [0.5, 0, 0], [0.5, 0, 0], True),
        ([1.1, 0, 1], [0.5, 0, 0], [0.4, 0, 0], False),  # avoided
        ([1.27, 0, 1], [0.5, 0, 0], [0.5, 0, 0], True),
        ([1.35, 0, 1], [0.5, 0, 0], [0.5, 0, 0], False),  # too far
        ([1.1, 0, 1], [0.0, 0, 0], [0.0, 0, 0], False),  # where its velocity does not lead
        ([1.0, 0, np.nan], [0.5, 0, 0], [0.5, 0, 0], False),
    ],
)
def test_an_avoided_agent_is_flown_by_its_velocity(
    position: list[float], velocity: list[float], sent: list[float], *, follows: bool
) -> None:
    now, still = estimate(np.array([[1.0, 0, 1]])), np.zeros((1, 3))
    planned = replace(setpoint([velocity]), position=np.array([position]), acceleration=still)
    kept = SafetyFilter(scene(1)).keep_trajectories(setpoint([sent]), planned, now)
    assert kept.followed().tolist() == [follows]
    assert kept.velocity.tolist() == [sent]


def test_positions_outside_the_fence_are_not_flown_to() -> None:
    now, still = estimate(np.array([[2.95, 0, 1]])), np.zeros((1, 3))
    for x, follows in ((2.99, True), (3.01, False)):
        planned = replace(
            setpoint([[0.5, 0, 0]]), position=np.array([[x, 0, 1.0]]), acceleration=still
        )
        kept = SafetyFilter(scene(1)).keep_trajectories(planned, planned, now)
        assert kept.followed().tolist() == [follows]
