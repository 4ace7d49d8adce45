"""Files of the original STAR and of Crazyswarm2, in their own grammar, and the command."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import pytest

from star_core import InputError, Mission, Registry, load
from star_core.errors import code_of
from tests.commands import command

main = command("import")

Import: TypeAlias = Callable[..., list[str]]

ROBOTS = """\
robots:
  cf1: {enabled: true, uri: radio://0/80/2M/E7E7E7E701, initial_position: [-1.0, 0.0, 0.0], type: a}
  cf2: {enabled: true, uri: radio://0/80/2M/E7E7E7E702, initial_position: [0.0, 0.0, 0.0], type: a}
  cf3: {enabled: false, uri: radio://0/80/2M/E7E7E7E703, initial_position: [1.0, 0.0, 0.0], type: a}
robot_types:
  a: {battery: {voltage_critical: 3.7}}
"""


def refusals(*arguments: str) -> list[str]:
    """Return what each problem of a refused import is about, with its code."""
    with pytest.raises(InputError) as raised:
        main(arguments)
    return [f"{text.partition(': ')[0]} [{code_of(text)}]" for text in raised.value.problems]


def remark(note: dict[str, Any]) -> str:
    """Return a remark of ``--json`` as a line."""
    place = f":{note['line']}:{note['column']}" if "line" in note else ""
    about = f"{note['about']}: " if "about" in note else ""
    return f"{note['severity']} {note['file']}{place}: {about}{note['message']}"


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def place(name: str, text: str) -> str:
    """Put a file into the working folder, and return its name."""
    Path(name).write_text(text, encoding="utf-8")
    return name


@pytest.fixture
def take(capsys: pytest.CaptureFixture[str]) -> Import:
    """Import files, and return the remarks: ``severity location: name: message``."""

    def took(*arguments: str) -> list[str]:
        assert main([*arguments, "--json"]) == 0
        return [*map(remark, json.loads(capsys.readouterr().out)["notes"])]

    return took


@pytest.fixture
def commands(take: Import) -> Callable[..., Mission]:
    """Import a mission of the original with two robots, and load what came out."""

    def flown(text: str, *arguments: str) -> Mission:
        place("m.yaml", f"command_sequence: [\n{text}\n]\n")
        place("crazyflies.yaml", ROBOTS)
        take("m.yaml", "crazyflies.yaml", "--force", *arguments)
        return load(Path("imported/m.yaml"), Registry())

    return flown
