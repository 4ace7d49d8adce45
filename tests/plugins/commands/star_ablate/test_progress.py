"""A study shows how far it is, on terminals and in pipes."""

from __future__ import annotations

import io
import sys
from typing import Any

import pytest

from star_ablate.flight import Result
from star_ablate.journal import StudyProgress
from star_ablate.study import Condition, Run

NO_MISSION: Any = None
RUN = Run(Condition("hop", {"avoider": "orca"}, NO_MISSION), 3, "key")
COMPLETED = Result("completed", "", 1.26, {})
CRASHED = Result("crashed", "its process ended with [SIGSEGV]", 2.0, None)


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, s, as its only item."""
    now = [100.0]
    monkeypatch.setattr("star_core.toolkit.progress.time.monotonic", lambda: now[0])
    return now


def test_a_pipe_gets_a_line_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    text = io.StringIO()
    monkeypatch.setattr(sys, "stderr", text)
    with StudyProgress("study", 5, 2, workers=1) as progress:
        progress.add(RUN, COMPLETED)
        progress.add(RUN, CRASHED)
    assert text.getvalue().splitlines() == [
        "[3/5] hop, avoider: orca, seed 3: completed, in 1.3 s",
        "[4/5] hop, avoider: orca, seed 3: crashed: its process ended with [SIGSEGV], in 2.0 s",
    ]


def test_a_terminal_shows_what_did_not_complete_and_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    text = Screen()
    monkeypatch.setattr(sys, "stderr", text)
    monkeypatch.setenv("TERM", "xterm")
    with StudyProgress("study", 5, 2, workers=1) as progress:
        progress.add(RUN, COMPLETED)
        progress.add(RUN, CRASHED)
        assert progress.text().startswith("4 of 5 flights, 1 crashed")
    written = text.getvalue()
    assert "hop, avoider: orca, seed 3: crashed: its process ended with [SIGSEGV]\n" in written
    assert "completed" not in written


def test_after_the_first_flights_the_time_of_all_is_estimated(
    monkeypatch: pytest.MonkeyPatch, clock: list[float]
) -> None:
    text = io.StringIO()
    monkeypatch.setattr(sys, "stderr", text)
    with StudyProgress("study", 1560, 0, workers=2) as progress:
        for wait in (20.0, 0.0, 1.5, 1.5, 1.5, 1.5):  # the first two import and compile
            clock[0] += wait
            progress.add(RUN, COMPLETED)
    *_, last = text.getvalue().splitlines()
    assert last == "star: 1.5 s per flight, about 39 min left"
