"""The plugins that `docs/plugins` shows, installed beside STAR, work as the built-in ones do."""

from __future__ import annotations

import json
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import TypeAlias

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from star_yaml.input_file import read
from tests.commands import position_and_code, problem_lines

pytestmark = pytest.mark.extended

Run: TypeAlias = Callable[..., CompletedProcess[str]]
ROOT = Path(__file__).parents[2]


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


def test_plugins_of_every_kind_fly_together_and_are_recorded(run: Run, mission: Path) -> None:
    inner = "{use: offset, of: {use: odometry, max_report_age: 0.3}, by: [0.1, 0, 0]}"
    change(mission, "localizer: flow", f"localizer: {inner}")
    change(mission, "planner: straight", "planner: {use: low, top: 1.3}")
    change(mission, "  - land: {}", "  - external: {planner: orbit}\n  - land: {}")
    done = run("star-run", mission.name, "--out", "record")
    assert done.returncode == 0, done.stderr
    with np.load(mission.parent / "record" / "trajectory.npz") as record:
        estimate, truth = record["estimate_position"], record["truth_position"]
    climbed = np.diff(np.sign(truth[:, :, 2] - 0.9), axis=0) > 0  # to nod, to orbit
    assert climbed.sum(axis=0).tolist() == [2, 2]
    x, y, _ = np.moveaxis(estimate, 2, 0)
    turns = np.diff(np.unwrap(np.arctan2(y, x), axis=0)[[0, -1]], axis=0) / (2 * np.pi)
    assert turns[0] == pytest.approx([1, 1], abs=0.15)
    assert estimate[1:] - truth[1:] == pytest.approx(np.tile([0.1, 0, 0], (*x[1:].shape, 1)))
    manifest = json.loads((mission.parent / "record" / "manifest.json").read_text())
    assert manifest["plugins"]["avoider"] == {
        "name": "gentle",
        "options": {"radius": 0.4},
        "plugin": "star-gentle:gentle",
        "version": "0.1.0",
    }
    assert manifest["third_parties"]["star-orbit:orbit"] == "0.1.0"
    summary = json.loads((mission.parent / "record" / "summary.json").read_text())
    assert list(summary["fastest"]) == ["cf1", "cf2"]
    printed = run("star", "outcomes", "record")
    assert printed.stdout.startswith("record: completed, ")
    assert run("star", "outcomes").returncode == 2


def test_options_of_wrapped_plugins_are_checked_at_their_line(run: Run, mission: Path) -> None:
    localizer = "localizer: {use: offset, of: {use: flow, max_report_aeg: 0.3}, by: [0.1, 0, 0]}"
    change(mission, "localizer: flow", localizer)
    text = (ROOT / "docs" / "plugins" / "localizer.md").read_text()
    (shown,) = re.findall(r"^mission\.yaml:\d+(:\d+: .*)$", text, re.MULTILINE)
    assert problem_lines(run("star", "check", mission.name).stderr)[-1].endswith(shown)


def test_a_goal_that_the_planner_refuses_is_reported(run: Run, mission: Path) -> None:
    change(mission, "planner: straight", "planner: low")
    place = change(
        mission, "nod: {height: 0.3, timeout: 20}", "goto: {agents: cf1, to: [0, 0, 1.7]}"
    )
    text = (ROOT / "docs" / "plugins" / "planner.md").read_text()
    (shown,) = re.findall(r"^mission\.yaml:12:16: (.*)$", text, re.MULTILINE)
    file, line, column = place.split(":")
    at = f"{file}:{line}:{int(column) + len('goto: {agents: cf1, to: ')}: "
    assert problem_lines(run("star", "check", mission.name).stderr)[-1].endswith(f"{at}{shown}")


@pytest.mark.parametrize(
    ("old", "new", "offset", "code"),
    [
        ("nod: {height: 0.3, timeout: 20}", "external: {planner: orbti}", 20, "invalid-value"),
        ("radius", "raduis", 0, "unknown-option"),
        ("0.4}\nmission", "-2}\nmission", 0, "out-of-range"),
    ],
)
def test_mistakes_in_options_are_refused_at_their_position(
    run: Run, mission: Path, old: str, new: str, offset: int, code: str
) -> None:
    line, _, column = change(mission, old, new).rpartition(":")
    done = run("star", "check", mission.name)
    assert done.returncode == 2
    position = position_and_code(problem_lines(done.stderr)[-1])
    assert position == f"{line}:{int(column) + offset} [{code}]"


def test_what_a_mission_sets_reaches_the_plugin(run: Run, mission: Path) -> None:
    nod = "nod: {height: 0.8, timeout: 2}"  # 0.2 m, the default, would take less
    place = change(mission, "nod: {height: 0.3, timeout: 20}", nod)
    done = run("star", "run", mission.name, "--no-record", "--json")
    assert done.returncode == 1
    line = place.rpartition(":")[0]
    reason = json.loads(done.stdout)["reason"]
    assert reason.startswith(f"{line} nod cf1, cf2 failed: timed out after 2 s: ")


def test_all_are_listed_with_their_distribution_and_options(run: Run) -> None:
    listed = json.loads(run("star", "plugins", "--json").stdout)
    assert listed["broken"] == {}
    ours = [
        plugin for plugin in listed["plugins"] if not plugin["plugin"].startswith("star-swarm:")
    ]
    assert {
        plugin["plugin"]: (plugin["kind"], list(plugin["options"]["properties"])) for plugin in ours
    } == {
        "star-ceiling:ceiling": ("monitor", []),
        "star-fastest:fastest": ("observer", []),
        "star-gentle:gentle": ("avoider", ["radius"]),
        "star-low:low": ("planner", ["top"]),
        "star-nod:nod": ("task", ["height"]),
        "star-offset:offset": ("localizer", ["of", "by"]),
        "star-odometry:odometry": ("localizer", ["max_report_age"]),
        "star-orbit:orbit": ("external_planner", []),
        "star-outcomes:outcomes": ("command", []),
        "star-points:points": ("transport", ["battery"]),
    }


def test_people_are_shown_the_same(run: Run) -> None:
    lines = run("star", "plugins").stdout.splitlines()
    (at,) = (i for i, line in enumerate(lines) if line.split()[:1] == ["gentle"])
    assert lines[at].endswith("[star-gentle 0.1.0:gentle]")
    described = run("star", "plugins", "gentle").stdout
    assert "radius: number > 0; default 0.4\n        Distance from another agent" in described


def test_the_schema_for_editors_knows_its_options(run: Run, mission: Path) -> None:
    printed = json.loads(run("star", "schema").stdout)
    Draft202012Validator.check_schema(printed)
    assert Draft202012Validator(printed).is_valid(read(mission).data)
    change(mission, "radius: 0.4", "radius: -2")
    assert not Draft202012Validator(printed).is_valid(read(mission).data)


def test_the_schema_of_worlds_is_in_the_wheel(run: Run, mission: Path) -> None:
    printed = json.loads(run("star", "schema", "world").stdout)
    Draft202012Validator(printed).validate(read(mission.with_name("room.yaml")).data)


def test_its_author_can_check_the_contract_in_tests_of_their_own(
    run: Run, mission: Path, documented: dict[str, Path]
) -> None:
    for name in ("test_star_gentle.py", "gentle.yaml"):
        shutil.copy(documented["star-gentle"] / name, mission.parent)
    assert run("star", "new", "world", "gentle_world").returncode == 0
    done = run(
        "python", "-m", "pytest", "-q", "-W", "error", "-k", "not flies", "test_star_gentle.py"
    )
    assert done.stdout.splitlines()[-1].startswith("2 passed"), done.stdout
