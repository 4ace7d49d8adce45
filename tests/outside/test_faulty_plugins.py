"""Third-party plugins with a fault are named, and affect only the missions that use them.

`star-broken` cannot be imported, `star-crooked` has an avoider whose options are no JSON Schema,
and `star-rival` has one with the name of star-gentle's.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import TypeAlias

import pytest

pytestmark = pytest.mark.extended

Run: TypeAlias = Callable[..., CompletedProcess[str]]
BROKEN = "star-broken 0.1:broken"
REASON = "ImportError: this plugin wants a gripper"


@pytest.fixture(scope="module", autouse=True)
def faulty(beside: Callable[..., None]) -> None:
    beside("star-broken", "star-crooked", "star-rival")


def test_all_are_listed_with_the_reason(run: Run) -> None:
    done = run("star", "plugins")
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert f"left out: {BROKEN}: {REASON}" in lines
    (crooked,) = (line for line in lines if "star-crooked 0.3:crooked" in line)
    assert crooked.startswith("left out: ")
    assert "avoider 'bent'" in crooked
    whose = {line.split("[")[1] for line in lines if line.split()[:1] == ["gentle"]}
    assert whose == {"star-rival 2.0:gentle]", "star-gentle 0.1.0:gentle]"}


def test_missions_without_faulty_plugins_fly_and_report_them(run: Run, mission: Path) -> None:
    done = run("star", "run", mission.name, "--no-record", "--set", "avoider=none")
    assert done.returncode == 0, done.stderr
    assert f"star: plugin {BROKEN} is left out: {REASON}" in done.stderr.splitlines()
    assert "goes without" not in done.stderr
    assert run("star", "check", mission.name, "--set", "avoider=none").returncode == 0


def test_missions_with_an_invalid_plugin_name_its_distribution(run: Run, mission: Path) -> None:
    mission.write_text(mission.read_text().replace("{use: gentle, radius: 0.4}", "bent"))
    done = run("star", "check", mission.name)
    assert done.returncode == 2
    assert "'bent'" in done.stderr
    assert "star-crooked 0.3:crooked" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("options", ["", ", radius: 0.4"])
def test_ambiguous_plugin_names_are_refused_naming_both(
    run: Run, mission: Path, options: str
) -> None:
    mission.write_text(mission.read_text().replace(", radius: 0.4", options))
    done = run("star", "check", mission.name)
    assert done.returncode == 2
    assert "two plugins offer avoider 'gentle': " in done.stderr
    assert "star-gentle 0.1.0:gentle" in done.stderr
    assert "star-rival 2.0:gentle" in done.stderr


def test_editor_schema_omits_invalid_plugins(run: Run) -> None:
    done = run("star", "schema")
    assert done.returncode == 0
    assert "bent" not in done.stdout
