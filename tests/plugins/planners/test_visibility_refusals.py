"""The planner ``visibility`` beside obstacles: which goals it refuses, and which it must not."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from star_core import Agent, Array, Fence, Goals, Obstacle, Scene, World, load
from star_core import fly as fly_mission
from star_core.plugin_support.registry import Registry
from star_core.testing import estimate, scene
from star_core.toolkit import fill_defaults
from star_core.world.outlines import box
from star_core.world.world import CONTACT_RADIUS
from tests.plugins.planners import inputs
from tests.plugins.planners.inputs import VISIBILITY
from tests.plugins.planners.inputs import visibility as planner
from tests.sampling import share_of_examples

CLEARANCE = 0.2
WALL = Obstacle("wall", (box((-0.5, 0), (1, 2), 0.0),), (0.0, 1.5))
SHELF = Obstacle("shelf", (box((0, -2), (1, 1), 0.3),), (1.2, 1.3))
FENCE = Fence((-4, -4, 0), (4, 4, 2.2))
NOWHERE = (3.0, 3.0, 0.0)
ROOM_YAML = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [3, 2, 2.2]}
obstacles:
  wall: {box: {centre: [-0.5, 0], size: [1, 2]}, height: [0, 1.5]}
"""
MISSION = """\
star: 1
collisions: record  # drift may carry an agent against a wall that it starts beside
name: beside
world: room.yaml
swarm:
  cf1: {start: [0.205, 0, 0]}
transport: sim
localizer: flow
planner: visibility
avoider: {use: orca, radius: 0.2}
rate: 10
limits: {uncertainty_margin: 0}  # with margins, uncertain agents beside obstacles are landed
mission:
  - takeoff: {height: 0.8}
"""


def room(*starts: tuple[float, float, float], obstacles: Sequence[Obstacle] = (WALL,)) -> Scene:
    agents = tuple(Agent(f"cf{i}", start) for i, start in enumerate(starts))
    return replace(scene(1), agents=agents, world=World("room", FENCE, tuple(obstacles)))


def refused(room: Scene, goal: Sequence[float], **options: float) -> str:
    """Why the mission's check refuses a goal; empty if it does not."""
    assert VISIBILITY.check_goals is not None
    filled = fill_defaults(options, VISIBILITY.options)
    return "".join(
        problem.message for problem in VISIBILITY.check_goals(room, [tuple(goal)], **filled)
    )


def goals(*position: Array | Sequence[float]) -> Goals:
    return inputs.goals(np.array(position))


class Flown:
    """Point masses that fly what a planner answers, and are pushed about.

    Args:
        room: Where.
        position: (N, 3) where they are at first, m.
    """

    def __init__(self, room: Scene, position: Sequence[Sequence[float]]) -> None:
        self.room = room
        self.planner = planner(room)
        self.position = np.array(position, np.float64)

    def tick(self, goals: Goals) -> None:
        """Fly one tick; a goal that is refused fails the test."""
        plan = self.planner.plan(estimate(self.position), goals)
        assert not plan.reasons
        assert not plan.unreachable.any()
        self.position = self.position + self.room.period * plan.setpoint.velocity


@st.composite
def starts(draw: Callable[..., Any]) -> tuple[float, float, float]:
    """Starts 0.0605 to 0.3 m from the wall: beside its face, and around its corner."""
    away = draw(st.floats(0.0605, 0.3))
    if draw(st.booleans()):
        return away, draw(st.floats(-0.9, 0.9)), 0.0
    angle = draw(st.floats(0.0, math.pi / 2))
    return away * math.cos(angle), 1 + away * math.sin(angle), 0.0


offsets = st.floats(-0.05, 0.05)


# An agent that starts or holds within the clearance


@share_of_examples(0.2)
@given(starts(), offsets, offsets, st.lists(st.tuples(offsets, offsets), min_size=1, max_size=4))
def test_agents_near_an_obstacle_take_off_leave_and_return(
    start: tuple[float, float, float], x: float, y: float, pushes: list[tuple[float, float]]
) -> None:
    near = room(start)
    drifted = (start[0] + x, start[1] + y, 0.78)
    assume(near.world.fault(drifted) is None)
    flown = Flown(near, [start])
    above = goals((*start[:2], 0.8))
    flown.tick(above)  # on the ground; the on-board commander climbs
    flown.position[0] = drifted
    for _ in range(20):
        flown.tick(above)
    station = flown.position[0].copy()
    for push in pushes:
        flown.position[0] = station + np.array([3 * abs(push[0]), push[1], 0.0])
        for _ in range(30):
            flown.tick(goals(station))
    for _ in range(30):
        flown.tick(goals(station))
    assert np.linalg.norm(flown.position[0] - station) < 0.05
    for _ in range(80):
        flown.tick(goals((1.5, 0.3, 0.8)))
    assert flown.position[0] == pytest.approx([1.5, 0.3, 0.8], abs=0.2)
    for _ in range(150):
        flown.tick(above)
    assert flown.position[0] == pytest.approx([*start[:2], 0.8], abs=0.05)


