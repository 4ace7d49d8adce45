"""`star --help`: every command by group."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from star_core.commands.main import main, overview
from star_core.plugin_support.registry import Registry

ENTER = "import sys; from star_core.commands.main import main; main()"
GREET = """
from star_core import hookimpl
from star_core.commands import CommandSpec

@hookimpl
def star_commands():
    yield CommandSpec(name="greet", summary="Greets.", configure=print, run=print, group="Fly")
"""


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A folder that plugins can be installed in."""
    folder = tmp_path / "site"
    folder.mkdir()
    return folder


@pytest.fixture
def star(site: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run ``star --help`` with a folder of plugins of its own."""

    def run() -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", ENTER, "--help"],
            capture_output=True,
            text=True,
            check=True,
            env=os.environ | {"PYTHONPATH": str(site)},
        )

    return run


@pytest.fixture
def install(site: Path) -> Callable[[str], None]:
    def installed(text: str) -> None:
        (site / "greeter.py").write_text(text)
        info = site / "greeter-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Name: greeter\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[star.plugins]\ngreeter = greeter\n")

    return installed


def test_every_command_is_listed_under_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    groups = re.findall(r"^(\w+)\n((?:  .*\n)+)", capsys.readouterr().out, re.MULTILINE)
    listed = {
        (group, line.split()[0])
        for group, lines in groups
        for line in re.findall(r"^  \w+", lines, re.MULTILINE)
    }
    offers = Registry().offers()["command"]
    assert listed == {(offer.group, name) for name, offer in offers.items()}
    assert [group for group, _ in groups] == [
        "Fly",
        "Review",
        "Author",
        "Study",
        "Hardware",
        "Plugins",
    ]


def test_the_commands_of_an_installed_plugin_are_listed(
    star: Callable[..., subprocess.CompletedProcess[str]], install: Callable[[str], None]
) -> None:
    install(GREET)
    assert "  greet       Greets.\n" in star().stdout


def test_a_broken_plugin_is_reported(
    star: Callable[..., subprocess.CompletedProcess[str]], install: Callable[[str], None]
) -> None:
    install("1 / 0")
    reported = "star: plugin greeter 1.0:greeter is left out: ZeroDivisionError: division by zero\n"
    assert star().stderr == reported


def test_summaries_are_broken_between_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    lines = overview(Registry()).splitlines()
    assert max(map(len, lines)) <= 60
    (at,) = [i for i, line in enumerate(lines) if line.startswith("  tags ")]
    assert lines[at + 1].startswith(" " * 14 + "in true size")
