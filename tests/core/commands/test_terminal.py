"""What commands print on a terminal that is closed, or of names that would change the terminal."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from star_core.commands.main import main

STAR = str(Path(sys.executable).with_name("star"))
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
