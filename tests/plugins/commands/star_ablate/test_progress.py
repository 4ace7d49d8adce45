"""A study shows how far it is, to people and into pipes."""

from __future__ import annotations

from io import StringIO
from typing import Any

import pytest
from rich.console import Console

from star_ablate.flight import Result
from star_ablate.journal import StudyProgress
from star_ablate.study import Condition, Run

NO_MISSION: Any = None
RUN = Run(Condition("hop", {"avoider": "orca"}, NO_MISSION), 3, "key")
COMPLETED = Result("completed", "", 1.26, {})
CRASHED = Result("crashed", "its process ended with [SIGSEGV]", 2.0, None)


@pytest.fixture(params=[False, True], ids=["pipe", "terminal"])
def shown(request: pytest.FixtureRequest) -> str:
    text = StringIO()
    console = Console(file=text, force_terminal=request.param, width=120, color_system=None)
    progress = StudyProgress("study", 5, 2, console)
    with progress.bar:
        progress.add(RUN, COMPLETED)
        progress.add(RUN, CRASHED)
    return text.getvalue()


@pytest.mark.parametrize("shown", [False], indirect=True)
def test_a_pipe_is_told_a_line_a_run(shown: str) -> None:
    assert shown.splitlines() == [
        "[3/5] hop, avoider: orca, seed 3: completed, in 1.3 s",
        "[4/5] hop, avoider: orca, seed 3: crashed: its process ended with [SIGSEGV], in 2.0 s",
    ]


@pytest.mark.parametrize("shown", [True], indirect=True)
def test_a_terminal_is_shown_a_bar_and_what_did_not_complete(shown: str) -> None:
    assert "hop, avoider: orca, seed 3: crashed: its process ended with [SIGSEGV]\n" in shown
    assert "completed" not in shown
    last = shown.rsplit("4/5", maxsplit=1)[-1]
    assert "1 crashed" in last
