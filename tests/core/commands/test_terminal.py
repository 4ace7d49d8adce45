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
    [(">&-", 0), ("2>&-", 0), ("<&- >&- 2>&-", 0), ("| true", 1), ("2> >(true)", 0)],
)
def test_closed_streams_give_no_traceback(hop: Path, redirection: str, status: int) -> None:
    command = f"set -o pipefail; '{STAR}' run hop.yaml --out run {redirection}"
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, check=False, cwd=hop
    )
    assert "Traceback" not in done.stderr
    assert done.returncode in {0, status}
    assert (hop / "run/summary.json").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="of Linux")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_on_a_full_disk_is_an_error(hop: Path, unbuffered: str) -> None:
    command = f"'{STAR}' check hop.yaml >/dev/full"
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    done = subprocess.run(
        ["bash", "-c", command], stderr=subprocess.PIPE, check=False, cwd=hop, env=environment
    )
    assert done.stderr.endswith(
        b"output cannot be written: No space left on device [unwritable-file]\n"
    )
    assert done.returncode == 2


def test_errors_are_printed_without_stderr(hop: Path) -> None:
    command = f"'{STAR}' check missing.yaml 2>&-"
    done = subprocess.run(["bash", "-c", command], capture_output=True, check=False, cwd=hop)
    assert done.returncode == 2


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
def test_the_outcome_is_green_or_red(hop: Path, limit: str, colour: str, *, painted: bool) -> None:
    safety = f"safety={{battery_low: {{below: {limit}}}}}"
    text = in_terminal([STAR, "run", "hop.yaml", "--no-record", "--set", safety], hop, painted)
    (line,) = re.findall(r"(?:\x1b\[[0-9;]*m)?hop: (?:completed|failed).*", text)
    assert line.startswith(f"\x1b[1;{colour}mhop: " if painted else "hop: ")


def test_a_plan_is_broken_between_words(hop: Path) -> None:
    text = in_terminal([STAR, "explain", "hop.yaml"], hop, colours=False)
    assert "communication_radius" in text  # of the longest line
    plain = [line for line in text.splitlines() if "\x1b" not in line]
    assert max(map(len, plain)) <= COLUMNS


def in_terminal(command: list[str], folder: Path, colours: bool) -> str:  # noqa: FBT001
    """Return what a command prints on a terminal."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        os.environ.update(TERM="xterm", NO_COLOR="" if colours else "1", COLUMNS=str(COLUMNS))
        os.execv(command[0], command)  # noqa: S606 -- of this test
    written = b""
    with suppress(OSError):  # once the command has ended
        while part := os.read(terminal, 65536):
            written += part
    os.close(terminal)
    os.waitpid(pid, 0)
    return written.decode()
