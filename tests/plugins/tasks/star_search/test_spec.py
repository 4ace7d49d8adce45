"""What the verb announces, and what its check visits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import star_search
from star_core import PluginError, Registry, Task, TaskSpec, deferred, hookimpl
from star_core.toolkit import fill_defaults
from star_search.frontier import Frontier
from star_search.pattern import SearchPatternSpec
from tests.plugins.tasks.star_search.conftest import SPEC


def filled(options: dict[str, Any]) -> dict[str, Any]:
    return fill_defaults(options, SPEC.options)


def problems(scene: Any, **options: Any) -> list[tuple[tuple[str | int, ...], str]]:
    check = SPEC.check
    assert check is not None
    rows = tuple(range(len(scene.agents)))
    return [(problem.path, problem.message) for problem in check(scene, rows, **filled(options))]


@pytest.mark.parametrize(
    "area",
    [[[0, 0], [1, 0]], {"low": [0, 0]}, {"low": [0, 0], "high": [1, 1], "x": 1}, [[0], [1], [2]]],
)
def test_the_schema_refuses_what_is_no_area(area: Any) -> None:
    assert not Draft202012Validator(SPEC.options).is_valid({"area": area})


def test_a_good_search_has_no_problem(hall: Any) -> None:
    assert (
        problems(hall(targets={"red": (1, 1)}), targets=["red"], lane_spacing=1.0, height=0.7) == []
    )


@pytest.mark.parametrize(
    ("changes", "options", "path", "message"),
    [
        ({"camera": None}, {}, (), "cf1, cf2 have no camera to search with; give agents"),
        (
            {},
            {"area": {"low": [-1, -1], "high": [1, 5]}},
            ("area", "high"),
            "[1, 5] is outside the fence",
        ),
        ({}, {"height": 1.8}, ("height",), "from 1.8 m at 0.3 m/s, 'cf1' resolves no tag"),
        ({}, {"lane_spacing": 2.0}, ("lane_spacing",), "2 m is more than the 1.35 m in which"),
        ({}, {"clearance": 2.0}, ("clearance",), "2 m on both sides leave nothing of the fence's"),
        (
            {"targets": {"red": (1, 1)}},
            {"targets": 2},
            ("targets",),
            "2 is more than the 1 targets of the world",
        ),
    ],
)
def test_a_search_that_cannot_be_flown_is_refused(
    hall: Any, changes: dict[str, Any], options: dict[str, Any], path: Any, message: str
) -> None:
    (problem,) = problems(hall(**changes), **options)
    assert problem[0] == path
    assert problem[1].startswith(message)


def test_a_height_outside_the_limits_is_refused(hall: Any) -> None:
    low = replace(hall(), limits=replace(hall().limits, height=(0.2, 0.5)))
    ((path, message),) = problems(low)
    assert path == ("height",)
    assert message == "0.8 m is outside the heights to fly at, from 0.2 to 0.5 m"


def test_an_unknown_target_is_refused_with_a_suggestion(hall: Any) -> None:
    room = hall(targets={"red": (1, 1), "blue": (-1, 1)})
    ((path, message),) = problems(room, targets=["blue", "rde"])
    assert (path, message) == (("targets", 1), "no target named 'rde'; did you mean 'red'?")
    ((_, message),) = problems(room, targets=["xyz"])
    assert message == "no target named 'xyz'; there are: red, blue"


def test_make_returns_a_task(hall: Any) -> None:
    assert isinstance(SPEC.make(hall(), (0,), **filled({"pattern": "frontier"})), Task)


class Offering:
    """A plugin that offers a search pattern."""

    def __init__(self, make: Any, name: str = "theirs") -> None:
        self._spec = SearchPatternSpec(name=name, summary="all at once", make=make)

    @hookimpl
    def star_search_patterns(self) -> Iterable[SearchPatternSpec]:
        yield self._spec


def offered(*plugins: object) -> TaskSpec:
    found: TaskSpec = Registry(*plugins, star_search, installed=False).find("task", "search").offer
    return found


def test_an_installed_pattern_is_offered_and_made(hall: Any) -> None:
    theirs = offered(Offering(Frontier))
    option = theirs.options["properties"]["pattern"]
    assert option["enum"] == ["frontier", "sweep", "theirs"]
    assert "theirs: all at once" in option["description"]
    assert isinstance(theirs.make(hall(), (0,), **filled({"pattern": "theirs"})), Task)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (deferred("star_nowhere:Spiral"), "ModuleNotFoundError: No module named 'star_nowhere'"),
        (id, "made int, expected begin(estimate"),
    ],
)
def test_an_invalid_pattern_is_named(make: Any, message: str, hall: Any) -> None:
    plugin = Offering(make)
    with pytest.raises(PluginError) as raised:
        offered(plugin).make(hall(), (0,), **filled({"pattern": "theirs"}))
    assert str(raised.value).startswith(f"search pattern 'theirs' ({__name__}:Offering): {message}")


def test_two_patterns_of_one_name_are_refused(hall: Any) -> None:
    check = offered(Offering(Frontier, "sweep")).check
    assert check is not None
    (problem,) = check(hall(), (0, 1), **filled({}))
    assert (problem.path, problem.code) == (("pattern",), "duplicate-plugin")
