"""`star --help`: every command by group, from a cache that is never out of date."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from star_core.commands.main import main
from star_core.registry import Registry

ENTER = "import sys; from star_core.commands.main import main; main()"
LOADED = f"{ENTER}; print(*sys.modules, file=sys.stderr)"
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
def star(tmp_path: Path, site: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run a program with the arguments ``--help``, a cache and a folder of plugins of its own."""
    folders = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(site)}

    def run(program: str = ENTER, **environment: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", program, "--help"],
            capture_output=True,
            text=True,
            check=True,
            env=os.environ | folders | environment,
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


def test_every_command_is_listed_under_its_group(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert main(["--help"]) == 0
    groups = re.findall(r"^(\w+)\n((?:  .*\n)+)", capsys.readouterr().out, re.MULTILINE)
    listed = {(group, line.split()[0]) for group, lines in groups for line in lines.splitlines()}
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


def test_the_second_time_no_plugin_is_loaded(
    star: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    first, second = star(LOADED), star(LOADED)
    assert first.stdout == second.stdout
    assert {"pluggy", "star_sim"} <= set(first.stderr.split())
    assert {"pluggy", "star_sim", "argparse"}.isdisjoint(second.stderr.split())


def test_a_command_that_is_installed_changed_or_removed_is_listed_so(
    star: Callable[..., subprocess.CompletedProcess[str]],
    install: Callable[[str], None],
    site: Path,
) -> None:
    before = star().stdout
    install(GREET)
    assert "  greet       Greets.\n" in star().stdout
    (site / "greeter.py").write_text(GREET.replace("Greets.", "Waves to drones."))
    assert "  greet       Waves to drones.\n" in star().stdout
    (site / "greeter-1.0.dist-info" / "entry_points.txt").unlink()
    (site / "greeter.py").unlink()
    assert star().stdout == before


def test_a_broken_plugin_is_reported_each_time(
    star: Callable[..., subprocess.CompletedProcess[str]], install: Callable[[str], None]
) -> None:
    install("1 / 0")
    reported = "star: plugin greeter 1.0:greeter is left out: ZeroDivisionError: division by zero\n"
    assert [star().stderr, star().stderr] == [reported, reported]


def test_a_cache_that_cannot_be_written_or_read_is_done_without(
    star: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    expected = star().stdout
    assert star(XDG_CACHE_HOME=os.devnull).stdout == expected
    (cache,) = (tmp_path / "cache" / "star").iterdir()
    cache.write_bytes(b"\xff\xfe")
    assert star().stdout == expected
