"""What is wrong with a formation before anybody flies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

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


@pytest.mark.parametrize(
    ("options", "path", "message"),
    [
        ({"shape": "line"}, (), "shape 'line' needs 'centre'"),
        ({"shape": "points", "centre": CENTRE}, (), "shape 'points' needs 'points'"),
        (
            {"shape": "line", "centre": CENTRE, "radius": 1.0},
            ("radius",),
            "'radius' goes with shape 'circle', not with 'line'",
        ),
        (
            {"shape": "points", "points": [CENTRE] * 3, "spacing": 1.0},
            ("spacing",),
            "'spacing' goes with shape 'line' or 'grid' or 'circle', not with 'points'",
        ),
        (
            {"shape": "circle", "centre": CENTRE, "radius": 1.0, "spacing": 0.5},
            ("spacing",),
            "'spacing' does not go with 'radius', expected one of them",
        ),
        (
            {"shape": "points", "points": [[0, 0, 1], [1, 0, 1]]},
            ("points",),
            "there are 2 points, expected one for each of 3",
        ),
        (
            {"shape": "grid", "centre": CENTRE, "rows": 1, "columns": 2},
            ("rows",),
            "1 x 2 positions are 2, expected 3: one for each agent",
        ),
        (
            {"shape": "line", "centre": [9.5, 0.0, 0.8], "spacing": 1.0},
            ("centre",),
            "position 3 of 3: [10.5, 0, 0.8] is outside the fence",
        ),
        (
            {"shape": "points", "points": [[0, 0, 1], [1, 0, 5], [2, 0, 1]]},
            ("points", 1),
            "[1, 0, 5] is outside the heights to fly at, from 0.2 to 1.8 m",
        ),
        (
            {"shape": "line", "centre": CENTRE, "spacing": 0.1},
            ("spacing",),
            "positions are 0.10 m from each other, expected at least limits.separation, 0.2 m",
        ),
        (
            {"shape": "circle", "centre": CENTRE, "radius": 0.1},
            ("radius",),
            "positions are 0.17 m from each other",
        ),
        (
            {"shape": "points", "points": [[0, 0, 1], [1, 0, 1], [0, 0.1, 1]]},
            ("points", 2),
            "positions are 0.10 m from point 1",
        ),
    ],
)
def test_a_formation_that_cannot_be_flown_is_refused(
    options: dict[str, Any], path: tuple[str | int, ...], message: str
) -> None:
    (problem,) = problems_of(**options)
    assert problem[0] == path
    assert problem[1].startswith(message)


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


def test_without_separation_positions_may_be_close() -> None:
    room = replace(ROOM, limits=Limits(separation=0.0))
    assert problems_of(room, shape="line", centre=CENTRE, spacing=0.05) == []
