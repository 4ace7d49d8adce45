"""What `star new` writes works at once."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from star_core import Registry, fly, load
from star_core.commands.main import main
from star_new.command import KINDS
from tests.commands import Printed


@pytest.fixture(autouse=True)
def _in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_new_mission_is_checked_and_flies(capsys: Printed) -> None:
    assert main(["new", "mission", "patrol"]) == 0
    assert capsys.readouterr().out == "patrol.yaml\npatrol_world.yaml\nnext: star run patrol.yaml\n"
    assert main(["check", "patrol.yaml"]) == 0
    assert main(["run", "patrol.yaml", "--no-record"]) == 0


def test_a_new_study_is_checked_with_its_mission(capsys: Printed) -> None:
    assert main(["new", "study", "radii"]) == 0
    assert main(["check", "--strict", "."]) == 0
    assert "radii.yaml: 'radii', a study of 15 runs\n" in capsys.readouterr().out


def test_a_new_world_is_checked() -> None:
    assert main(["new", "world", "lab"]) == 0
    assert main(["check", "lab.yaml"]) == 0


@pytest.mark.extended
def test_new_plugins_of_every_kind_pass_their_own_tests(tmp_path: Path) -> None:
    folders = []
    for kind in KINDS:
        assert main(["new", "plugin", f"my-{kind}", "--kind", kind]) == 0
        folder = tmp_path / f"star-my-{kind}"
        _install(folder)
        for mission in {*folder.glob("*.yaml")} - {*folder.glob("*_world.yaml")}:
            mission.write_text(mission.read_text() + "rate: 8\n")  # for shorter tests
        folders.append(folder)
    path = os.pathsep.join(map(str, folders))
    tests = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *map(str, folders)],
        env={**os.environ, "PYTHONPATH": path},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert tests.returncode == 0, tests.stdout + tests.stderr
    assert "17 passed" in tests.stdout


def test_a_new_observer_sees_a_flight_that_is_not_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(["new", "plugin", "fastest", "--kind", "observer"]) == 0
    monkeypatch.syspath_prepend("star-fastest")
    registry = Registry(import_module("star_fastest"))
    summary = fly(load("star-fastest/fastest.yaml", registry), registry)
    assert summary["outcome"] == "completed"
    assert summary["fastest"]["cf1"] > 0.3
    assert [event["text"] for event in summary["events"] if event["kind"] == "observer"] == []


def test_a_verb_may_be_called_a_task(capsys: Printed) -> None:
    assert main(["new", "plugin", "nod", "--kind", "task"]) == 0
    assert "star-nod/star_nod/verb.py" in capsys.readouterr().out


def _install(folder: Path) -> None:
    """Do what `pip install -e` does, without it."""
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    lines = [f"Name: {project['name']}", f"Version: {project['version']}", "Metadata-Version: 2.1"]
    (info / "METADATA").write_text("\n".join(lines) + "\n")
    lines = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in points.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")


def test_nothing_is_written_over(tmp_path: Path, capsys: Printed) -> None:
    (tmp_path / "lab_world.yaml").write_text("mine")
    assert main(["new", "mission", "lab"]) == 2
    assert "lab_world.yaml: exists already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["lab_world.yaml"]


@pytest.mark.parametrize("name", ["Lab", "1st", "a b", "../up", "a--b", ""])
def test_names_that_nothing_can_have_are_refused(
    name: str, tmp_path: Path, capsys: Printed
) -> None:
    assert main(["new", "world", name]) == 2
    assert "[invalid-name]" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_plugin_of_star_is_not_made_again(tmp_path: Path, capsys: Printed) -> None:
    assert main(["new", "plugin", "orca", "--kind", "avoider"]) == 2
    assert capsys.readouterr().err.endswith("choose another name [duplicate-name]\n")
    assert not list(tmp_path.iterdir())


def test_a_plugin_needs_a_kind(capsys: Printed) -> None:
    assert main(["new", "plugin", "mine"]) == 2
    assert "[missing-option]" in capsys.readouterr().err