@share_of_examples(0.2)
@given(starts())
def test_another_agent_can_take_over_a_hold_near_an_obstacle(
    held: tuple[float, float, float],
) -> None:
    flown = Flown(room(NOWHERE, (1.5, 0.0, 0.0)), [(*held[:2], 0.8), (1.5, 0.0, 0.8)])
    flown.tick(goals((*held[:2], 0.8), (1.5, 0.0, 0.8)))
    for _ in range(150):
        flown.tick(goals((1.5, -1.0, 0.8), (*held[:2], 0.8)))
    assert flown.position[1] == pytest.approx([*held[:2], 0.8], abs=0.05)


def test_agents_shut_in_by_the_margin_alone_hold_and_fly() -> None:
    sides = [((-0.5, 0), (1, 2)), ((0.92, 0), (1, 2)), ((0.2, 1.2), (2.4, 0.4))]
    shut = [Obstacle("side", (box(*side, 0.0),), (0.0, 3.0)) for side in sides]
    shut.append(Obstacle("front", (box((0.2, -1.2), (2.4, 0.4), 0.0),), (0.0, 3.0)))
    flown = Flown(room(NOWHERE, obstacles=shut), [(0.21, 0.0, 0.8)])
    flown.tick(goals((0.21, 0.0, 0.8)))
    for _ in range(60):
        flown.tick(goals((0.21, 0.5, 0.8)))
    assert flown.position[0] == pytest.approx([0.21, 0.5, 0.8], abs=0.05)


@pytest.mark.parametrize("goal", [[0.15, 0.0, 0.8], [0.05, 0.0, 0.8], [-0.5, 0.0, 1.6]])
def test_goals_within_the_clearance_are_refused_like_the_check(goal: Sequence[float]) -> None:
    near = room(NOWHERE)
    plan = planner(near).plan(estimate(np.array([[1.0, 0.0, 0.8]])), goals(goal))
    shown = ", ".join(f"{value:g}" for value in goal)
    assert plan.unreachable.tolist() == [True]
    assert plan.reasons == {0: f"[{shown}] {refused(near, goal)}"}


def test_goals_moving_slightly_out_of_the_clearance_are_reached() -> None:
    flown, now = planner(room(NOWHERE)), estimate(np.array([[0.23, 0.5, 0.8]]))
    assert flown.plan(now, goals((0.17, 0.0, 0.8))).unreachable.tolist() == [True]
    assert flown.plan(now, goals((0.22, 0.0, 0.8))).unreachable.tolist() == [False]


def test_goals_that_creep_into_the_clearance_are_refused() -> None:
    near = room(NOWHERE)
    position, creeping = np.array([[1.0, 0.0, 0.8]]), planner(near)
    reasons: dict[int, str] = {}
    for step in range(500):
        goal = [1.0 - 0.002 * step, 0.0, 0.8]
        plan = creeping.plan(
            estimate(position), replace(goals(goal), velocity=np.array([[-0.04, 0.0, 0.0]]))
        )
        position = position + near.period * plan.setpoint.velocity
        reasons |= plan.reasons
    assert position[0, 0] > 0.17
    assert reasons[0].endswith("less than planner visibility's clearance of 0.2 m")


# What the check refuses, and the planner

anywhere = st.tuples(st.floats(-2, 2), st.floats(-3.2, 2), st.floats(0.2, 1.8))


@given(anywhere, st.floats(0.001, 0.5), st.floats(0.001, 0.5))
def test_check_refuses_exactly_goals_within_both_clearances(
    goal: tuple[float, float, float], clearance: float, vertical: float
) -> None:
    given_room = room(NOWHERE, obstacles=(WALL, SHELF))
    short = []
    for obstacle in (WALL, SHELF):
        beside, above = obstacle.gaps(goal)
        inside = not beside and not above
        short.append(1.0 if inside else min(clearance - beside, vertical - above))
    assume(abs(max(short) - 5e-4) > 1e-6)
    options = {"clearance": clearance, "vertical_clearance": vertical}
    assert bool(refused(given_room, goal, **options)) == (max(short) > 5e-4)


