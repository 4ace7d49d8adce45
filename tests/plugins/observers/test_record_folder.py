"""Where ``star run`` records, and what it refuses to record into."""

from __future__ import annotations

import errno
import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import pytest

from star_core import Flight, hookimpl
from star_core.commands.main import main
from star_core.discovery import Source
from star_core.plugin_support.registry import Registry
from star_record.read_record import split_timing
from star_record.text_log import TextLog

Printed: TypeAlias = pytest.CaptureFixture[str]
pytestmark = pytest.mark.usefixtures("hop")


@pytest.fixture
def printed(capsys: Printed) -> Printed:
    """What is printed, and where."""
    return capsys


@pytest.fixture
def refused(printed: Printed) -> Callable[[str], str]:
    """Run ``star run`` with ``--out``, see that nothing is flown, and return what is printed."""

    def run(out: str) -> str:
        before = sorted(Path().rglob("*"))
        assert main(["run", "hop.yaml", "--out", out]) == 2
        assert sorted(Path().rglob("*")) == before
        told = printed.readouterr()
        assert told.out == ""
        return told.err

    return run


def recorded(file: str, folder: str = "out") -> Any:
    return json.loads((Path(folder) / file).read_text())


def test_json_is_all_that_is_printed_and_is_what_is_recorded(printed: Printed) -> None:
    assert main(["run", "hop.yaml", "--json", "--out", "out"]) == 0
    out, err = printed.readouterr()
    summary, timing = split_timing(json.loads(out))
    assert (summary, timing) == (recorded("summary.json"), recorded("timing.json"))
    assert "begins" not in err  # progress of a slow flight is reported there


def test_a_run_is_recorded_below_runs_by_time_and_name(printed: Printed) -> None:
    assert main(["run", "hop.yaml"]) == 0
    (folder,) = (path for path in Path("runs").iterdir() if not path.is_symlink())
    assert folder.name[10] == "T"
    assert folder.name.endswith("-hop")
    assert printed.readouterr().out.endswith(f"  record            {folder}\n")


def test_runs_of_one_second_are_recorded_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("time.strftime", lambda _form: "2026-01-02T030405")
    for _ in range(3):
        assert main(["run", "hop.yaml", "--json"]) == 0
    assert sorted(folder.name for folder in Path("runs").iterdir()) == [
        "2026-01-02T030405-hop",
        "2026-01-02T030405-hop-2",
        "2026-01-02T030405-hop-3",
        "latest",
    ]


def test_out_names_the_record_folder_and_creates_its_parents() -> None:
    assert main(["run", "hop.yaml", "--out", "a/b"]) == 0
    assert recorded("manifest.json", "a/b")["mission"]["name"] == "hop"
    assert not Path("runs").exists()


def test_an_empty_folder_can_be_recorded_into() -> None:
    Path("out").mkdir()
    assert main(["run", "hop.yaml", "--out", "out"]) == 0
    assert recorded("summary.json")["outcome"] == "completed"


def test_no_record_leaves_nothing_behind(printed: Printed) -> None:
    before = sorted(Path().rglob("*"))
    assert main(["run", "hop.yaml", "--no-record"]) == 0
    assert sorted(Path().rglob("*")) == before
    assert "record" not in printed.readouterr().out


class Thief:
    """A plugin that puts a file where the record should go."""

    @hookimpl
    def star_mission_started(self, flight: Flight) -> None:
        assert flight.folder is not None
        flight.folder.parent.mkdir()
        flight.folder.touch()


def test_a_record_that_was_not_written_is_not_reported(
    printed: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    registry = Registry()
    registry.add(Thief(), Source("their-dist:thief"))
    monkeypatch.setattr("star_core.plugin_support.registry.Registry", lambda: registry)
    main(["run", "hop.yaml", "--out", "a/b"])
    assert "a/b\n" not in printed.readouterr().out


class Vandal:
    """A plugin that moves the folder of the record away in flight, or deletes it."""

    def __init__(self, *, moves: bool) -> None:
        self._moves = moves

    @hookimpl
    def star_ticked(self) -> None:
        if not Path("out").exists():
            return
        if self._moves:
            Path("out").rename("elsewhere")
        else:
            shutil.rmtree("out")


@pytest.mark.parametrize("json", [False, True])
@pytest.mark.parametrize("moves", [False, True])
def test_a_record_that_is_lost_in_flight_is_the_last_line(
    printed: Printed, monkeypatch: pytest.MonkeyPatch, *, moves: bool, json: bool
) -> None:
    registry = Registry()
    registry.add(Vandal(moves=moves), Source("their-dist:vandal"))
    monkeypatch.setattr("star_core.plugin_support.registry.Registry", lambda: registry)
    assert main(["run", "hop.yaml", "--out", "out", *["--json"] * json]) == 1
    out, err = printed.readouterr()
    lines = (err if json else out).splitlines()
    assert lines[-1].endswith("not recorded: out/summary.json: No such file or directory")
    assert '"outcome": "completed"' in out if json else lines[0] == "hop: completed"


def test_a_full_disk_is_the_last_line(printed: Printed, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("star_record.spool.Spool.add", fail)
    assert main(["run", "hop.yaml", "--out", "out"]) == 1
    assert printed.readouterr().out.endswith(
        "not recorded: out: trajectory from 0.00 s on: [Errno 28] No space left on device\n"
    )


# What cannot be recorded into


def test_a_disk_that_is_full_at_the_end_is_the_last_line(
    printed: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    finish = TextLog.finish

    def full(log: TextLog, summary: Mapping[str, Any]) -> None:
        finish(log, summary)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("star_record.recorder.TextLog.finish", full)
    assert main(["run", "hop.yaml", "--out", "out"]) == 1
    last = printed.readouterr().out.splitlines()[-1]
    assert last == "not recorded: out: No space left on device"


@pytest.mark.parametrize(
    ("out", "problem"),
    [("hop.yaml", ": is a file; name a folder ["), ("hop.yaml/runs", ": "), ("", "")],
)
def test_what_is_no_folder_cannot_be_recorded_into(
    refused: Callable[[str], str], out: str, problem: str
) -> None:
    assert refused(out).startswith(f"--out {out}".rstrip() + problem)


def test_a_folder_that_holds_a_record_is_not_written_over(refused: Callable[[str], str]) -> None:
    Path("old").mkdir()
    Path("old/manifest.json").touch()
    wrong = "--out old: holds the record of a run already; name another folder"
    assert refused("old").startswith(f"{wrong} [")


@pytest.mark.parametrize("options", [["--out", "/proc/run"], []], ids=["named", "default"])
def test_nothing_takes_off_that_cannot_be_recorded(printed: Printed, options: list[str]) -> None:
    Path("runs").touch()
    assert main(["run", "hop.yaml", *options]) == 2
    (line,) = printed.readouterr().err.splitlines()
    assert "cannot be made: nothing can be written in '" in line
    assert ("fly with --no-record" in line) is not bool(options)
    assert line.endswith("[unwritable-file]")
    assert main(["run", "hop.yaml", "--no-record"]) == 0
