"""``star ablate`` flies everything, whatever becomes of single runs, and tabulates it."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from star_ablate.flight import Job, Result
from star_core import InputError
from tests.commands import Printed, command
from tests.plugins.commands.star_ablate.conftest import Write

main = command("ablate")

Rows = Callable[[Path], list[dict[str, str]]]


HOP = "missions: [../hop.yaml]\nmeasures: [path_length_m.total, flight_time_s]\n"
SLOW = "factors: {rate: {slow: {rate: 10}}}\n"
ENTER = "import sys; from tests.commands import command; sys.exit(command('ablate')(sys.argv[1:]))"


@pytest.fixture(scope="module")
def flown(laid_out: Callable[[Path], Write], tmp_path_factory: pytest.TempPathFactory) -> Write:
    """Writes studies of a mission whose first two seeds have been flown and recorded in ``out``."""
    study = laid_out(tmp_path_factory.mktemp("flown"))
    ablate(study(HOP + SLOW + "seeds: 2\n"), "--record", "--workers", "2")
    return study


def ablate(path: Path, *arguments: str) -> Path:
    """Fly a study to its end and return the folder of its results."""
    out = path.parents[1] / "out"
    assert main([str(path), "--out", str(out), *arguments]) == 0
    return out


@pytest.mark.extended
@pytest.mark.usefixtures("in_process")
def test_example_study_shows_that_orca_separates_drones(
    missions: Path, tmp_path: Path, rows: Rows, capsys: Printed
) -> None:
    path = missions / "studies" / "avoiders.yaml"
    assert main([str(path), "--out", str(tmp_path / "a"), "--seeds", "1", "--workers", "1"]) == 0
    table = rows(tmp_path / "a")
    assert [(row["avoider"], row["seed"]) for row in table] == [
        (level, "0") for level in ("none", "orca 0.25", "orca 0.3")
    ]
    apart = {row["avoider"]: float(row["min_separation_m"]) for row in table}
    assert apart["none"] < 0.5 < min(apart["orca 0.25"], apart["orca 0.3"])
    printed = capsys.readouterr().out
    assert "avoiders: 3 runs, 3 conditions; mission: first_flight." in printed
    assert re.search(r"^orca 0.25 +1 +100% +0", printed, re.MULTILINE)


@pytest.mark.extended
@pytest.mark.usefixtures("in_process")
def test_two_workers_write_the_results_of_one_process(flown: Write, rows: Rows) -> None:
    with_two = flown("").parents[1] / "out" / "results.csv"
    out = flown("").parents[1] / "alone"
    assert main([str(flown(HOP + SLOW + "seeds: 2\n")), "--out", str(out)]) == 0
    assert (out / "results.csv").read_bytes() == with_two.read_bytes()
    assert len({row["path_length_m.total"] for row in rows(out)}) == 2


@pytest.mark.extended
@pytest.mark.usefixtures("wrecker")
def test_crashed_runs_are_results_and_the_rest_is_flown(study: Write, rows: Rows) -> None:
    path = study(
        HOP + "seeds: 1\n"
        "factors:\n"
        "  harm:\n"
        "    segfault: {avoider: {use: wrecker, used: segfault}}\n"
        "    use: {avoider: {use: wrecker, used: raise}}\n"
        "    nothing: {avoider: wrecker}\n"
    )
    out = ablate(path, "--workers", "1")
    runs = {row["harm"]: row for row in rows(out)}
    ends = {harm: (row["outcome"], row["reason"]) for harm, row in runs.items()}
    assert ends["segfault"] == ("crashed", "its process ended with SIGSEGV")
    assert ends["use"][0] == "failed"
    assert "wrecker" in ends["use"][1]
    assert "harm" in ends["use"][1]
    assert ends["nothing"] == ("completed", "")
    assert runs["use"]["flight_time_s"] != ""  # it flew, and was landed
    assert runs["segfault"]["flight_time_s"] == ""
    assert "Segmentation fault" in (out / "log.txt").read_text()
    page = (out / "results.md").read_text()
    assert "| segfault | 1 | 0% | - | - |" in page
    assert "| segfault | 0 | crashed | its process ended with SIGSEGV |" in page


@pytest.mark.usefixtures("wrecker")
def test_a_run_that_hangs_is_ended_when_its_time_is_over(study: Write, rows: Rows) -> None:
    harm = "harm: {hang: {avoider: {use: wrecker, made: hang}}}"
    path = study(HOP + f"seeds: 1\ntime_limit: 1\nfactors: {{{harm}}}\n")
    out = ablate(path)
    (row,) = rows(out)
    assert (row["outcome"], row["reason"]) == ("crashed", "took longer than 1 s")
    header, timing = (out / "timings.csv").read_text().splitlines()
    assert header == "mission,harm,seed,wall_time_s"
    assert float(timing.removeprefix("hop,hang,0,")) >= 1


@pytest.mark.usefixtures("in_process")
def test_a_study_goes_on_where_it_stopped(flown: Write, rows: Rows, capsys: Printed) -> None:
    before = rows(flown("").parents[1] / "out")
    after = rows(ablate(flown(HOP + SLOW + "seeds: [0, 3, 1]\n"), "--record"))
    (line,) = (line for line in capsys.readouterr().err.splitlines() if line[0] == "[")
    assert line.startswith("[3/3] hop, rate: slow, seed 3: completed")
    assert [row["seed"] for row in after] == ["0", "3", "1"]
    assert [after[0], after[2]] == before


def test_a_quiet_study_writes_its_table_and_prints_none(flown: Write, capsys: Printed) -> None:
    out = ablate(flown(HOP + SLOW + "seeds: 2\n"), "--record", "--quiet")
    assert capsys.readouterr().out == ""
    assert "| hop | 2 | 100% |" in (out / "results.md").read_text()


@pytest.mark.usefixtures("in_process")
def test_measures_that_are_asked_for_later_need_no_flight(
    flown: Write, rows: Rows, capsys: Printed
) -> None:
    text = SLOW + "missions: [../hop.yaml]\nseeds: 1\nmeasures: "
    (row,) = rows(ablate(flown(text + "[seed, position_rmse_m]\n")))
    assert float(row["position_rmse_m"]) > 0
    assert capsys.readouterr().err == ""


def test_records_are_kept_when_asked_for(flown: Write) -> None:
    record = flown("").parents[1] / "out" / "runs" / "hop" / "rate=slow" / "seed=1"
    assert json.loads((record / "manifest.json").read_text())["mission"]["seed"] == 1
    with np.load(record / "trajectory.npz") as trajectory:
        assert np.diff(trajectory["time"]).mean() == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("file", "before", "after", "change"),
    [
        ("lab/hop.yaml", "0.3", "0.31", "mission has changed"),
        ("lab/room.yaml", "[2, 2, 2]", "[2, 2, 3]", "world has changed"),
        ("lab/line.csv", "0.3", "0.31", "file 'line.csv' has changed"),
        ("site/star_wrecker.py", "return", " return", "plugin 'star-wrecker:wrecker' has changed"),
    ],
)
@pytest.mark.usefixtures("instant")
def test_what_has_changed_since_is_flown_again(
    file: str, before: str, after: str, change: str, study: Write, wrecker: Path, capsys: Printed
) -> None:
    path = study(HOP + "seeds: 1\nfactors: {a: {b: {avoider: wrecker}, c: {}}}\n")
    hop = path.parents[1] / "hop.yaml"
    hop.write_text(hop.read_text().replace("- land", "- follow: {file: line.csv}\n  - land"))
    (path.parents[1] / "line.csv").write_text("x,y,z\n0,0,0.3\n0.2,0,0.3\n")
    out = ablate(path)
    edited = wrecker.parent / file
    edited.write_text(edited.read_text().replace(before, after))
    capsys.readouterr()
    assert ablate(path) == out
    runs = "1 run is" if "plugin" in change else "2 runs are"
    assert f"star: {runs} flown again: {change}\n" in capsys.readouterr().err
    assert len((out / "runs.jsonl").read_text().splitlines()) == 2 + int(runs[0])


@pytest.mark.extended
@pytest.mark.usefixtures("wrecker")
def test_an_interrupt_keeps_what_is_done_and_leaves_no_process(
    study: Write, rows: Rows, tmp_path: Path, wrecker: Path
) -> None:
    path = study(
        HOP + "seeds: 1\nfactors:\n"
        "  harm: {a: {avoider: wrecker}, b: {avoider: {use: wrecker, made: hang}}}\n"
    )
    out = tmp_path / "out"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(wrecker), *sys.path])}
    command = [sys.executable, "-c", ENTER, str(path), "--out", str(out), "--workers", "1"]
    with subprocess.Popen(
        command, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stderr is not None
        try:  # progress comes first on a busy machine
            assert any("harm: a, seed 0: completed" in line for line in process.stderr)
            process.send_signal(signal.SIGINT)
            output, err = process.communicate(timeout=60)  # Python waits for processes left
        finally:
            process.kill()
    assert process.returncode == 1
    assert f"star: interrupted; to resume, add `--out {out}`\n" in err
    assert "1 of 2 runs" in output
    (row,) = rows(out)
    assert (row["harm"], row["outcome"]) == ("a", "completed")


@pytest.mark.usefixtures("instant")
def test_a_dry_run_prints_what_would_be_flown(
    study: Write, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    path = study(HOP + SLOW + "seeds: 7\n")
    out = path.parents[1] / "out"
    probed: list[int] = []

    def fly_all(_: object, jobs: Sequence[Job], *__: object) -> Iterator[tuple[int, Result]]:
        probed.append(len(jobs))
        yield from ((i, Result("completed", "", 2.0 + i, {})) for i in range(len(jobs)))

    command = [str(path), "--dry-run", "--workers", "2", "--out", str(out)]
    with monkeypatch.context() as patch:
        patch.setattr("star_ablate.workers.Processes.fly_all", fly_all)
        assert main(command) == 0
    assert not out.exists()
    assert capsys.readouterr().out.splitlines() == [
        *("1 condition:", "  hop, rate: slow", "seeds: 0, 1, 2, 3, 4, 5, 6"),
        "runs of the whole study: 7",
        "expected time: about 14 s with 2 workers, at 4 s a flight (mean of 3, not kept)",
    ]
    assert main([str(path), "--out", str(out), "--seeds", "3", "--quiet"]) == 0
    assert main(command) == 0
    text = capsys.readouterr().out
    assert "runs of the whole study: 7, 3 of them flown\n" in text
    assert "expected time: about 0 s with 2 workers, at 0.1 s a flight (mean of 3 before)" in text
    assert probed == [4]


def test_nothing_is_written_when_the_study_is_wrong(study: Write, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        main([str(study("missions: []\n")), "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda out: out.write_text(""), "is not a folder"),
        (
            lambda out: (out / "thesis").mkdir(parents=True),
            "contains other files (no runs.jsonl); name another folder",
        ),
    ],
)
def test_results_do_not_go_where_something_else_is(
    make: Callable[[Path], object], why: str, study: Write, tmp_path: Path
) -> None:
    make(out := tmp_path / "out")
    with pytest.raises(InputError) as caught:
        main([str(study(HOP)), "--out", str(out)])
    assert caught.value.problems == (f"--out {out}: {why} [unwritable-file]",)


def test_a_folder_that_cannot_be_made_is_reported(study: Write, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "out"
    with pytest.raises(InputError) as caught:
        main([str(study(HOP)), "--out", str(out)])
    assert caught.value.problems == (
        f"{out}: cannot be written: Not a directory [unwritable-file]",
    )