@share_of_examples(0.2)
@given(anywhere)
def test_what_the_check_accepts_the_planner_flies_to(goal: tuple[float, float, float]) -> None:
    given_room = room(NOWHERE, obstacles=(WALL, SHELF))
    assume(given_room.world.fault(goal) is None)
    assume(not refused(given_room, goal))
    flown = Flown(given_room, [(2.0, 1.0, 1.0)])
    for _ in range(300):
        flown.tick(goals(goal))
    assert flown.position[0] == pytest.approx(goal, abs=0.05)


def test_a_goal_at_the_clearance_is_not_refused_for_rounding() -> None:
    block = Obstacle("block", (box((0, 0), (1, 1), 0.0),), (0.0, 1.5))
    assert CLEARANCE > 0.7 - 0.5
    assert not refused(room(NOWHERE, obstacles=(block,)), (0.7, 0.0, 0.8))


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        ((0.15, 0.0, 0.8), "is 0.15 m from obstacle 'wall', less than planner visibility's "
         "clearance of 0.2 m"),
        ((-0.5, 0.0, 1.6), "is 0.1 m above obstacle 'wall', less than planner visibility's "
         "vertical clearance of 0.2 m"),
        ((0.0, -2.0, 1.1), "is 0.1 m below obstacle 'shelf', less than planner visibility's "
         "vertical clearance of 0.2 m"),
        ((-0.5, 0.0, 0.8), "is inside obstacle 'wall'"),
        ((0.21, 0.0, 0.8), ""),
    ],
)  # fmt: skip
def test_a_refusal_names_how_far_the_goal_is_and_from_what(
    goal: tuple[float, float, float], reason: str
) -> None:
    assert refused(room(NOWHERE, obstacles=(WALL, SHELF)), goal) == reason


# Flights


def outcome(folder: Any, steps: str, *changes: str) -> tuple[str, str]:
    (folder / "room.yaml").write_text(ROOM_YAML)
    (folder / "beside.yaml").write_text(MISSION + steps)
    registry = Registry()
    summary = fly_mission(load(folder / "beside.yaml", registry, changes), registry)
    return summary["outcome"], summary["reason"]


@pytest.mark.parametrize(
    ("start", "seed"), [(0.0605, 0), (0.18, 0), (0.2039, 2), (0.205, 0), (0.205, 1), (0.207, 0)]
)
def test_a_mission_that_holds_near_an_obstacle_completes(
    tmp_path: Any, start: float, seed: int
) -> None:
    steps = "  - hold: {for: 2}\n  - land: {}\n"
    changes = f"swarm.cf1.start=[{start}, 0, 0]", f"seed={seed}"
    assert outcome(tmp_path, steps, *changes) == ("completed", "")


@pytest.mark.parametrize(
    ("start", "avoider"), [(0.0605, "orca"), (0.12, "potential"), (0.2, "none")]
)
def test_an_agent_that_starts_near_an_obstacle_leaves(
    tmp_path: Any, start: float, avoider: str
) -> None:
    steps = "  - goto: {by: [0.5, 0.3, 0]}\n  - leave: {agents: cf1}\n"
    changes = f"swarm.cf1.start=[{start}, 0, 0]", f"avoider={avoider}"
    assert outcome(tmp_path, steps, *changes) == ("completed", "")


CORNER = math.sqrt(0.5)


@pytest.mark.campaign
@pytest.mark.parametrize("avoider", ["orca", "none", "voronoi", "potential"])
@pytest.mark.parametrize("away", [0.0605, 0.08, 0.12, 0.16, 0.18, 0.195, 0.2, 0.2039, 0.205, 0.3])
@pytest.mark.parametrize("corner", [False, True])
def test_no_start_near_an_obstacle_aborts_a_mission(
    tmp_path: Any, *, avoider: str, away: float, corner: bool
) -> None:
    x, y = (away * CORNER, 1 + away * CORNER) if corner else (away, 0.0)
    assert away > CONTACT_RADIUS
    steps = "  - hold: {for: 5}\n  - goto: {by: [0.5, 0.3, 0]}\n  - leave: {agents: cf1}\n"
    for seed in range(5):
        changes = f"swarm.cf1.start=[{x}, {y}, 0]", f"avoider={avoider}", f"seed={seed}"
        assert outcome(tmp_path, steps, *changes) == ("completed", "")
