"""Fixtures for the tests of plugins and missions; pytest loads them wherever STAR is installed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from star_core import Run, Scene


@pytest.fixture
def scene() -> Callable[..., Scene]:
    """Return `star_core.testing.scene`, which makes the scene of a number of agents."""
    from star_core.testing import scene

    return scene


@pytest.fixture
def fly(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., Run]:
    """Return a function that flies a mission and returns its record, as `read_run` does.

    ``fly(mission, *changes, plugins=())``: the mission's file, relative to that of the test, or the
    name of a mission that ``star missions`` lists; changes as of ``--set``; plugins that are not
    installed, such as observers.
    """
    from star_core import Registry, load, read_run
    from star_core import fly as fly_mission

    folders = (tmp_path / f"flight-{i}" for i in count(1))

    def flown(mission: str | Path, *changes: str, plugins: tuple[object, ...] = ()) -> Run:
        registry, folder = Registry(*plugins), next(folders)
        beside = request.path.parent / mission
        path = beside if beside.exists() else mission
        fly_mission(load(path, registry, changes), registry, folder=folder)
        return read_run(folder)

    return flown


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the times of the plugins that the checks of `star_core.testing` called."""
    testing = sys.modules.get("star_core.testing")
    for line in () if testing is None else testing.reports:
        terminalreporter.line(f"star: {line}")
