"""An offer whose options are no JSON Schema is left out, and grounds who uses it only."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import TypeAlias

import pytest

Run: TypeAlias = Callable[..., CompletedProcess[str]]


@pytest.fixture(scope="module", autouse=True)
def crooked(beside: Callable[[str], None]) -> None:
    beside("star-crooked")


def test_it_is_listed_as_left_out_by_name(run: Run) -> None:
    done = run("star", "plugins")
    assert done.returncode == 0
    (line,) = (line for line in done.stdout.splitlines() if "star-crooked 0.3:crooked" in line)
    assert line.startswith("left out: ")
    assert "avoider 'bent'" in line


def test_a_mission_that_does_not_use_it_flies(run: Run, mission: Path) -> None:
    done = run("star", "run", mission.name, "--no-record")
    assert done.returncode == 0, done.stderr


def test_a_mission_that_uses_it_is_refused_and_told_whose_it_is(run: Run, mission: Path) -> None:
    done = run("star", "run", mission.name, "--set", "avoider=bent")
    assert done.returncode == 2
    assert "'bent'" in done.stderr
    assert "star-crooked 0.3:crooked" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_schema_for_editors_is_written_without_it(run: Run) -> None:
    done = run("star", "schema")
    assert done.returncode == 0
    assert "bent" not in done.stdout
