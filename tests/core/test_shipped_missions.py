"""What ships in ``missions/``: enough to copy from, short, and told in its README."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

from star_core.cli import main
from star_core.registry import Registry
from star_core.schema import compose, compose_steps
from star_core.yaml_text import parse

MISSIONS = Path(__file__).parents[2] / "missions"
FILES = sorted(MISSIONS.glob("*.yaml"))
README = (MISSIONS / "README.md").read_text(encoding="utf-8")
MOST_LINES = 40


def verbs(steps: list[dict[str, Any]]) -> Iterator[str]:
    """Every verb of some steps, and of the steps in them."""
    for step in steps:
        for verb, options in step.items():
            yield verb
            inner = options if isinstance(options, list) else options.get("steps", [])
            yield from verbs(inner)


def test_every_verb_occurs_in_a_mission_that_ships() -> None:
    used = {verb for path in FILES for verb in verbs(parse(path.read_text()).data["mission"])}
    offered = compose(Registry().offers())["$defs"]["step"]["properties"]
    assert used == set(offered)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_mission_is_short_says_in_a_comment_what_it_shows_and_names_its_schema(
    path: Path,
) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= MOST_LINES
    assert lines[0] == "# yaml-language-server: $schema=mission.schema.json"
    assert re.match(r"# [A-Z].*[.:;,a-z]", lines[1])
    assert lines[lines.index("star: 1") + 1] == f"name: {path.stem.replace('_', '-')}"


def test_the_schema_beside_them_is_what_star_writes() -> None:
    beside = json.loads((MISSIONS / "mission.schema.json").read_text())
    assert beside == compose(Registry().offers())


def test_the_schema_of_steps_beside_them_is_what_star_writes() -> None:
    beside = json.loads((MISSIONS / "steps.schema.json").read_text())
    assert beside == compose_steps(Registry().offers(), admit=True)


@pytest.mark.parametrize("path", sorted(MISSIONS.glob("steps/*.yaml")), ids=lambda path: path.stem)
def test_a_file_of_steps_names_its_schema_and_is_right(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0] == "# yaml-language-server: $schema=../steps.schema.json"
    assert re.match(r"# [A-Z]", lines[1])
    assert main(["check", str(path)]) == 0


def test_the_readme_names_every_mission_and_nothing_else() -> None:
    assert sorted(re.findall(r"\]\(([a-z0-9_]+\.yaml)\)", README)) == [path.name for path in FILES]


def test_every_link_of_the_readme_leads_somewhere() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert [link for link in links if not (MISSIONS / link).exists()] == []


COMMANDS = [
    line.partition("#")[0].strip()
    for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    for line in block.splitlines()
]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_the_readme_works(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copytree(MISSIONS, tmp_path / "missions")
    monkeypatch.chdir(tmp_path)
    program, *words = shlex.split(command)
    assert program == "star"
    assert main(words) == 0
