"""Every scenario can be flown: its starts and goals are apart, inside, and clear of obstacles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import MultiPolygon, Point, Polygon, union_all

from star_bench.files import mission_lines, text, world_lines
from star_bench.scenario import (
    MIN_CLEARANCE,
    MIN_SEPARATION,
    PITCH,
    Scenario,
    grid_slot,
    random_points,
    separated,
)
from star_bench.scenarios import CATALOGUE, MAX_AGENTS, Case
from star_core import Registry, load
from star_yaml.world_loader import obstacle, obstacle_faults

RADIUS = 0.2  # m, of an agent, as `orca` has it
ROUNDING = 1e-9  # m

cases = st.builds(
    Case, st.sampled_from(sorted(CATALOGUE)), st.integers(2, 64), st.integers(0, 10**6)
)


def spots(scenario: Scenario) -> list[Sequence[tuple[float, ...]]]:
    """Where the agents are at the start, and at the end of each leg."""
    return [scenario.starts, *scenario.legs]


def walls(scenario: Scenario) -> MultiPolygon | Polygon:
    pieces = [obstacle(name, description) for name, description in scenario.obstacles.items()]
    area = union_all([Polygon(polygon) for piece in pieces for polygon in piece.polygons])
    assert isinstance(area, MultiPolygon | Polygon)
    return area


@given(cases)
def test_agents_start_end_and_land_apart(case: Case) -> None:
    scenario = case.draw()
    for places in (*spots(scenario), [goal[:2] for goal in scenario.legs[-1]]):
        nearest = min(math.dist(a, b) for a, b in combinations(places, 2))
        assert nearest >= MIN_SEPARATION - ROUNDING > 2 * RADIUS


@given(cases)
def test_agents_start_and_end_well_inside_the_fence(case: Case) -> None:
    scenario = case.draw()
    for places in spots(scenario):
        inside = np.array(places)[:, :2]
        assert (inside >= np.add(scenario.low, MIN_CLEARANCE)).all()
        assert (inside <= np.subtract(scenario.high, MIN_CLEARANCE)).all()


@given(cases)
def test_agents_start_and_end_clear_of_obstacles(case: Case) -> None:
    scenario = case.draw()
    if scenario.obstacles:
        built = walls(scenario)
        for places in spots(scenario):
            assert min(built.distance(Point(*p[:2])) for p in places) >= MIN_CLEARANCE - ROUNDING


@given(cases)
def test_no_obstacle_of_a_scenario_has_a_fault(case: Case) -> None:
    for given_ in case.draw().obstacles.values():
        assert list(obstacle_faults(given_, None)) == []


@given(cases)
def test_every_agent_has_one_start_one_height_and_one_goal_a_leg(case: Case) -> None:
    scenario = case.draw()
    for rows in (scenario.starts, scenario.heights, *scenario.legs):
        assert len(rows) == case.agents


@given(cases)
def test_scenario_files_are_reproducible_by_seed(case: Case) -> None:
    again = Case(case.scenario, case.agents, case.seed)
    other = Case(case.scenario, case.agents, case.seed + 1)
    assert text(mission_lines(case, case.draw())) == text(mission_lines(again, again.draw()))
    assert text(world_lines(case, case.draw())) == text(world_lines(again, again.draw()))
    assert case.draw().starts != other.draw().starts


@pytest.mark.parametrize("name", CATALOGUE)
@pytest.mark.parametrize("agents", [2, 7, 32, pytest.param(MAX_AGENTS, marks=pytest.mark.campaign)])
def test_every_scenario_is_a_mission_that_can_be_flown(
    name: str, agents: int, tmp_path: Path
) -> None:
    case = Case(name, agents, 3)
    (tmp_path / "worlds").mkdir()
    (tmp_path / "worlds" / f"{case.name}.yaml").write_text(text(world_lines(case, case.draw())))
    path = tmp_path / f"{case.name}.yaml"
    path.write_text(text(mission_lines(case, case.draw())))
    mission = load(path, Registry())
    assert (len(mission.scene.agents), mission.scene.seed) == (agents, 3)
    options = {"noise": False, "profile": "ideal", "controller": "ideal"}
    assert mission.plugins["transport"].written == options


@pytest.mark.parametrize("agents", [4, 9, 64])
def test_agents_on_a_circle_change_sides(agents: int) -> None:
    scenario = Case("circle", agents, 0).draw()
    for start, (x, y, _) in zip(scenario.starts, scenario.legs[0], strict=True):
        assert math.dist(start, (-x, -y)) <= 0.1


def test_agents_in_a_disc_fill_it() -> None:
    starts = Case("disc", 64, 0).draw().starts
    reach = max(math.hypot(*start) for start in starts)
    inner = sum(math.hypot(*start) < reach / 2 for start in starts)
    assert inner / 64 == pytest.approx(1 / 4, abs=0.1)  # as the area within half the radius


def test_agents_cross_from_four_sides() -> None:
    scenario = Case("crossing", 8, 0).draw()
    ways = [
        (round(x - a), round(y - b))
        for (a, b), (x, y, _) in zip(scenario.starts, scenario.legs[0], strict=True)
    ]
    assert {(x > 0, x < 0, y > 0, y < 0) for x, y in ways} == {
        (True, False, False, False),
        (False, True, False, False),
        (False, False, True, False),
        (False, False, False, True),
    }


@pytest.mark.parametrize("name", ["corridor", "doorway"])
@pytest.mark.parametrize("width", [0.8, 4.0])
def test_a_corridor_and_a_door_are_as_wide_as_asked_for(name: str, width: float) -> None:
    scenario = Case(name, 8, 0, {"width": width}).draw()
    built = walls(scenario)
    assert built.distance(Point(0, 0)) == pytest.approx(width / 2)
    assert all(wall_reaches_the_fence(scenario, side) for side in (-1, 1))


def wall_reaches_the_fence(scenario: Scenario, side: int) -> bool:
    far = scenario.high[1] if side > 0 else scenario.low[1]
    return walls(scenario).distance(Point(0, far)) < ROUNDING


def test_agents_in_a_corridor_meet_head_on() -> None:
    scenario = Case("corridor", 8, 0).draw()
    for (x, _), (end, _, _) in zip(scenario.starts, scenario.legs[0], strict=True):
        assert x * end < 0
    assert {math.copysign(1, x) for x, _ in scenario.starts} == {-1.0, 1.0}


def test_all_agents_pass_the_door_on_the_same_side() -> None:
    scenario = Case("doorway", 8, 0).draw()
    assert all(x < 0 for x, _ in scenario.starts)
    assert all(x > 0 for x, _, _ in scenario.legs[0])


def test_the_streets_between_blocks_are_as_wide_as_asked_for() -> None:
    pieces = list(walls(Case("blocks", 8, 0, {"street": 2.0}).draw()).geoms)  # type: ignore[union-attr]
    assert len(pieces) == 9
    nearest = min(a.distance(b) for a, b in combinations(pieces, 2))
    assert nearest == pytest.approx(2.0)


@pytest.mark.parametrize("seed", range(5))
def test_drones_pass_between_any_two_polygons(seed: int) -> None:
    pieces = list(walls(Case("polygons", 32, seed).draw()).geoms)  # type: ignore[union-attr]
    assert min(a.distance(b) for a, b in combinations(pieces, 2)) >= 1.0
    assert all(piece.equals(piece.convex_hull) for piece in pieces)


def test_stack_pairs_meet_vertically_and_swap_heights_and_sides() -> None:
    scenario = Case("stack", 8, 0).draw()
    meet, end = scenario.legs
    for agent in range(0, 8, 2):
        assert math.dist(meet[agent][:2], meet[agent + 1][:2]) <= 0.1
        assert abs(meet[agent][2] - meet[agent + 1][2]) > 0.6
        assert end[agent][2] == meet[agent + 1][2] == scenario.heights[agent + 1]
        assert scenario.starts[agent][0] * end[agent][0] < 0


def test_a_field_that_is_too_small_has_no_room() -> None:
    from random import Random

    assert random_points(100, 1.0, Random(0)) is None  # noqa: S311 -- no secret


@given(st.integers(1, 50), st.integers(1, 9))
def test_places_in_rows_are_a_pitch_apart(n: int, lanes: int) -> None:
    places = [(row * PITCH, aside) for row, aside in (grid_slot(i, lanes) for i in range(n))]
    assert all(separated(p, places[:i], PITCH - ROUNDING) for i, p in enumerate(places))
