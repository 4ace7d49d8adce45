"""What is wrong with a formation before anybody flies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from star_core import Limits, Obstacle, Scene
from star_core.testing import scene
from star_core.toolkit import fill_defaults
from star_verbs.formation.spec import OPTIONS, check

ROOM = scene(3)
CENTRE = [0.0, 0.0, 0.8]
PILLAR = Obstacle("pillar", (((0.9, -0.1), (1.1, -0.1), (1.1, 0.1), (0.9, 0.1)),), (0.0, 3.0))


def problems_of(room: Scene = ROOM, **options: Any) -> list[tuple[tuple[str | int, ...], str]]:
    rows = tuple(range(len(room.agents)))
    filled = fill_defaults(options, OPTIONS)
    return [(problem.path, problem.message) for problem in check(room, rows, **filled)]


def with_pillar() -> Scene:
    return replace(ROOM, world=replace(ROOM.world, obstacles=(PILLAR,)))


def test_a_formation_that_can_be_flown_has_no_problem() -> None:
    move = {"to": [3.0, 0.0, 1.0]}
    assert problems_of(shape="circle", centre=CENTRE, radius=1.0, move=move) == []


def test_a_line_needs_a_centre() -> None:
    assert problems_of(shape="line") == [((), "shape 'line' needs 'centre'")]


def test_points_are_needed() -> None:
    assert problems_of(shape="points", centre=CENTRE) == [((), "shape 'points' needs 'points'")]


def test_a_line_has_no_radius() -> None:
    ((path, message),) = problems_of(shape="line", centre=CENTRE, radius=1.0)
    assert path == ("radius",)
    assert message == "'radius' goes with shape 'circle', not with 'line'"


def test_points_have_no_spacing() -> None:
    ((path, message),) = problems_of(shape="points", points=[CENTRE] * 3, spacing=1.0)
    assert path == ("spacing",)
    assert message == "'spacing' goes with shape 'line' or 'grid' or 'circle', not with 'points'"


def test_a_circle_has_a_radius_or_a_spacing() -> None:
    ((path, message),) = problems_of(shape="circle", centre=CENTRE, radius=1.0, spacing=0.5)
    assert path == ("spacing",)
    assert message == "'spacing' does not go with 'radius', expected one of them"


def test_two_points_are_too_few_for_three_agents() -> None:
    ((path, message),) = problems_of(shape="points", points=[[0, 0, 1], [1, 0, 1]])
    assert path == ("points",)
    assert message == "there are 2 points, expected one for each of 3"


def test_a_grid_of_two_positions_is_too_small_for_three_agents() -> None:
    ((path, message),) = problems_of(shape="grid", centre=CENTRE, rows=1, columns=2)
    assert path == ("rows",)
    assert message == "1 x 2 positions are 2, expected 3: one for each agent"


def test_positions_outside_the_fence_are_reported_with_number() -> None:
    ((path, message),) = problems_of(shape="line", centre=[9.5, 0.0, 0.8], spacing=1.0)
    assert path == ("centre",)
    assert message.startswith("position 3 of 3: [10.5, 0, 0.8] is outside the fence")


def test_a_point_outside_the_heights_is_reported_at_its_index() -> None:
    ((path, message),) = problems_of(shape="points", points=[[0, 0, 1], [1, 0, 5], [2, 0, 1]])
    assert path == ("points", 1)
    assert message == "[1, 0, 5] is outside the heights to fly at, from 0.2 to 1.8 m"


def test_a_position_in_an_obstacle_is_refused() -> None:
    ((_, message),) = problems_of(with_pillar(), shape="line", centre=CENTRE, spacing=1.0)
    assert message == "position 3 of 3: [1, 0, 0.8] is inside obstacle 'pillar'"


def test_a_move_through_an_obstacle_is_refused() -> None:
    move = {"to": [1.0, 1.0, 0.8]}
    ((path, message),) = problems_of(
        with_pillar(), shape="line", centre=[1.0, -1.0, 0.8], spacing=1.0, move=move
    )
    assert path == ("move", "to")
    assert message.startswith("position 2 of 3 moves there: [1, -0.15, 0.8] is 0.0")
    assert "obstacle 'pillar'" in message


def test_a_move_out_of_the_fence_is_reported_for_each_position() -> None:
    problems = problems_of(shape="line", centre=CENTRE, spacing=1.0, move={"to": [9.5, 0.0, 0.8]})
    assert [path for path, _ in problems] == [("move", "to")]


def test_positions_closer_than_the_separation_are_refused() -> None:
    ((path, message),) = problems_of(shape="line", centre=CENTRE, spacing=0.1)
    assert path == ("spacing",)
    assert message == (
        "positions are 0.10 m from each other, expected at least limits.separation, 0.2 m"
    )


def test_a_circle_that_is_too_small_is_reported_at_its_radius() -> None:
    ((path, _),) = problems_of(shape="circle", centre=CENTRE, radius=0.1)
    assert path == ("radius",)


def test_points_too_close_are_reported_at_the_later_point() -> None:
    ((path, message),) = problems_of(shape="points", points=[[0, 0, 1], [1, 0, 1], [0, 0.1, 1]])
    assert path == ("points", 2)
    assert message.startswith("positions are 0.10 m from point 1")


def test_without_separation_positions_may_be_close() -> None:
    room = replace(ROOM, limits=Limits(separation=0.0))
    assert problems_of(room, shape="line", centre=CENTRE, spacing=0.05) == []
