"""What verbs expect of their steps, as ``star check`` prints it."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from star_core import InputError, Registry, TaskSpec, hookimpl
from star_yaml.check_file import check_file

MISSION = """
star: 1
name: hop
world: world.yaml
swarm: {cf1: {start: [0, 0, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: none
mission: [hum: {}]
"""
WORLD = "{star: 1, name: world, fence: {low: [-1, -1, 0], high: [1, 1, 2]}}"


class Hum:
    """Offers a verb with a function that states what to expect."""

    def __init__(self, expects: Callable[..., Iterable[str]]) -> None:
        self._expects = expects

    @hookimpl
    def star_tasks(self) -> Iterable[TaskSpec]:
        yield TaskSpec(name="hum", summary="Hums.", make=_make, options={}, expects=self._expects)


def _make(_scene: object, _rows: object) -> Any:
    raise RuntimeError("not for a flight")


def check(folder: Path, expects: Callable[..., Any]) -> str:
    (folder / "world.yaml").write_text(WORLD)
    (folder / "hop.yaml").write_text(MISSION)
    return check_file(folder / "hop.yaml", Registry(Hum(expects)))[0]


def raises(_scene: object, _rows: object) -> Iterable[str]:
    raise RuntimeError("out of words")


def exits(_scene: object, _rows: object) -> Iterable[str]:
    sys.exit(3)


def panics(_scene: object, _rows: object) -> Iterable[str]:
    raise asyncio.CancelledError("panic")


def generates(_scene: object, _rows: object) -> Iterator[str]:
    yield "a tune"
    raise RuntimeError("out of words")


def test_what_a_verb_expects_is_printed(tmp_path: Path) -> None:
    assert check(tmp_path, lambda *_: ["a tune"]).endswith("with 1 agent; a tune")


@pytest.mark.parametrize(
    ("expects", "why"),
    [
        (raises, "RuntimeError: out of words ("),
        (exits, "SystemExit: 3 ("),
        (panics, "CancelledError: panic ("),
        (generates, "RuntimeError: out of words ("),
        (lambda *_: None, "TypeError: 'NoneType' object is not iterable ("),
    ],
    ids=["raises", "exits", "panics", "generator raises", "nothing"],
)
def test_a_verb_that_fails_to_expect_is_named_at_its_step(
    tmp_path: Path, expects: Callable[..., Any], why: str
) -> None:
    with pytest.raises(InputError) as caught:
        check(tmp_path, expects)
    (problem,) = caught.value.problems
    assert ":10:16: task 'hum' (" in problem
    assert why in problem
    assert problem.endswith(" [plugin-failed]")
