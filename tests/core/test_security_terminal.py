"""Attacks on the terminal: names of files, and texts in them, that hold control characters."""

from __future__ import annotations

import json
import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from star_core import Registry
from star_core.commands.main import main
from tests.plugins.commands.conftest import in_process

__all__ = ["in_process"]

ESCAPE = "\x1b]0;title\x07\x1b[2J\x9b1A\r\b"
FOLDER = f"lab{ESCAPE}"
SHIPPED = Path(__file__).parents[2] / "missions"
STUDY = """\
star: 1
name: study
missions: [hop.yaml]
seeds: 1
"""
ORIGINAL = "april_tags:\n  tags:\n    id000: {location: [0.5, 0.5], purpose: relocalization}\n"

COMMANDS: dict[str, list[str]] = {
    "run": ["@/hop.yaml --out @/run", "@/missing.yaml", "@/hop.yaml --@"],
    "ablate": ["@/study.yaml --out @/study --workers 1", "@/missing.yaml"],
    "bench": ["--write-only --out @/bench --agents 2", "--scenarios @"],
    "calibrate": ["camera @/missing.png --out @/camera.yaml"],
    "camera": ["@", "cf1 --mission @/missing.yaml"],
    "check": ["@/hop.yaml", "@/missing.yaml", "@/wrong.yaml", "@/hop.yaml --set @=1"],
    "errors": ["@"],
    "evaluate": ["@/run", "@/missing", "@/run --truth @/missing.csv"],
    "explain": ["@/hop.yaml", "@/missing.yaml"],
    "export": ["@/run --format csv", "@/missing --format tum"],
    "fleet": ["@/hop.yaml --port 0 --duration 0.01 --no-cameras", "@/missing.yaml"],
    "import": ["@/original.yaml --out @/imported", "@/missing.yaml"],
    "land": ["@/missing.yaml", "radio://@"],
    "missions": ["", "@"],
    "new": ["mission x", "mission @"],
    "plugins": ["", "@"],
    "preflight": ["@/missing.yaml", "@/hop.yaml"],
    "recover": ["@/run", "@/missing"],
    "report": ["@/run", "@/run --out @/missing/report.html", "@/study"],
    "scan": ["@/missing.yaml", "radio://@"],
    "schema": ["--out @/missing/schema.json", "@"],
    "script": ["@/missing.py --swarm @/hop.yaml", "@/wrong.yaml --swarm @/missing.yaml"],
    "stop": ["@"],
    "tags": ["@/arena.yaml --out @/tags.pdf", "@/missing.yaml"],
    "view": ["@/missing.yaml", "@/missing --port 0"],
}
"""Arguments of every command, with the hostile name in place of ``@``; some succeed."""
SILENT = {
    ("fleet", "@/hop.yaml --port 0 --duration 0.01 --no-cameras"),
    ("explain", "@/hop.yaml"),
    ("evaluate", "@/run"),
}
"""Those that print no name."""


@pytest.fixture
def hostile(hop: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, in which a folder with a hostile name has the files of all commands."""
    folder = hop / FOLDER
    folder.mkdir()
    monkeypatch.delenv("STAR_BLOCK_PLUGINS")  # `star recover` is tested too
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    for name in ("hop.yaml", "room.yaml"):
        (folder / name).write_text((hop / name).read_text())
    (folder / "wrong.yaml").write_text(f"star: 1\nnmae: {json.dumps(ESCAPE)}\n")
    (folder / "study.yaml").write_text(STUDY)
    (folder / "original.yaml").write_text(ORIGINAL)
    shutil.copy(SHIPPED / "worlds/lab_4x4.yaml", folder / "arena.yaml")
    return folder


@pytest.mark.usefixtures("hostile", "in_process")
def test_no_command_prints_control_characters(capfd: pytest.CaptureFixture[str]) -> None:
    assert {*Registry().offers()["command"]} == {*COMMANDS}
    for command, lines in COMMANDS.items():
        for line in lines:
            with suppress(SystemExit):  # of argparse
                main([command, *(word.replace("@", FOLDER) for word in line.split())])
            captured = capfd.readouterr()
            for text in captured.out, captured.err:
                assert raw(text) == [], (command, line)
                assert "Traceback" not in text
            if "@" in line and (command, line) not in SILENT:
                assert "\\x1b]0;title\\x07" in captured.out + captured.err, (command, line)


def raw(text: str) -> list[str]:
    """Return the control characters of a text."""
    return sorted({c for c in text if not c.isprintable() and c != "\n"})
