"""The geofence, the obstacles, and why no agent can be at a point."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from star_core.errors import InputError, code_of
from star_core.world.outlines import wall
from star_core.world.world import CONTACT_RADIUS, Fence, Obstacle, World
from star_yaml.document import Document
from star_yaml.world_loader import world
from star_yaml.yaml_reader import parse
from tests.commands import position_and_code

Corner: TypeAlias = tuple[float, float]
Point: TypeAlias = tuple[float, float, float]

WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
obstacles:
  pillar: {polygon: [[0.8, 0.8], [1.2, 0.8], [1, 1.2]], height: [0, 2]}
"""
TRIANGLE_AND_BACK = "[[-0.5, -1], [0.5, -1], [0, -0.5], [-0.5, -1]]"
metres = st.floats(-10, 10)
points: st.SearchStrategy[Point] = st.tuples(metres, metres, metres)
corners: st.SearchStrategy[Corner] = st.tuples(metres, metres)

ROOM = Fence((-2, -2, 0), (2, 2, 2.5))
PILLAR = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))


@st.composite
def stars(draw: st.DrawFn) -> tuple[Corner, ...]:
    """A polygon around the origin, seldom convex, whose corners go once round."""
    count = draw(st.integers(3, 9))
    reach = draw(st.lists(st.floats(0.5, 5), min_size=count, max_size=count))
    return tuple(
        (r * math.cos(2 * math.pi * i / count), r * math.sin(2 * math.pi * i / count))
        for i, r in enumerate(reach)
    )


def to_segment(a: Corner, b: Corner, point: Corner) -> float:
    """Distance from a point to a stretch of a line, m."""
    length = math.dist(a, b)
    along = ((point[0] - a[0]) * (b[0] - a[0]) + (point[1] - a[1]) * (b[1] - a[1])) / length**2
    along = min(1.0, max(0.0, along))
    return math.dist(point, (a[0] + along * (b[0] - a[0]), a[1] + along * (b[1] - a[1])))


# The fence


@pytest.mark.parametrize("point", [ROOM.low, ROOM.high, (2, -2, 0), (0, 0, 0)])
def test_a_point_on_the_fence_is_inside(point: Point) -> None:
    assert ROOM.contains(point)


@pytest.mark.parametrize("point", [(2.1, 0, 1), (0, -2.1, 1), (0, 0, -0.1), (0, 0, 2.6)])
def test_a_point_beyond_a_side_of_the_fence_is_outside(point: Point) -> None:
    assert not ROOM.contains(point)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_point_that_is_not_finite_is_outside_the_fence(axis: int, value: float) -> None:
    point = [0.0, 0.0, 1.0]
    point[axis] = value
    assert not ROOM.contains((point[0], point[1], point[2]))


# Obstacles


@pytest.mark.parametrize(("z", "inside"), [(-0.1, False), (0, True), (2, True), (2.1, False)])
def test_an_obstacle_reaches_from_its_foot_to_its_top(z: float, *, inside: bool) -> None:
    assert PILLAR.contains((0.5, 0.5, z)) is inside


# Walls


@given(corners, corners, st.floats(0.01, 1), st.floats(0, 1), st.floats(-1, 1))
def test_walls_cover_half_their_thickness_to_each_side(
    a: Corner, b: Corner, thickness: float, along: float, across: float
) -> None:
    length = math.dist(a, b)
    assume(length > 0.01)
    ahead, left = (b[0] - a[0]) / length, (b[1] - a[1]) / length
    out = across * thickness / 2 * 0.99
    point = (a[0] + along * (b[0] - a[0]) - out * left, a[1] + along * (b[1] - a[1]) + out * ahead)
    assert Obstacle("wall", wall([a, b], thickness), (0, 1)).contains((*point, 0.5))


@given(st.lists(corners, min_size=2, max_size=5), st.floats(0.01, 1), corners)
def test_walls_cover_nothing_beyond_the_reach_of_their_corners(
    line: list[Corner], thickness: float, point: Corner
) -> None:
    assume(all(math.dist(a, b) > 0.01 for a, b in pairwise(line)))
    away = min(to_segment(a, b, point) for a, b in pairwise(line))
    assume(away > thickness / 2 * math.sqrt(2) + 1e-6)
    assert not Obstacle("wall", wall(line, thickness), (0, 1)).contains((*point, 0.5))


def test_the_corner_of_a_wall_is_closed() -> None:
    corner = Obstacle("corner", wall([(0, 0), (1, 0), (1, 1)], 0.2), (0, 2))
    assert corner.contains((1.09, -0.09, 1.0))


def test_a_wall_has_a_piece_for_every_stretch() -> None:
    assert len(wall([(0, 0), (1, 0), (1, 1), (2, 1)], 0.1)) == 3


