"""A plugin that cannot be imported is named, and grounds nobody."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import TypeAlias

import pytest

Run: TypeAlias = Callable[..., CompletedProcess[str]]
SOURCE = "star-broken 0.1:broken"
REASON = "ImportError: this plugin wants a gripper"


@pytest.fixture(scope="module", autouse=True)
def broken(beside: Callable[[str], None]) -> None:
    beside("star-broken")


def test_it_is_listed_by_name_with_the_reason(run: Run) -> None:
    done = run("star", "plugins")
    assert done.returncode == 0
    assert f"left out: {SOURCE}: {REASON}" in done.stdout.splitlines()


def test_missions_fly_all_the_same_and_say_what_is_left_out(run: Run, mission: Path) -> None:
    done = run("star", "run", mission.name, "--no-record", "--json")
    assert done.returncode == 0
    assert f"star: plugin {SOURCE} is left out: {REASON}" in done.stderr.splitlines()
