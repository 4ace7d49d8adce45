"""Missions, studies and worlds that come with STAR are found by their names."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from star_core import Registry, load
from star_core.commands.main import main
from star_yaml.input_file import read, shipped_files
from tests.commands import problem_lines


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_mission_is_loaded_by_its_name_with_its_world() -> None:
    mission = load("first_flight", Registry())
    assert mission.name == "first-flight"
    assert mission.scene.world.name == "lab-4x4"


def test_studies_and_worlds_have_names_too(missions: Path) -> None:
    assert read(Path("studies/avoiders")).path == missions / "studies" / "avoiders.yaml"
    assert main(["check", "worlds/lab_4x4"]) == 0


def test_a_file_of_that_name_is_used_instead(missions: Path) -> None:
    shutil.copy(missions / "paper_box.yaml", "first_flight")
    assert read(Path("first_flight")).data["name"] == "paper-box"


def test_an_unknown_name_is_refused_with_the_nearest_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["check", "first_fligth"]) == 2
    assert problem_lines(capsys.readouterr().err) == [
        "first_fligth: no file and no mission of that name; did you mean 'first_flight'? "
        "[unknown-mission]"
    ]
    assert main(["run", "swap"]) == 2
    assert "`star missions` lists those that come with STAR" in capsys.readouterr().err


def test_a_missing_file_with_a_suffix_is_a_missing_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "missions/first_flight.yaml"]) == 2
    assert main(["check", "mine.yaml"]) == 2
    assert problem_lines(capsys.readouterr().err) == [
        "missions/first_flight.yaml: no such file; 'first_flight', without a suffix, comes with "
        "STAR [file-not-found]",
        "mine.yaml: no such file [file-not-found]",
    ]


def test_all_are_listed_with_a_description(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["missions"]) == 0
    lines = capsys.readouterr().out.splitlines()
    listed = [match[1] for line in lines if (match := re.match(r"  (\S+)  +[A-Z0-9]", line))]
    assert listed == list(shipped_files())
    assert any(
        re.match(r"  first_flight +Three drones take off, swap places across", x) for x in lines
    )
