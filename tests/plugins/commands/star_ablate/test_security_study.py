"""Attacks on studies by the folders of others: journals, tables and links."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from star_ablate import journal
from star_core import InputError
from star_core.commands.main import main
from star_core.records.study_results import FORMULA
from star_report.study_page import report
from tests.commands import Printed
from tests.plugins.commands.star_ablate.conftest import Write

SCRIPT = "</script><script>alert(1)</script>"
TEXTS = ["=1+1", "@SUM(1)", "+cmd|' /C calc'!A1", "-x", "\tx", "\rx", SCRIPT, "\x1b[2J", "a|b\nc"]

pytestmark = pytest.mark.usefixtures("instant")


@pytest.fixture
def flown(study: Write, tmp_path: Path) -> Path:
    """A study of two seeds and its folder, `out`."""
    path = study(
        "missions: [../hop.yaml]\nseeds: 2\nmeasures: [flight_time_s, path_length_m.total]"
    )
    assert main(["ablate", str(path), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    return path


@pytest.fixture
def resume(flown: Path, tmp_path: Path) -> Callable[..., int]:
    def run(*options: str) -> int:
        return main(["ablate", str(flown), "--out", str(tmp_path / "out"), *options])

    return run


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "results.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_hostile_texts_of_a_journal_are_inert(
    resume: Callable[..., int], tmp_path: Path, capsys: Printed
) -> None:
    file = tmp_path / "out/runs.jsonl"
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    for text in TEXTS:
        lines[0] |= {"outcome": text, "reason": text}
        lines[0]["summary"] |= {"flight_time_s": text, text: text}
        file.write_text("".join(json.dumps(line) + "\n" for line in lines))
        assert resume(*["--quiet"] * (text != SCRIPT)) == 0
        row = rows(tmp_path / "out")[0]
        for cell in row["outcome"], row["reason"], row["flight_time_s"]:
            assert not cell.startswith(FORMULA)
            assert cell.removeprefix("'") == " ".join(text.split())
        assert "\x1b" not in capsys.readouterr().out
        page = (tmp_path / "out/report.html").read_text()
        assert ("alert(1)" in page) == (text == SCRIPT)
        assert "<script>alert(1)" not in page


HOSTILE: list[Any] = [
    {"outcome": ["completed"]},
    {"reason": {}},
    {"wall_time": "1"},
    {"wall_time": float("nan")},
    {"wall_time": 10**400},
    {"summary": []},
    {"summary": "x"},
    {"key": []},
]
MEASURES: list[Any] = [10**400, float("nan"), float("inf"), [], {}, "x", True, -1e308]


def test_hostile_rows_of_a_journal_are_flown_again(
    resume: Callable[..., int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal, "MAX_LINE", 1 << 16)
    file = tmp_path / "out/runs.jsonl"
    first, second = file.read_text().splitlines()
    before = rows(tmp_path / "out")
    lines = [json.dumps(json.loads(first) | change) for change in HOSTILE]
    lines += ["[" * 50_000, '{"key": ' + "1" * 5000 + "}", '"' + "x" * (1 << 17), "\x00\x01", ""]
    file.write_text("\n".join([*lines, second, ""]))
    assert resume("--quiet") == 0
    after = rows(tmp_path / "out")
    assert after == before
    assert len(file.read_text().splitlines()) == len(lines) + 2


def test_hostile_measures_are_no_tracebacks(resume: Callable[..., int], tmp_path: Path) -> None:
    file = tmp_path / "out/runs.jsonl"
    first, second = map(json.loads, file.read_text().splitlines())
    for value in MEASURES:
        first["summary"]["flight_time_s"] = value
        file.write_text(f"{json.dumps(first)}\n{json.dumps(second)}\n")
        assert resume("--quiet") == 0


def test_links_in_a_study_are_not_followed(
    resume: Callable[..., int], tmp_path: Path, capsys: Printed
) -> None:
    private = tmp_path / "private"
    private.write_text("private")
    for name in "log.txt", "runs", "study.json.new", "results.csv", "runs.jsonl":
        (tmp_path / "out" / name).unlink(missing_ok=True)
        (tmp_path / "out" / name).symlink_to(private)
        assert resume() == 2
        assert f"{name!r} is a link" in capsys.readouterr().err
        if name != "runs.jsonl":
            (tmp_path / "out" / name).unlink()
    assert private.read_text() == "private"


def test_links_to_records_of_a_study_are_not_followed(
    flown: Path, tmp_path: Path, capsys: Printed
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "out/runs").mkdir()
    (tmp_path / "out/runs/hop").symlink_to(elsewhere)
    (tmp_path / "out/runs.jsonl").write_text("")
    assert main(["ablate", str(flown), "--out", str(tmp_path / "out"), "--record"]) == 2
    assert "leads out of the study's folder" in capsys.readouterr().err
    assert list(elsewhere.iterdir()) == []


def test_links_in_the_position_of_results_are_replaced(flown: Path, tmp_path: Path) -> None:
    private = tmp_path / "private"
    private.write_text("private")
    for name in ("report.html", "report.html.new"):
        path = tmp_path / "out" / name
        path.unlink(missing_ok=True)
        path.symlink_to(private)
    assert flown.exists()
    assert main(["report", str(tmp_path / "out")]) == 0
    assert private.read_text() == "private"
    assert not (tmp_path / "out/report.html").is_symlink()


TABLES = [
    b"",
    b"mission\n",
    b"\xff\xfe",
    b"mission,seed,outcome,reason\na\n",
    b"mission,seed,outcome,reason\na,b,c,d,e\n",
    b"mission,seed,outcome,reason,x\na,b,c," + b"d" * 200_000 + b",1\n",
]


def test_hostile_tables_are_refused(tmp_path: Path) -> None:
    for table in TABLES:
        (tmp_path / "results.csv").write_bytes(table)
        with pytest.raises(InputError, match=r"results.csv: .* \[no-record\]"):
            report(tmp_path)
