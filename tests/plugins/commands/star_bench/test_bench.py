"""``star bench`` writes missions and their study, has them flown, and writes the table."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import pytest

import star_bench
import star_none
import star_yaml
from star_bench.command import label_of, named
from star_bench.files import POSITIONS, SETTINGS, WORLDS
from star_core import AvoiderSpec, InputError, Registry, hookimpl, load
from star_core.commands import run_command
from star_core.commands.main import main as star
from star_core.toolkit import StudyResults
from tests.commands import Printed, command

main = command("bench")

QUICK = ("--scenarios", "stack", "--agents", "2", "--seeds", "1", "--workers", "1")


def refused(*arguments: str) -> str:
    with pytest.raises(InputError) as caught:
        main(arguments)
    (problem,) = caught.value.problems
    return problem


@pytest.mark.usefixtures("in_process")
def test_a_campaign_is_flown_and_goes_on_where_it_stopped(tmp_path: Path, capsys: Printed) -> None:
    out = tmp_path / "out"
    arguments = [*QUICK, "--positions", "exact", "--out", str(out)]
    assert main([*arguments, "--avoiders", "none"]) == 0
    assert main([*arguments, "--avoiders", "none", "orca=radius:0.15"]) == 0
    told = capsys.readouterr()
    lines = [line for line in told.err.splitlines() if " flights; " in line or line[0] == "["]
    assert [line.partition(", ")[0] for line in lines] == [
        "star: 1 flights; all are checked before the first",
        "[1/1] stack-2-0",
        "star: 2 flights; all are checked before the first",
        "[2/2] stack-2-0",
    ]
    assert told.out.endswith(f"results: {out}\nreport: {out / 'report.html'}\n")
    assert (out / "bench.md").read_text() in told.out
    table = csv.DictReader((out / "bench.csv").read_text().splitlines())
    rows = {(row["avoider"], row["scenario"]): row for row in table}
    assert list(rows) == [
        ("none", "stack"),
        ("orca radius 0.15", "stack"),
        ("none", "all"),
        ("orca radius 0.15", "all"),
    ]
    row = rows["orca radius 0.15", "stack"]
    assert (row["runs"], row["success"], row["agent-agent collisions"]) == ("1", "1.0", "0")
    assert 1.0 <= float(row["time ratio"]) < 3.0
    assert 1.0 <= float(row["path ratio"]) < 1.5


@pytest.mark.extended
@pytest.mark.usefixtures("in_process")
def test_worlds_and_positions_are_flown_and_tabulated(tmp_path: Path) -> None:
    out = tmp_path / "out"
    worlds = ["--world", *WORLDS, "--positions", *POSITIONS]
    assert main([*QUICK, "--avoiders", "none", *worlds, "--out", str(out)]) == 0
    table = [*csv.DictReader((out / "bench.csv").read_text().splitlines())]
    settings = [(row["world"], row["positions"]) for row in table if row["scenario"] != "all"]
    assert settings == [*SETTINGS]
    (study,) = (out / "flown").glob("study.json")
    assert '"std": 0.03' in study.read_text()


def test_with_write_only_nothing_flies(tmp_path: Path, capsys: Printed) -> None:
    out = tmp_path / "out"
    scenarios = ("--scenarios", "circle", "corridor=width:2.5")
    assert (
        main([*scenarios, "--seeds", "2", "--agents", "4", "--write-only", "--out", str(out)]) == 0
    )
    assert capsys.readouterr().out == f"4 missions and their study: {out / 'study.yaml'}\n"
    names = ["circle-4-0", "circle-4-1", "corridor-width-2_5-4-0", "corridor-width-2_5-4-1"]
    assert sorted(path.stem for path in (out / "missions").glob("*.yaml")) == names
    assert not (out / "flown").exists()
    for name in names:
        assert star(["check", str(out / "missions" / f"{name}.yaml")]) == 0


@pytest.mark.parametrize("setting", SETTINGS)
def test_every_setting_is_a_mission(tmp_path: Path, setting: tuple[str, str]) -> None:
    main([*QUICK, "--write-only", "--out", str(tmp_path / "out")])
    mission = tmp_path / "out" / "missions" / "stack-2-0.yaml"
    changes = [f"{path}={json.dumps(value)}" for path, value in SETTINGS[setting].items()]
    scene = load(mission, Registry(), changes).scene
    assert scene.exact_odometry == (setting[0] == "ideal")
    assert scene.measures_positions == (setting not in {("ideal", "exact"), ("default", "flow")})
    assert scene.limits.uncertainty_margin > 0


def test_flow_in_the_ideal_world_is_exact(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"add --world default \[invalid-argument\]"):
        main([*QUICK, "--positions", "flow", "--write-only", "--out", str(tmp_path / "out")])


def test_all_installed_avoiders_fly_by_default(tmp_path: Path) -> None:
    main([*QUICK, "--write-only", "--out", str(tmp_path / "out")])
    study = (tmp_path / "out" / "study.yaml").read_text()
    assert all(f'    "{name}": {{"avoider"' in study for name in Registry().names("avoider"))


@pytest.mark.parametrize(
    ("arguments", "words", "code"),
    [
        (["--scenarios", "cirkle"], "did you mean 'circle'?", "invalid-argument"),
        (["--scenarios", "x"], "there are: circle, disc, crossing, ", "invalid-argument"),
        (["--scenarios", "corridor=widht:2"], "'widht'; there is width", "invalid-argument"),
        (["--scenarios", "disc=width:2"], "'width'; it has none", "invalid-argument"),
        (["--scenarios", "corridor=width:0"], "corridor width: 0, expected m, ", "out-of-range"),
        (["--scenarios", "corridor=width:wide"], "corridor width: 'wide', ", "out-of-range"),
        (["--scenarios", "disc", "disc"], "'disc'", "duplicate-name"),
        (["--agents", "1"], "a number from 2 to 256", "out-of-range"),
        (["--agents", "257"], "a number from 2 to 256", "out-of-range"),
        (["--avoiders", "orcca"], "did you mean 'orca'?", "unknown-plugin"),
        (["--avoiders", "orca", "orca"], "'orca'", "duplicate-name"),
        (["--avoiders", "orca=radius"], "expected NAME or NAME=", "invalid-argument"),
    ],
)
def test_an_unknown_or_invalid_argument_is_refused(
    arguments: Sequence[str], words: str, code: str
) -> None:
    problem = refused(*arguments, "--write-only")
    assert problem.startswith(arguments[0])
    assert words in problem
    assert problem.endswith(f"[{code}]")


def test_unsupported_avoider_options_are_refused_with_location(tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = [*QUICK, "--avoiders", "orca=radius:-1", "--positions", "exact", "--out", str(out)]
    with pytest.raises(InputError) as caught:
        main(arguments)
    assert str(caught.value).startswith(f"{out / 'study.yaml'}:9:")
    assert star(["bench", *arguments]) == 2


@pytest.mark.parametrize(
    "flags", ["--seeds 0", "--workers -1", "--world flat", "--positions good", "--agents x"]
)
def test_flags_that_are_no_numbers_or_words_are_refused(flags: str) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(flags.split())


def test_files_do_not_go_where_something_else_is(tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "file").write_text("")
    wrong = f"--out {tmp_path}: contains other files (no study.yaml); name another folder"
    assert refused("--out", str(tmp_path)).startswith(f"{wrong} [")
    wrong = f"--out {tmp_path / 'file'}: is not a folder"
    assert refused("--out", str(tmp_path / "file")).startswith(f"{wrong} [")


def test_the_absence_of_a_plugin_that_flies_studies_is_reported(tmp_path: Path) -> None:
    lonely = Registry(star_bench, Idle(), installed=False)
    arguments = [*QUICK, "--avoiders", "idle", "--out", str(tmp_path / "out")]
    with pytest.raises(InputError) as caught:
        run_command("bench", arguments, lonely)
    (problem,) = caught.value.problems
    assert "no installed plugin flies studies" in problem
    assert problem.endswith("[unknown-plugin]")


class Idle:
    """Offers an avoider that is never made."""

    @hookimpl
    def star_avoiders(self) -> list[AvoiderSpec]:
        return [AvoiderSpec(name="idle", summary="Avoids nothing.", make=cast("Any", object))]


def test_interrupted_campaigns_leave_an_incomplete_table(tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = [*QUICK, "--avoiders", "none", "--positions", "exact", "--out", str(out)]

    @hookimpl
    def star_fly_study() -> StudyResults:
        return StudyResults((), interrupted=True)

    plugin = type("Plugin", (), {"star_fly_study": staticmethod(star_fly_study)})()
    registry = Registry(star_yaml, plugin, star_bench, star_none, installed=False)
    assert run_command("bench", arguments, registry) == 1
    assert (out / "bench.csv").read_text().count("\n") == 1  # the heading


@pytest.mark.parametrize(
    ("word", "plugin"),
    [
        ("orca", ("orca", {})),
        ("orca=radius:0.25", ("orca", {"radius": 0.25})),
        ("a=b:c,d:null,e:true", ("a", {"b": "c", "d": None, "e": True})),
    ],
)
def test_a_word_is_a_name_with_options(word: str, plugin: object) -> None:
    assert named("--avoiders", word) == plugin


@pytest.mark.parametrize("word", ["=a:1", "a=", "a=b", "a=:1", "a=b:", "a=b:1,"])
def test_half_a_word_is_refused(word: str) -> None:
    with pytest.raises(InputError, match="expected NAME or NAME=OPTION:VALUE"):
        named("--avoiders", word)


def test_a_label_is_one_that_studies_take() -> None:
    assert label_of("orca", {"note": "a/b"}) == "orca note a_b"
