"""What the verbs announce."""

from __future__ import annotations

import inspect
import subprocess
import sys
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import star_verbs
from star_core import Offer, Task
from star_core.testing import scene
from star_verbs.offers import OFFERS

by_name = pytest.mark.parametrize("offer", OFFERS, ids=lambda offer: offer.name)
LEAST: dict[str, dict[str, Any]] = {
    "goto": {"by": [0.0, 0.0, 0.1]},
    "formation": {"shape": "line", "centre": [0.0, 0.0, 0.8]},
    "follow": {"path": "box", "size": 1.0, "centre": [0.0, 0.0, 0.8]},
}


def test_there_are_nine_verbs() -> None:
    assert [offer.name for offer in star_verbs.star_tasks()] == [
        "takeoff", "land", "hold", "join", "leave", "wait", "goto", "follow", "formation",
    ]  # fmt: skip


@by_name
def test_the_schema_is_a_schema(offer: Offer[Task]) -> None:
    Draft202012Validator.check_schema(offer.options)
    for option in offer.options["properties"].values():
        assert option["description"].endswith(".")
        values = option.get("examples", []) + ([option["default"]] if "default" in option else [])
        for value in values:
            Draft202012Validator(option).validate(value)


@by_name
def test_defaults_are_those_of_the_schema(offer: Offer[Task]) -> None:
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
def test_what_is_made_is_a_task(offer: Offer[Task]) -> None:
    assert isinstance(offer.make(scene(1), (0,), **LEAST.get(offer.name, {})), Task)


def test_announcing_and_checking_verbs_imports_no_numpy() -> None:
    code = (
        "import sys; from pathlib import Path; import star_verbs\n"
        "from star_core import Agent, Fence, Scene, World\n"
        "offers = {offer.name: offer for offer in star_verbs.star_tasks()}\n"
        "world = World('room', Fence((-5, -5, 0), (5, 5, 3)))\n"
        "scene = Scene((Agent('a', (0, 0, 0)), Agent('b', (1, 0, 0))), 0.05, world)\n"
        "assert not list(offers['goto'].check(scene, (0, 1), to=[0, 0, 1]))\n"
        "options = {'path': 'figure8', 'size': 4, 'centre': [0, 0, 1]}\n"
        "assert not list(offers['follow'].check(scene, (0, 1), **options))\n"
        "assert 'numpy' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
