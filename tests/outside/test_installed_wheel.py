"""Everything a first hour needs is in the wheel: missions by name, and what `star new` writes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import TypeAlias

import pytest

from star_new.command import KINDS

pytestmark = pytest.mark.extended

Run: TypeAlias = Callable[..., CompletedProcess[str]]


WITHOUT_KERNELS = ("--set", "transport=points", "--set", "avoider=none")


def test_shipped_missions_are_found_with_all_files_they_use(run: Run) -> None:
    names = ("first_flight", "each_own_pace", "worlds/lab_4x4")
    checked = run("star", "check", *names)
    problems = [line for line in checked.stderr.splitlines() if not line.startswith("checking")]
    assert (checked.returncode, problems) == (0, [])
    lines = checked.stdout.splitlines()
    assert [line.partition(": ")[0] for line in lines[: len(names)]] == [*names]


def test_a_shipped_mission_is_explained_and_flown_by_name(run: Run) -> None:
    assert "takeoff" in run("star", "explain", "until_low").stdout
    short = ("--no-record", *WITHOUT_KERNELS, "--set", "mission.2.wait.until={elapsed: 1}")
    flown = run("star", "run", "handover", *short)
    assert (flown.returncode, flown.stdout.splitlines()[0]) == (0, "handover: completed")


def test_a_new_mission_flies_and_a_new_world_is_checked(run: Run) -> None:
    assert run("star", "new", "mission", "patrol").returncode == 0
    assert run("star", "run", "patrol.yaml", "--no-record", *WITHOUT_KERNELS).returncode == 0
    assert run("star", "new", "world", "hall").returncode == 0
    assert run("star", "check", "hall.yaml").returncode == 0


@pytest.mark.campaign
def test_generated_plugins_of_every_kind_pass_their_tests(
    run: Run, bin_folder: Path, mission: Path
) -> None:
    folders = [mission.parent / f"star-my-{kind}" for kind in KINDS]
    for kind in KINDS:
        assert run("star", "new", "plugin", f"my-{kind}", "--kind", kind).returncode == 0
    pip = [sys.executable, "-m", "pip", "--quiet"]
    install = [*pip, "install", "--no-deps", "--no-build-isolation", "--target"]
    target = mission.parent / "installed"
    subprocess.run([*install, str(target), *map(str, folders)], check=True)
    tests = subprocess.run(
        [bin_folder / "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", *folders],
        env=os.environ | {"PYTHONPATH": str(target)},
        cwd=mission.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert tests.returncode == 0, tests.stdout + tests.stderr
    assert "15 passed" in tests.stdout
    assert all((folder / "README.md").is_file() for folder in folders)
