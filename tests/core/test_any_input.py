"""Whatever is set on the command line: it is taken, or refused in lines with its place."""

from __future__ import annotations

import io
import re
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from star_core.commands.main import main
from tests.commands import problem_lines
from tests.core.test_bad_input import MISSION, WORLD

LINE = re.compile(r"(m\.yaml|worlds/[^:]*|--set .*?)(:\d+:\d+)?: \S.*")
WORDS = b"""
    -1 0 1e308 1e-300 .nan .inf 18446744073709551615 2026-01-01 null true [] {} '' [[0,0]] ../ /
    all cf1 cf9 pair sim use: agents: file: parallel: repeat: land:{} ' " | > % @ ` &a *a !b <<: ---
    # ? : , - \0 \xff \xef\xbb\xbf \xe2\x80\xa8
""".split()


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The mission and its world, in the folder that the tests stand in."""
    monkeypatch.chdir(tmp_path)
    Path("worlds").mkdir()
    Path("worlds/room.yaml").write_text(WORLD)
    Path("m.yaml").write_text(MISSION)


def answer(*arguments: str) -> tuple[int, list[str]]:
    """Check a mission, and return the exit status and what was said of what is wrong."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = main(["check", "m.yaml", *arguments])
    assert bool(out.getvalue()) is (status == 0)
    lines = problem_lines(err.getvalue())
    return status, [line for line in lines if line != "checking m.yaml ..."]  # of a slow check


fuzz = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@fuzz
@given(
    path=st.lists(
        st.sampled_from(["mission", "swarm", "cf1", "start", "avoider", "radius", "0", "x", ""]),
        max_size=5,
    ).map(".".join),
    value=st.sampled_from([word.decode(errors="replace") for word in WORDS]) | st.text(max_size=8),
)
def test_whatever_is_set_is_taken_or_refused_in_lines(path: str, value: str) -> None:
    status, lines = answer(f"--set={path}={value}")
    assert status == (2 if lines else 0)
    assert all(LINE.fullmatch(line) for line in lines), lines