def test_flat_walls_end_at_their_points() -> None:
    line = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]
    flat = Obstacle("flat", wall(line, 0.2, flat=True), (0, 2))
    assert flat.contains((1.09, -0.09, 1.0))  # a corner closes
    assert not flat.contains((-0.01, 0.0, 1.0))
    assert not flat.contains((1.0, 1.01, 1.0))
    closed = [*line, line[0]]
    assert wall(closed, 0.2, flat=True) == wall(closed, 0.2)


def test_tags_may_lie_in_virtual_obstacles() -> None:
    text = WORLD + "landmarks: {a: {tags: [0], at: [1.0, 0.9, 0.0]}}\n"
    assert [*map(code_of, problems(text))] == ["inside-obstacle"]
    text = text.replace("height: [0, 2]", "height: [0, 2], virtual: true")
    room = world(Document(parse(text, "w.yaml"), Path("w.yaml")))
    assert (room.obstacles, [thing.name for thing in room.virtual]) == ((), ["pillar"])
    assert room.fault((1.0, 0.9, 1.0)) is None


def test_flat_ends_belong_to_polylines_only() -> None:
    wall_ = "wall: {polyline: [[0, 0], [1, 0]], thickness: 0.2, height: [0, 1], flat_ends: true}"
    text = WORLD.replace(
        "pillar: {polygon: [[0.8, 0.8], [1.2, 0.8], [1, 1.2]], height: [0, 2]}", wall_
    )
    (obstacle,) = world(Document(parse(text, "w.yaml"), Path("w.yaml"))).obstacles
    assert not obstacle.contains((-0.01, 0.0, 0.5))


# Why no agent can be at a point


def test_nothing_is_wrong_with_a_free_point() -> None:
    assert World("room", ROOM, (PILLAR,)).fault((-1.0, -1.0, 1.0)) is None


def test_a_point_outside_the_fence_is_shown_with_the_fence() -> None:
    assert World("room", ROOM).fault((0.0, 0.0, 3.125)) == (
        "[0, 0, 3.125] is outside the fence, from [-2, -2, 0] to [2, 2, 2.5]"
    )


def test_points_inside_obstacles_are_reported_with_the_name() -> None:
    assert World("room", ROOM, (PILLAR,)).fault((0.5, 0.5, 1.0)) == (
        "[0.5, 0.5, 1] is inside obstacle 'pillar'"
    )


@given(stars(), points)
def test_point_distances_equal_the_distances_that_judge_flights(
    polygon: tuple[Corner, ...], point: Point
) -> None:
    thing = Obstacle("thing", (polygon, PILLAR.polygons[0]), (-1, 2))
    (judged,) = thing.distances(np.array([point]))
    assert thing.distance(point, point[2]) == pytest.approx(judged, abs=1e-9)


@given(stars(), points, st.floats(0, 5))
def test_climbs_touch_obstacles_nearer_than_the_drone_radius(
    polygon: tuple[Corner, ...], low: Point, climb: float
) -> None:
    thing, high = Obstacle("thing", (polygon, PILLAR.polygons[0]), (-1, 2)), low[2] + climb
    assert thing.touched(low, high) is (thing.distance(low, high) < CONTACT_RADIUS)


@given(points, st.floats(0, 5))
def test_climb_distance_is_that_of_its_nearest_point(low: Point, climb: float) -> None:
    x, y, z = low
    heights = [z + climb * i / 200 for i in range(201)]
    nearest = min(PILLAR.distance((x, y, height), height) for height in heights)
    assert PILLAR.distance(low, z + climb) == pytest.approx(nearest, abs=climb / 200)


@pytest.mark.parametrize("x", [0.0, 1.0])
def test_contact_is_detected_at_every_face(x: float) -> None:
    room = World("room", ROOM, (PILLAR,))
    assert room.contact_fault((x, 0.5, 0.5)) == (
        f"[{x:g}, 0.5, 0.5] is 0 m from obstacle 'pillar', "
        "expected at least the radius of a drone: 0.06 m"
    )


@pytest.mark.parametrize(("x", "touches"), [(1.05, True), (1.07, False)])
def test_a_drone_touches_what_is_nearer_than_its_radius(x: float, *, touches: bool) -> None:
    fault = World("room", ROOM, (PILLAR,)).contact_fault((x, 0.5, 0.0))
    assert (fault is not None) is touches


def test_of_what_is_overhead_the_lowest_is_hit_first() -> None:
    beam, roof = (
        Obstacle(name, PILLAR.polygons, (foot, foot + 0.1)) for name, foot in (("b", 1), ("r", 2))
    )
    room = World("room", ROOM, (roof, beam))
    assert room.overhead((0.5, 0.5, 0.0), 2.5) is beam
    assert room.overhead((0.5, 0.5, 0.0), 0.95) is beam  # 5 cm below it, its propellers hit
    assert room.overhead((0.5, 0.5, 0.0), 0.93) is None
    assert room.overhead((0.5, 0.5, 1.2), 1.9) is None
    assert room.overhead((1.1, 0.5, 0.0), 2.5) is None


