"""What is wrong with a formation before anybody flies; the corpus has the other problems."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from star_core import Limits, Scene
from star_core.testing import scene
from star_core.toolkit import fill_defaults
from star_verbs.formation.spec import OPTIONS, check

ROOM = scene(3)
CENTRE = [0.0, 0.0, 0.8]


def problems_of(room: Scene = ROOM, **options: Any) -> list[tuple[tuple[str | int, ...], str]]:
    rows = tuple(range(len(room.agents)))
    filled = fill_defaults(options, OPTIONS)
    return [(problem.path, problem.message) for problem in check(room, rows, **filled)]


@pytest.mark.parametrize(
    ("options", "path", "message"),
    [
        (
            {"shape": "points", "points": [CENTRE] * 3, "spacing": 1.0},
            ("spacing",),
            "'spacing' goes with shape 'line' or 'grid' or 'circle', not with 'points'",
        ),
        (
            {"shape": "circle", "centre": CENTRE, "radius": 0.1},
            ("radius",),
            "positions are 0.17 m from each other",
        ),
    ],
)
def test_a_formation_that_cannot_be_flown_is_refused(
    options: dict[str, Any], path: tuple[str | int, ...], message: str
) -> None:
    (problem,) = problems_of(**options)
    assert problem[0] == path
    assert problem[1].startswith(message)


def test_a_move_out_of_the_fence_is_reported_for_each_position() -> None:
    problems = problems_of(shape="line", centre=CENTRE, spacing=1.0, move={"to": [9.5, 0.0, 0.8]})
    assert [path for path, _ in problems] == [("move", "to")]


def test_without_separation_positions_may_be_close() -> None:
    room = replace(ROOM, limits=Limits(separation=0.0))
    assert problems_of(room, shape="line", centre=CENTRE, spacing=0.05) == []
