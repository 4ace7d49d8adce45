"""What the verb announces; the corpus has what its check finds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import star_search
from star_core import PluginError, Registry, Task, TaskSpec, deferred, hookimpl
from star_core.toolkit import fill_defaults
from star_search.frontier import Frontier
from star_search.pattern import SearchPatternSpec
from tests.plugins.tasks.star_search.conftest import SPEC, hall


def filled(options: dict[str, Any]) -> dict[str, Any]:
    return fill_defaults(options, SPEC.options)


@pytest.mark.parametrize(
    "area",
    [[[0, 0], [1, 0]], {"low": [0, 0]}, {"low": [0, 0], "high": [1, 1], "x": 1}, [[0], [1], [2]]],
)
def test_the_schema_refuses_what_is_no_area(area: Any) -> None:
    assert not Draft202012Validator(SPEC.options).is_valid({"area": area})


def test_make_returns_a_task() -> None:
    assert isinstance(SPEC.make(hall(), (0,), **filled({"pattern": "frontier"})), Task)


class Offering:
    """A plugin that offers a search pattern."""

    def __init__(self, make: Any, name: str = "theirs") -> None:
        self._spec = SearchPatternSpec(name=name, summary="all at once", make=make)

    @hookimpl
    def star_search_patterns(self) -> Iterable[SearchPatternSpec]:
        yield self._spec


def offered(*plugins: object) -> TaskSpec:
    spec: TaskSpec = Registry(*plugins, star_search, installed=False).find("task", "search").offer
    return spec


def test_an_installed_pattern_is_offered_and_made() -> None:
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
def test_an_invalid_pattern_is_named(make: Any, message: str) -> None:
    plugin = Offering(make)
    with pytest.raises(PluginError) as raised:
        offered(plugin).make(hall(), (0,), **filled({"pattern": "theirs"}))
    assert str(raised.value).startswith(f"search pattern 'theirs' ({__name__}:Offering): {message}")


def test_two_patterns_of_one_name_are_refused() -> None:
    check = offered(Offering(Frontier, "sweep")).check
    assert check is not None
    (problem,) = check(hall(), (0, 1), **filled({}))
    assert (problem.path, problem.code) == (("pattern",), "duplicate-plugin")
