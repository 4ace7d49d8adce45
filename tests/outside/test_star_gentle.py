"""A third party's plugin works beside an installed STAR as the built-in ones do."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import TypeAlias

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from star_core.mission_file.yaml_reader import read

Run: TypeAlias = Callable[..., CompletedProcess[str]]


def change(mission: Path, old: str, new: str) -> str:
    """Write `new` for `old` into a mission, and return its place there."""
    before, after = mission.read_text().split(old)
    mission.write_text(before + new + after)
    return f"{mission.name}:{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"


def test_the_wheel_installs_nothing_but_packages_named_star(wheels: dict[str, Path]) -> None:
    with zipfile.ZipFile(wheels["star-swarm"]) as wheel:
        assert {name.split("_")[0] for name in wheel.namelist()} == {"star"}


def test_what_flies_is_the_wheel_and_not_the_checkout(run: Run, bin_folder: Path) -> None:
    done = run("python", "-c", "import star_core; print(star_core.__file__)")
    assert Path(done.stdout).is_relative_to(bin_folder.parent)


def test_its_verb_its_avoider_and_its_transport_fly_by_name_and_are_recorded(
    run: Run, mission: Path
) -> None:
    done = run("star-run", mission.name, "--out", "record")
    assert done.returncode == 0, done.stderr
    with np.load(mission.parent / "record" / "trajectory.npz") as record:
        height = record["estimate_position"][:, :, 2]
    climbed = np.diff(np.sign(height - 0.95), axis=0) > 0  # 0.8 and half a nod of 0.3
    assert climbed.sum(axis=0).tolist() == [1, 1]
    manifest = json.loads((mission.parent / "record" / "manifest.json").read_text())
    assert manifest["plugins"]["avoider"] == {
        "name": "gentle",
        "options": {"share": 0.8},
        "plugin": "star-gentle:gentle",
        "version": "1.0",
    }


def test_its_planner_leads_the_verb_external_by_name(run: Run, mission: Path) -> None:
    change(mission, "nod: {height: 0.3, timeout: 20}", "external: {planner: orbit}")
    done = run("star", "run", mission.name, "--out", "record")
    assert done.returncode == 0, done.stderr
    with np.load(mission.parent / "record" / "trajectory.npz") as record:
        x, y, _ = np.moveaxis(record["truth_position"], 2, 0)
    manifest = json.loads((mission.parent / "record" / "manifest.json").read_text())
    assert manifest["entry_points"] == {"star.external_planners": {"orbit": "star-gentle 1.0"}}
    turns = np.diff(np.unwrap(np.arctan2(y, x), axis=0)[[0, -1]], axis=0) / (2 * np.pi)
    assert turns[0] == pytest.approx([1, 1], abs=0.1)


def test_a_misspelt_planner_is_refused_at_its_place(run: Run, mission: Path) -> None:
    change(mission, "nod: {height: 0.3, timeout: 20}", "external: {planner: orbti}")
    done = run("star", "check", mission.name)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()[-1:]
    wrong = "external: planner: 'orbti' is not possible here; did you mean 'orbit'?"
    assert line.startswith(f"nod.yaml:14:25: {wrong} [")


def test_what_a_mission_sets_reaches_the_plugin(run: Run, mission: Path) -> None:
    change(mission, "share: 0.8", "share: 0")
    place = change(mission, "nod: {height: 0.3, timeout: 20}", "nod: {timeout: 2}")
    done = run("star", "run", mission.name, "--no-record", "--json")
    assert done.returncode == 1
    line = place.rpartition(":")[0]
    reason = json.loads(done.stdout)["reason"]
    assert reason.startswith(f"{line} nod cf1, cf2 failed: timed out after 2 s: ")


def test_they_are_listed_with_their_distribution_and_options(run: Run) -> None:
    listed = json.loads(run("star", "plugins", "--json").stdout)
    ours = [one for one in listed["plugins"] if one["plugin"] == "star-gentle:gentle"]
    assert [(one["kind"], one["name"], one["version"]) for one in ours] == [
        ("transport", "points", "1.0"),
        ("avoider", "gentle", "1.0"),
        ("task", "nod", "1.0"),
        ("command", "greet", "1.0"),
    ]
    assert [list(one["options"]["properties"]) for one in ours] == [
        [],
        ["share"],
        ["height"],
        [],
    ]


def test_no_plugin_is_left_out(run: Run) -> None:
    assert json.loads(run("star", "plugins", "--json").stdout)["broken"] == {}


def test_people_are_shown_the_same(run: Run) -> None:
    lines = run("star", "plugins").stdout.splitlines()
    (at,) = (i for i, line in enumerate(lines) if line.split()[:1] == ["gentle"])
    assert lines[at].endswith("[star-gentle 1.0:gentle]")
    described = run("star", "plugins", "gentle").stdout
    assert "share: number from 0 to 1; default 0.9\n        Share of the wanted" in described


@pytest.mark.parametrize("names", [[], ["cf1"], ["cf1", "cf2", "cf3"]])
def test_its_command_runs_and_its_exit_status_comes_through(run: Run, names: list[str]) -> None:
    done = run("star", "greet", *names)
    assert done.stdout.splitlines() == [f"hello {name}" for name in names]
    assert done.returncode == len(names)


def test_a_misspelt_option_is_refused_at_its_place(run: Run, mission: Path) -> None:
    place = change(mission, "share", "shere")
    done = run("star", "check", mission.name)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()[-1:]
    wrong = "avoider 'gentle': unknown option 'shere'; did you mean 'share'?"
    assert line.startswith(f"{place}: {wrong} [")


def test_a_value_out_of_its_range_is_refused_at_its_place(run: Run, mission: Path) -> None:
    place = change(mission, "0.8}\nmission", "2}\nmission")
    done = run("star", "check", mission.name)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()[-1:]
    assert line.startswith(f"{place}: avoider 'gentle': share: 2 ")


def test_the_schema_for_editors_knows_its_options(run: Run, mission: Path) -> None:
    printed = json.loads(run("star", "schema").stdout)
    Draft202012Validator.check_schema(printed)
    assert Draft202012Validator(printed).is_valid(read(mission).data)
    change(mission, "share: 0.8", "share: 2")
    assert not Draft202012Validator(printed).is_valid(read(mission).data)


def test_the_schema_of_worlds_is_in_the_wheel(run: Run, mission: Path) -> None:
    printed = json.loads(run("star", "schema", "world").stdout)
    Draft202012Validator(printed).validate(read(mission.with_name("room.yaml")).data)


def test_its_author_can_check_the_contract_in_tests_of_their_own(run: Run, mission: Path) -> None:
    tests = Path(__file__).parents[2] / "examples" / "star-gentle" / "test_star_gentle.py"
    shutil.copy(tests, mission.parent)
    done = run("python", "-m", "pytest", "-q", "-W", "error", tests.name)
    assert done.stdout.splitlines()[-1].startswith("3 passed"), done.stdout
