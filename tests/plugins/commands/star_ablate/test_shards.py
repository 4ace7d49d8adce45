"""Shards of a study make up the study, however it is divided."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from star_ablate.shards import Shard, merged
from star_core import InputError
from star_core.commands.main import main
from tests.commands import Printed
from tests.plugins.commands.star_ablate.conftest import Write

pytestmark = pytest.mark.usefixtures("instant")

STUDY = """\
missions: [../hop.yaml, ../jump.yaml]
seeds: 3
measures: [flight_time_s]
factors: {rate: {slow: {rate: 10}, fast: {rate: 20}}}
"""


@pytest.fixture
def ablate(study: Write, tmp_path: Path) -> Callable[..., int]:
    """Flies or merges the study, in folders of `tmp_path`."""
    path = study(STUDY)

    def run(out: str, *options: str) -> int:
        return main(["ablate", str(path), "--quiet", "--out", str(tmp_path / out), *options])

    return run


def merge(ablate: Callable[..., int], folder: Path, *names: str) -> int:
    return ablate("merged", "--merge", *[str(folder / name) for name in names])


@pytest.mark.parametrize("division", [["1/1"], ["2/2", "1/2"], ["1/2", "4/4", "2/4"], 13])
def test_any_division_gives_the_same_table(
    division: list[str] | int, ablate: Callable[..., int], tmp_path: Path
) -> None:
    assert ablate("whole") == 0
    if isinstance(division, int):  # more than there are runs
        division = [f"{k + 1}/{division}" for k in range(division)]
    names = [part.replace("/", "-") for part in division]
    for part, name in zip(division, names, strict=True):
        assert ablate(name, "--shard", part) == 0
    assert merge(ablate, tmp_path, *names) == 0
    for file in ("results.csv", "results.md"):
        assert (tmp_path / "merged" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()
    assert merge(ablate, tmp_path, *names) == 0
    assert len((tmp_path / "merged/runs.jsonl").read_text().splitlines()) == 12
    assert ablate("merged", "--seeds", "4") == 0
    assert len((tmp_path / "merged/runs.jsonl").read_text().splitlines()) == 16


@pytest.mark.parametrize(
    ("names", "problem"),
    [
        (["1", "2"], "no folder has shard 3/3"),
        (["3"], "no folder has shard 1/3, shard 2/3"),
        (["1", "2", "3", "copy"], "shard 1/3 is there twice: {}/1, {}/copy"),
        (["1", "2", "3", "1"], "{}/1: is given twice"),
        (["1", "2", "3", "half"], "shard 1/3 and shard 1/2 overlap: {}/1, {}/half"),
        (["1", "2", "3", "whole"], "shard 1/3 and the whole study overlap: {}/1, {}/whole"),
    ],
)
def test_missing_and_doubled_shards_are_named(
    names: list[str], problem: str, ablate: Callable[..., int], tmp_path: Path, capsys: Printed
) -> None:
    shards = {"1": "1/3", "2": "2/3", "3": "3/3", "copy": "1/3", "half": "1/2", "whole": "1/1"}
    for name in dict.fromkeys(names):
        assert ablate(name, "--shard", shards[name]) == 0
    assert merge(ablate, tmp_path, *names) == 2
    assert not (tmp_path / "merged").exists()
    problem = problem.replace("{}", str(tmp_path))
    assert f"--merge: {problem} [incomplete-study]\n" in capsys.readouterr().err


def test_missing_runs_are_named_with_the_cause(
    ablate: Callable[..., int], study: Write, tmp_path: Path, capsys: Printed
) -> None:
    for name in ("1", "2"):
        assert ablate(name, "--shard", f"{name}/2") == 0
    journal = tmp_path / "2/runs.jsonl"
    journal.write_text("".join(journal.read_text().splitlines(keepends=True)[1:]))
    hop = study(STUDY).parents[1] / "hop.yaml"
    hop.write_text(hop.read_text().replace("0.3", "0.31"))
    assert merge(ablate, tmp_path, "1", "2") == 2
    first, second = capsys.readouterr().err.splitlines()[-2:]
    assert "/1, shard 1/2: 3 of its 6 runs are missing; mission has changed; resume it" in first
    assert "/2, shard 2/2: 3 of its 6 runs are missing; mission has changed; resume it" in second
    hop.write_text(hop.read_text().replace("0.31", "0.3"))
    assert merge(ablate, tmp_path, "1", "2") == 2
    assert (
        "/2, shard 2/2: 1 of its 6 runs are missing; among them hop, rate: slow, seed 1; resume it"
        " [incomplete-study]\n"
    ) in capsys.readouterr().err


def test_crashed_runs_are_merged(ablate: Callable[..., int], tmp_path: Path) -> None:
    assert ablate("1") == 0
    journal = tmp_path / "1/runs.jsonl"
    first, *others = journal.read_text().splitlines()
    crashed = json.loads(first) | {"outcome": "crashed", "reason": "SIGSEGV", "summary": None}
    journal.write_text("\n".join([*others, json.dumps(crashed), ""]))
    assert merge(ablate, tmp_path, "1") == 0
    table = (tmp_path / "merged/results.csv").read_text()
    assert "hop,slow,0,crashed,SIGSEGV,\n" in table


def test_other_versions_are_reported(
    ablate: Callable[..., int], tmp_path: Path, capsys: Printed
) -> None:
    for name in ("1", "2"):
        assert ablate(name, "--shard", f"{name}/2") == 0
    about = tmp_path / "2/study.json"
    content = json.loads(about.read_text())
    about.write_text(json.dumps(content | {"python": "2.7"}))
    assert merge(ablate, tmp_path, "1", "2") == 0
    expected = f"other versions than {tmp_path}/1: Python 2.7, not {content['python']}\n"
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (["--shard", "2/2"], "unwritable-file"),
        (["--merge", "."], "no-record"),
        (["--merge", "{}/1"], "option-conflict"),
        (["--shard", "2/2", "--merge", "."], "option-conflict"),
    ],
)
def test_wrong_options_are_refused(
    options: list[str], code: str, ablate: Callable[..., int], tmp_path: Path, capsys: Printed
) -> None:
    assert ablate("1", "--shard", "1/2") == 0
    assert ablate("1", *[option.replace("{}", str(tmp_path)) for option in options]) == 2
    assert f"[{code}]\n" in capsys.readouterr().err


@pytest.mark.parametrize("shard", ["3/2", "0/2", "x", "-1/2"])
def test_wrong_shards_are_refused(shard: str, ablate: Callable[..., int]) -> None:
    with pytest.raises(SystemExit) as caught:
        ablate("1", f"--shard={shard}")
    assert caught.value.code == 2


def test_folders_that_are_no_study_are_refused(tmp_path: Path) -> None:
    for text in ("", "[]", "\x00", "[" * 10_000):
        (tmp_path / "study.json").write_text(text)
        (tmp_path / "runs.jsonl").write_text("")
        with pytest.raises(InputError, match=r"no folder of a study"):
            merged([], [tmp_path])


def test_a_shard_has_every_nth_run() -> None:
    assert [*Shard(2, 3).of(range(1, 9))] == [2, 5, 8]
