"""What the verb ``formation`` announces."""

from __future__ import annotations

import inspect
import subprocess
import sys

from jsonschema import Draft202012Validator

import star_verbs
from star_core import Task
from star_core.testing import scene
from star_verbs.formation.offer import OFFER, make


def test_it_is_one_of_the_verbs() -> None:
    assert OFFER in star_verbs.star_tasks()


def test_the_schema_is_a_schema_and_its_examples_fit() -> None:
    Draft202012Validator.check_schema(OFFER.options)
    for option in OFFER.options["properties"].values():
        assert option["description"].endswith(".")
        values = option.get("examples", []) + ([option["default"]] if "default" in option else [])
        for value in values:
            Draft202012Validator(option).validate(value)


def test_defaults_are_those_of_the_schema() -> None:
    for name, parameter in inspect.signature(make).parameters.items():
        if parameter.default not in (inspect.Parameter.empty, None):
            assert parameter.default == OFFER.options["properties"][name]["default"]


def test_what_is_made_is_a_task() -> None:
    assert isinstance(make(scene(1), (0,), shape="line", centre=[0, 0, 1]), Task)


def test_announcing_and_checking_it_imports_no_numpy() -> None:
    code = (
        "import sys, star_verbs\n"
        "from star_core import Agent, Fence, Scene, World\n"
        "offer = next(o for o in star_verbs.star_tasks() if o.name == 'formation')\n"
        "scene = Scene((Agent('a', (0, 0, 0)),), 0.05, World('r', Fence((-5, -5, 0), (5, 5, 3))))\n"
        "move = {'to': [1, 0, 1]}\n"
        "assert not list(offer.check(scene, (0,), shape='line', centre=[0, 0, 1], move=move))\n"
        "assert 'numpy' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
