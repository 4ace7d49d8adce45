"""Two plugins that offer one name are in the way of missions that use it, and of no other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import TypeAlias

import pytest

Run: TypeAlias = Callable[..., CompletedProcess[str]]


@pytest.fixture(scope="module", autouse=True)
def rival(beside: Callable[[str], None]) -> None:
    beside("star-rival")


@pytest.mark.parametrize("options", ["", ", share: 0.8"])
def test_a_mission_that_uses_the_name_is_refused_and_both_are_named(
    run: Run, mission: Path, options: str
) -> None:
    mission.write_text(mission.read_text().replace(", share: 0.8", options))
    done = run("star", "run", mission.name)
    assert done.returncode == 2
    assert "two plugins offer" in done.stderr
    assert "two plugins offer avoider 'gentle': " in done.stderr
    assert "star-outside 1.2.3:outside" in done.stderr
    assert "star-rival 2.0:gentle" in done.stderr


def test_a_mission_that_does_not_use_the_name_flies(run: Run, mission: Path) -> None:
    done = run("star", "run", mission.name, "--no-record", "--set", "avoider=none")
    assert done.returncode == 0, done.stderr


def test_both_are_listed(run: Run) -> None:
    lines = run("star", "plugins").stdout.splitlines()
    whose = [line.split("[")[1] for line in lines if line.split()[:1] == ["gentle"]]
    assert whose == ["star-rival 2.0:gentle]", "star-outside 1.2.3:outside]"]
