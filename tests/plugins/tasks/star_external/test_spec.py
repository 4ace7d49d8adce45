"""What the verb ``external`` announces, and what is wrong with its options."""

from __future__ import annotations

import logging
import re
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from star_core import Task, TaskSpec
from star_core.testing import scene
from star_core.toolkit import fill_defaults
from tests.plugins.tasks.star_external.conftest import offered

ROOM = scene(2)
NEVER_MADE: Any = object


@pytest.fixture
def offer() -> TaskSpec:
    return offered()


def made(spec: TaskSpec, rows: tuple[int, ...] = (0,), **options: Any) -> Task:
    return spec.make(ROOM, rows, **fill_defaults(options, spec.options))


def problems_of(*planners: str, **options: Any) -> list[tuple[tuple[str | int, ...], str]]:
    spec = offered(**dict.fromkeys(planners, NEVER_MADE))
    filled = fill_defaults(options, spec.options)
    assert spec.check is not None
    return [(problem.path, problem.message) for problem in spec.check(ROOM, (0, 1), **filled)]


def test_steps_of_one_flight_share_a_port_which_the_next_flight_can_open(offer: TaskSpec) -> None:
    for _flight in range(2):
        first: Any = made(offer, port=0)
        second: Any = made(offer, (1,), port=0)
        assert first._source.server.address == second._source.server.address
        assert first._source.server.address[0] == "127.0.0.1"
        first.close()
        second.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, r"external: listens on 127\.0\.0\.1:\d+"),
        (
            {"listen": "0.0.0.0"},  # noqa: S104 -- what it is about
            r'.*0\.0\.0\.0:\d+ must send {"token": "[0-9a-f]{16}"} first.*',
        ),
    ],
    ids=["a free port that was chosen", "open to other hosts"],
)
def test_ports_are_logged(
    offer: TaskSpec, caplog: pytest.LogCaptureFixture, options: dict[str, Any], words: str
) -> None:
    with caplog.at_level(logging.WARNING):
        task: Any = made(offer, port=0, **options)
    task.close()
    assert re.fullmatch(words, caplog.messages[-1])


def test_planners_that_are_not_installed_are_refused() -> None:
    (problem,) = problems_of(planner="orbit")
    assert problem == (("planner",), "no external planner named 'orbit'")


def test_valid_options_have_no_problem() -> None:
    assert problems_of(listen="0.0.0.0", max_silence=1, rate=2, port=0) == []  # noqa: S104 -- an option


def test_installed_planners_are_offered() -> None:
    made = offered(orbit=NEVER_MADE, spiral=NEVER_MADE)
    assert made.options["properties"]["planner"]["enum"] == ["orbit", "spiral"]


def test_the_schema_without_planners_is_valid() -> None:
    Draft202012Validator.check_schema(offered().options)


def test_two_planners_of_one_name_are_refused() -> None:
    assert problems_of("orbit", "their_orbit", planner="orbit") == [
        (
            ("planner",),
            "two plugins offer external planner 'orbit': orbit-dist 1.0:orbit and "
            "their-orbit-dist 1.0:their_orbit; uninstall one",
        )
    ]


@pytest.mark.parametrize(
    ("option", "value"),
    [("port", 5800), ("on_silence", "fail"), ("lockstep", False)],
)
def test_options_of_another_process_are_refused_with_a_planner(option: str, value: object) -> None:
    assert problems_of("orbit", planner="orbit", **{option: value}) == [
        (
            (option,),
            f"{option!r} applies to another process, but planner 'orbit' runs in this one; "
            "remove one of the two",
        )
    ]


def test_a_planner_may_have_any_rate() -> None:
    assert problems_of("orbit", planner="orbit", rate=0.1) == []
