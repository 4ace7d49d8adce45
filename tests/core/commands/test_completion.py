"""Completion in a shell: commands, options, missions and plugins, as argcomplete asks for them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

STAR = Path(sys.executable).with_name("star")


def completed(line: str, folder: Path) -> set[str]:
    """Return what the end of a command line may become."""
    output = folder / "completions"
    env = {
        **os.environ,
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(output),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    subprocess.run([STAR], check=False, cwd=folder, env=env, timeout=60, capture_output=True)
    return {word.strip() for word in output.read_text().split("\v")}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("star ex", {"explain", "export"}),
        ("star run --sa", {"--save-frames"}),
        ("star run first_f", {"first_flight"}),
        ("star check mi", {"mine.yaml"}),
        ("star plugins visi", {"visibility"}),
        ("star help rep", {"report"}),
    ],
)
def test_words_are_completed(line: str, words: set[str], tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").touch()
    assert completed(line, tmp_path) == words
