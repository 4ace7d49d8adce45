"""What the verb announces, and what its check visits."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import EntryPoint
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from star_core import PluginError, Task
from star_core.toolkit import fill_defaults
from star_search import pattern
from star_search.spec import make, spec


def filled(options: dict[str, Any]) -> dict[str, Any]:
    return fill_defaults(options, spec().options)


def problems(scene: Any, **options: Any) -> list[tuple[tuple[str | int, ...], str]]:
    check = spec().check
    assert check is not None
    rows = tuple(range(len(scene.agents)))
    return [(problem.path, problem.message) for problem in check(scene, rows, **filled(options))]


@pytest.mark.parametrize(
    "area",
    [[[0, 0], [1, 0]], {"low": [0, 0]}, {"low": [0, 0], "high": [1, 1], "x": 1}, [[0], [1], [2]]],
)
def test_the_schema_refuses_what_is_no_area(area: Any) -> None:
    assert not Draft202012Validator(spec().options).is_valid({"area": area})


def test_a_good_search_has_no_problem(hall: Any) -> None:
    assert (
        problems(hall(targets={"red": (1, 1)}), targets=["red"], lane_spacing=1.0, height=0.7) == []
    )


def test_agents_without_a_camera_are_refused(hall: Any) -> None:
    ((path, message),) = problems(hall(camera=None))
    assert path == ()
    assert message == (
        "cf1, cf2 have no camera to search with; give agents `camera: aideck`, "
        "or name those that have one"
    )


def test_an_invalid_area_is_refused_at_its_corner(hall: Any) -> None:
    ((path, message),) = problems(hall(), area={"low": [-1, -1], "high": [1, 5]})
    assert path == ("area", "high")
    assert message.startswith("[1, 5] is outside the fence")


def test_a_height_outside_the_limits_is_refused(hall: Any) -> None:
    low = replace(hall(), limits=replace(hall().limits, height=(0.2, 0.5)))
    ((path, message),) = problems(low)
    assert path == ("height",)
    assert message == "0.8 m is outside the heights to fly at, from 0.2 to 0.5 m"


def test_a_height_from_which_no_tag_is_resolved_is_refused(hall: Any) -> None:
    ((path, message),) = problems(hall(), height=1.8)
    assert path == ("height",)
    assert message.startswith("from 1.8 m at 0.3 m/s, 'cf1' resolves no tag on the floor")


def test_lanes_farther_apart_than_the_view_are_refused(hall: Any) -> None:
    ((path, message),) = problems(hall(), lane_spacing=2.0)
    assert path == ("lane_spacing",)
    assert message.startswith("2 m is more than the 1.35 m in which 'cf1' resolves tags")


def test_a_clearance_that_fills_the_fence_is_refused(hall: Any) -> None:
    ((path, message),) = problems(hall(), clearance=2.0)
    assert (path, message) == (
        ("clearance",), "2 m on both sides leave nothing of the fence's 4 m",
    )  # fmt: skip


def test_more_targets_than_the_world_has_are_refused(hall: Any) -> None:
    ((path, message),) = problems(hall(targets={"red": (1, 1)}), targets=2)
    assert (path, message) == (("targets",), "2 is more than the 1 targets of the world")


def test_an_unknown_target_is_refused_with_a_suggestion(hall: Any) -> None:
    room = hall(targets={"red": (1, 1), "blue": (-1, 1)})
    ((path, message),) = problems(room, targets=["blue", "rde"])
    assert (path, message) == (("targets", 1), "no target named 'rde'; did you mean 'red'?")
    ((_, message),) = problems(room, targets=["xyz"])
    assert message == "no target named 'xyz'; there are: red, blue"


def test_make_returns_a_task(hall: Any) -> None:
    assert isinstance(make(hall(), (0,), **filled({"pattern": "frontier"})), Task)


def test_an_installed_pattern_is_offered_and_made(hall: Any, monkeypatch: Any) -> None:
    theirs = EntryPoint("theirs", "star_search.frontier:Frontier", pattern.GROUP)
    monkeypatch.setattr(pattern, "permitted_entry_points", lambda _group: [theirs])
    pattern._installed.cache_clear()
    try:
        assert spec().options["properties"]["pattern"]["enum"] == ["frontier", "sweep", "theirs"]
        assert isinstance(make(hall(), (0,), **filled({"pattern": "theirs"})), Task)
    finally:
        pattern._installed.cache_clear()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("star_nowhere:Spiral", "search pattern 'theirs' (star_nowhere:Spiral): No module named"),
        ("builtins:id", "search pattern 'theirs' (builtins:id) made int, expected begin(estimate"),
    ],
)
def test_an_invalid_pattern_is_named(value: str, message: str, hall: Any, monkeypatch: Any) -> None:
    theirs = EntryPoint("theirs", value, pattern.GROUP)
    monkeypatch.setattr(pattern, "_installed", lambda: {"theirs": theirs})
    with pytest.raises(PluginError) as raised:
        make(hall(), (0,), **filled({"pattern": "theirs"}))
    assert str(raised.value).startswith(message)
