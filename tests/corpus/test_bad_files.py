"""Every file of the corpus, each with one fault: reported on its line, with what to do."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from star_ablate.reading import read as read_study
from star_core.commands import main as cli
from star_core.plugin_support.registry import Registry
from star_yaml import schema
from tests.commands import problem_lines
from tests.corpus import cases
from tests.corpus.cases import Case, Expected

POSITION = re.compile(r"([^:\s]+):(\d+):(\d+): ")
LOCATED = re.compile(rf"(?P<positions>(?:{POSITION.pattern})+)(?P<words>\S.*)")
FAULTY = cases.faulty()
FEWEST = 200
registry = cache(Registry)  # what is installed does not change from one file to the next
schema_of = schema.compose
composed = cache(lambda: schema_of(registry().offers()))


@pytest.fixture(autouse=True)
def _in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty folder, and none beside it, to stand in; plugins are found once for all files."""
    folder = tmp_path / "empty"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setattr("star_core.plugin_support.registry.Registry", registry)
    monkeypatch.setattr(schema, "compose", lambda _offers: composed())


def errors_of(lines: list[str]) -> Iterator[list[Expected]]:
    """Yield every error as the files and the lines that it is on, and its words.

    There are several where steps are at fault for a value that is given to them elsewhere.
    """
    for line in lines:
        match = LOCATED.fullmatch(line)
        assert match, f"no position: {line}"
        positions = POSITION.findall(match["positions"])
        words = match["words"]
        yield [Expected.of(file, line, column, words) for file, line, column in positions]


@pytest.mark.parametrize("topic", cases.topics())
def test_the_files_that_are_spoilt_are_good(topic: str) -> None:
    good = cases.valid(topic)
    good.write(Path())
    if good.command[0] == "ablate":
        read_study(Path(good.command[1]), registry())
    else:
        assert cli.main(good.command) == 0


@pytest.mark.parametrize("case", FAULTY, ids=str)
def test_a_fault_is_reported_on_its_line_and_nowhere_else(
    case: Case, capsys: pytest.CaptureFixture[str]
) -> None:
    case.write(Path())
    before = sorted(Path().rglob("*"))
    assert cli.main(case.command) == 2
    out, err = capsys.readouterr()
    assert out == ""
    reported = list(errors_of(problem_lines(err)))
    for expected in case.expected:
        assert any(
            (error.file, error.line) == (expected.file, expected.line)
            and expected.column in {None, error.column}
            and expected.words in error.words
            and expected.code == error.code
            for errors in reported
            for error in errors
        ), f"{expected} is not in:\n{err}"
    faulty = {(expected.file, expected.line) for expected in case.expected}
    for errors in reported:
        assert faulty & {(error.file, error.line) for error in errors}, err
    assert " raised " not in err
    assert sorted(Path().rglob("*")) == before


def test_every_fault_has_a_code() -> None:
    without = [str(case) for case in FAULTY for expected in case.expected if not expected.code]
    assert without == []


def test_there_are_many_files_and_none_is_there_twice() -> None:
    assert len(FAULTY) >= FEWEST
    written = Counter((case.command, tuple(sorted(case.files.items()))) for case in FAULTY)
    assert [files for files, times in written.items() if times > 1] == []


@pytest.mark.parametrize("case", FAULTY[:: len(FAULTY) // 3], ids=str)
def test_commands_in_a_subprocess_end_with_2_and_no_traceback(case: Case) -> None:
    case.write(Path())
    ended = subprocess.run(
        [sys.executable, "-c", "from star_core.commands.main import main; raise SystemExit(main())",
         *case.command],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert "Traceback" not in ended.stderr
    assert all(LOCATED.fullmatch(line) for line in problem_lines(ended.stderr))
