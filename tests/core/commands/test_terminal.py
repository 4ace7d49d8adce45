"""What commands print on a terminal that is closed, or of names that would change the terminal."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from star_core.commands.main import main

STAR = str(Path(sys.executable).with_name("star"))
COLUMNS = 60
ESCAPE = "\x1b]0;title\x07\x1b[2J"


@pytest.mark.parametrize(
    ("redirection", "status"),
    [
        ("<&- >&- 2>&-", 0),
        pytest.param("| true", 1, marks=pytest.mark.extended),
        pytest.param("2> >(true)", 0, marks=pytest.mark.extended),
    ],
)
def test_closed_streams_end_no_flight(hop: Path, redirection: str, status: int) -> None:
    done = in_shell(f"set -o pipefail; '{STAR}' run hop.yaml --out run {redirection}", hop)
    assert "Traceback" not in done.stderr
    assert done.returncode in {0, status}
    assert (hop / "run/summary.json").exists()


def test_single_closed_streams_give_no_traceback(hop: Path) -> None:
    for redirection in (">&-", "2>&-"):
        done = in_shell(f"'{STAR}' check hop.yaml {redirection}", hop)
        assert (done.returncode, "Traceback" in done.stderr) == (0, False)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="of Linux")
@pytest.mark.parametrize(
    ("unbuffered", "command"), [("", "check hop.yaml"), ("1", "check hop.yaml"), ("1", "--version")]
)
def test_output_on_a_full_disk_is_an_error(hop: Path, unbuffered: str, command: str) -> None:
    done = in_shell(f"PYTHONUNBUFFERED={unbuffered} '{STAR}' {command} >/dev/full", hop)
    assert done.stderr.endswith(
        "output cannot be written: No space left on device [unwritable-file]\n"
    )
    assert done.returncode == 2


def test_errors_are_printed_without_stderr(tmp_path: Path) -> None:
    assert in_shell(f"'{STAR}' check missing.yaml 2>&-", tmp_path).returncode == 2


def test_paths_are_printed_escaped(hop: Path, capfd: pytest.CaptureFixture[str]) -> None:
    name = f"a{ESCAPE}.yaml"
    (hop / name).write_text((hop / "hop.yaml").read_text())
    (hop / "steps").mkdir()
    assert main(["check", name]) == 0
    assert main(["check", f"missing{ESCAPE}.yaml"]) == 2
    assert main(["run", name, "--out", f"run{ESCAPE}"]) == 0
    (hop / name).write_text("star: 1\nnmae: x\n")
    assert main(["check", name]) == 2
    captured = capfd.readouterr()
    for text in captured.out, captured.err:
        assert "\x1b" not in text
        assert "\x07" not in text
        assert "\\x1b]0;title\\x07" in text


@pytest.mark.parametrize(
    ("limit", "colour", "painted"), [("3.0", "32", True), ("4.5", "31", True), ("3.0", "", False)]
)
@pytest.mark.usefixtures("hop")
def test_the_outcome_is_green_or_red(limit: str, colour: str, *, painted: bool) -> None:
    safety = f"safety={{battery_low: {{below: {limit}}}}}"
    text = in_terminal(["run", "hop.yaml", "--no-record", "--set", safety], painted)
    (line,) = re.findall(r"(?:\x1b\[[0-9;]*m)?hop: (?:completed|failed).*", text)
    assert line.startswith(f"\x1b[1;{colour}mhop: " if painted else "hop: ")


@pytest.mark.usefixtures("hop")
def test_a_plan_is_broken_between_words() -> None:
    text = in_terminal(["explain", "hop.yaml"], colours=False)
    assert "communication_radius" in text  # of the longest line
    plain = [line for line in text.splitlines() if "\x1b" not in line]
    assert max(map(len, plain)) <= COLUMNS


def in_shell(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command line in a folder."""
    return subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, check=False, cwd=folder
    )


def in_terminal(arguments: list[str], colours: bool) -> str:  # noqa: FBT001
    """Return what `star` prints on a terminal, in a fork of this process, which starts at once."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.environ.update(TERM="xterm", NO_COLOR="" if colours else "1", COLUMNS=str(COLUMNS))
        sys.stdin, sys.stdout, sys.stderr = open(0), open(1, "w"), open(2, "w")  # noqa: SIM115
        try:
            main(arguments)
        finally:
            sys.stderr.flush()
            os._exit(0)
    written = b""
    with suppress(OSError):  # once the command has ended
        while part := os.read(terminal, 65536):
            written += part
    os.close(terminal)
    os.waitpid(pid, 0)
    return written.decode()