# World files


def problems(text: str) -> list[str]:
    """What is wrong with a world that fits its schema."""
    parsed = parse(text, "room.yaml")
    try:
        world(Document(parsed, Path("room.yaml")))
    except InputError as error:
        return list(error.problems)
    return []


def test_a_good_world_is_made_of_its_fence_and_its_obstacles() -> None:
    parsed = parse(WORLD, "room.yaml")
    made = world(Document(parsed, Path("room.yaml")))
    assert made.fence == Fence((-2, -2, 0), (2, 2, 2))
    assert [obstacle.name for obstacle in made.obstacles] == ["pillar"]


def test_a_line_may_come_back_to_where_it_began() -> None:
    ring = f"polyline: {TRIANGLE_AND_BACK}, thickness: 0.1, height: [0, 1]"
    assert problems(f"{WORLD}  ring: {{{ring}}}\n") == []


@pytest.mark.parametrize("kind", ["landmarks", "targets"])
def test_offsets_that_do_not_fit_tags_or_spacing_are_reported(kind: str) -> None:
    sheet = "{tags: [0, 1], at: [0, 0, 0], spacing: 0.3, offsets: [[0, 0]]}"
    messages = problems(f"{WORLD}{kind}: {{s: {sheet}}}\n")
    assert {code_of(problem) for problem in messages} == {"wrong-length", "option-conflict"}


@pytest.mark.parametrize(
    "sheet",
    [
        "{tags: [0], at: [0.8, 0.9, 1.0], pitch_deg: -90}",  # on the pillar's face
        "{tags: [0], at: [1.0, 1.0, 2.0]}",  # on its top
        "{tags: [0], at: [0.0, 5.0, 1.0], roll_deg: 90}",  # on a wall behind the fence
    ],
)
def test_a_tag_may_be_on_an_obstacle_or_beyond_the_fence(sheet: str) -> None:
    box = "[[0.8, 0.8], [1.2, 0.8], [1.2, 1.2], [0.8, 1.2]]"
    text = WORLD.replace("[[0.8, 0.8], [1.2, 0.8], [1, 1.2]]", box)
    assert problems(f"{text}landmarks:\n  sheet: {sheet}\n") == []


def test_all_world_problems_are_listed_in_file_order() -> None:
    world = WORLD.replace("high: [2,", "high: [-2,").replace("[0, 2]", "[3, 2]") + (
        "  bar: {polyline: [[0, 0], [0, 0]], thickness: 0.1, height: [0, 1]}\n"
    )
    assert [problem.split(":")[1] for problem in problems(world)] == ["3", "5", "6"]


def obstacle(shape: str) -> Obstacle:
    """The obstacle that a world file describes so."""
    parsed = parse(WORLD.replace("polygon: [[0.8, 0.8], [1.2, 0.8], [1, 1.2]]", shape), "room.yaml")
    (made,) = world(Document(parsed, Path("room.yaml"))).obstacles
    return made


def test_a_box_is_turned_about_its_centre() -> None:
    made = obstacle("box: {centre: [1, 0], size: [1, 0.2], yaw_deg: 90}")
    assert made.contains((1.0, 0.45, 1.0))
    assert not made.contains((1.45, 0.0, 1.0))
    assert made.height == (0, 2)


def test_a_cylinder_contains_its_circle() -> None:
    made = obstacle("cylinder: {centre: [1, 0], radius: 0.5}")
    angles = [math.tau * i / 100 for i in range(100)]
    assert all(
        made.contains((1 + 0.499 * math.cos(a), 0.499 * math.sin(a), 1.0)) is True for a in angles
    )
    assert not made.contains((1.51, 0.0, 1.0))


@pytest.mark.parametrize("height", ["[2.5, 3]", "[-2, -1]"])
def test_an_obstacle_above_or_below_the_fence_is_refused(height: str) -> None:
    (problem,) = problems(WORLD.replace("[0, 2]", height))
    assert position_and_code(problem) == "room.yaml:5:11 [outside-geofence]"


@pytest.mark.parametrize(
    "shape",
    [
        "box: {centre: [2.4, 0], size: [1, 1]}",
        "polyline: [[-3, 2], [3, 2]], thickness: 0.1",
        "polyline: [[-5, 0], [-4, 0], [0, 0]], thickness: 0.1",
    ],
)
def test_an_obstacle_may_reach_out_of_the_fence(shape: str) -> None:
    assert problems(f"{WORLD}  it: {{{shape}, height: [-1, 9]}}\n") == []


def test_a_fence_that_is_wrong_is_not_held_against_obstacles() -> None:
    (problem,) = problems(WORLD.replace("high: [2,", "high: [-3,"))
    assert position_and_code(problem) == "room.yaml:3:8 [empty-range]"
