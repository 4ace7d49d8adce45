"""What the verbs announce."""

from __future__ import annotations

import inspect
from typing import Any

import pytest

from star_core import Task, TaskSpec
from star_core.testing import scene
from star_verbs.offers import OFFERS

by_name = pytest.mark.parametrize("offer", OFFERS, ids=lambda offer: offer.name)
LEAST: dict[str, dict[str, Any]] = {
    "goto": {"by": [0.0, 0.0, 0.1]},
    "formation": {"shape": "line", "centre": [0.0, 0.0, 0.8]},
    "follow": {"path": "box", "size": 1.0, "centre": [0.0, 0.0, 0.8]},
}


@by_name
def test_defaults_are_those_of_the_schema(offer: TaskSpec) -> None:
    taken = {
        name: parameter.default
        for name, parameter in inspect.signature(offer.make).parameters.items()
        if parameter.default not in (inspect.Parameter.empty, None)
    }
    said = {
        name: option["default"]
        for name, option in offer.options["properties"].items()
        if "default" in option
    }
    said.pop("for", None)  # a keyword of Python: the next test
    assert taken == said


def test_a_hold_without_a_time_takes_that_of_the_schema(make: Any, fly: Any) -> None:
    room = scene(1)
    (default,) = (
        offer.options["properties"]["for"]["default"] for offer in OFFERS if offer.name == "hold"
    )
    left, given = make("hold", room, (0,)), make("hold", room, (0,), **{"for": default})
    assert fly(left, room, [[0, 0, 1]]).time == fly(given, room, [[0, 0, 1]]).time


@by_name
def test_what_is_made_is_a_task(offer: TaskSpec) -> None:
    assert isinstance(offer.make(scene(1), (0,), **LEAST.get(offer.name, {})), Task)
