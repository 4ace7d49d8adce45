"""Long work is reported on stderr: lines in a pipe, bars on a terminal, nothing if it is short."""

from __future__ import annotations

import io
import os
import pty
import sys
import time
from contextlib import suppress

import pytest

from star_core.toolkit import progress as module
from star_core.toolkit.progress import REFRESH_PERIOD, Progress, log
from tests.core.conftest import a_pipe

SOON = 10.0  # s


def wait_for(text: str, where: io.StringIO) -> None:
    until = time.monotonic() + SOON
    while text not in where.getvalue() and time.monotonic() < until:
        time.sleep(REFRESH_PERIOD / 10)
    assert text in where.getvalue()


def test_short_work_writes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = a_pipe(monkeypatch)
    with Progress("counting", 3, unit="sheep"):
        time.sleep(2 * REFRESH_PERIOD)
    assert pipe.getvalue() == ""


def test_work_that_is_announced_is_written_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = a_pipe(monkeypatch)
    with Progress("counting", 3, unit="sheep", announced=True):
        assert pipe.getvalue() == "counting: 0 of 3 sheep\n"


def test_long_work_is_reported_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = a_pipe(monkeypatch)
    with Progress("counting", 3, unit="sheep", period=0.0) as progress:
        wait_for("counting: 0 of 3 sheep\n", pipe)
        progress.done = 2
        wait_for("counting: 2 of 3 sheep\n", pipe)
    written = pipe.getvalue()
    time.sleep(3 * REFRESH_PERIOD)
    assert pipe.getvalue() == written


def test_the_innermost_work_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = a_pipe(monkeypatch)
    with Progress("flying", period=0.0), Progress("compiling", period=0.0, detail="f"):
        wait_for("compiling: f\n", pipe)


def test_short_works_in_a_long_one_do_not_silence_it(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = a_pipe(monkeypatch)
    until = time.monotonic() + SOON
    with Progress("outside"):
        while "inside" not in pipe.getvalue() and time.monotonic() < until:
            with Progress("inside", period=4 * REFRESH_PERIOD):
                time.sleep(2 * REFRESH_PERIOD)
    assert "inside ...\n" in pipe.getvalue()


def test_short_works_after_each_other_are_not_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("star_core.toolkit.progress.MAX_PAUSE", 3.0)
    pipe, until = a_pipe(monkeypatch), time.monotonic() + SOON
    while "next" not in pipe.getvalue() and time.monotonic() < until:
        with Progress("next", period=4 * REFRESH_PERIOD):
            time.sleep(2 * REFRESH_PERIOD)
    assert "next ...\n" in pipe.getvalue()


def test_the_remaining_time_is_that_of_the_work_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [10.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    progress = Progress("study", 150, unit="flights", detail="3.1 s per flight")
    progress.done = 10  # in an earlier run
    with progress:
        now[0] += 31.0
        progress.done = 20
        assert str(progress) == ("study: 20 of 150 flights, 3.1 s per flight, about 7 min left")


def test_a_duration_that_is_an_estimate_is_marked_as_one() -> None:
    progress = Progress("hop", 19.7, unit="s", estimated=True)
    progress.done = 12.42
    assert str(progress) == "hop: 12.4 of ~20 s"


def test_work_that_fails_is_over() -> None:
    with pytest.raises(ZeroDivisionError), Progress("dividing", period=0.0):
        raise ZeroDivisionError
    assert module._reporter._running == []


def test_nothing_is_raised_when_stderr_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr(sys, "stderr", closed)
    log("not read")
    with Progress("counting", period=0.0):
        time.sleep(2 * REFRESH_PERIOD)


def all_of(reader: int) -> str:
    """Return what is on a pseudo-terminal whose other end is closed, and close this one."""
    with os.fdopen(reader, "rb", buffering=0) as terminal:
        chunks: list[bytes] = []
        with suppress(OSError):  # there is no more
            while chunk := terminal.read(4096):
                chunks.append(chunk)
    return b"".join(chunks).decode()


def test_a_terminal_shows_a_bar_and_lines_above_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr(module, "SHOW_AFTER", 0.0)
    reader, writer = pty.openpty()
    with os.fdopen(writer, "w", encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        with Progress("counting", 4, unit="sheep") as progress:
            progress.done = 1
            time.sleep(10 * REFRESH_PERIOD)
            log("a line [1/2]")
        monkeypatch.undo()
    shown = all_of(reader)
    assert "1 of 4 sheep" in shown
    assert "━" in shown
    assert "a line [1/2]\r\n" in shown
    assert shown.count("\x1b[?25l") == shown.count("\x1b[?25h") == 1  # the cursor is back
