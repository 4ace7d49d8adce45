"""Every block of code in the documentation is what it seems: missions check, commands exist."""

from __future__ import annotations

import argparse
import ast
import json
import re
import shlex
import shutil
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML

import star_mcap
from star_basics.errors import error_catalogue
from star_core.commands.command_line import parser_of as parser_of_spec
from star_core.commands.main import main
from star_core.plugin_support.registry import Registry

ROOT = Path(__file__).parents[1]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "examples/README.md")),
    ROOT / "missions" / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
FENCE = re.compile(r"(?:^`([\w./-]+)`:\n\n)?^( *)```(\w+)\n(.*?)^\2```$", re.MULTILINE | re.DOTALL)
FOREIGN = ("crazyflie_py", "dask_jobqueue")  # shown for comparison, and for clusters

WORLD = """\
star: 1
name: docs
fence: {low: [-3, -3, 0], high: [3, 3, 2.2]}
targets:
  survivor: {tags: [200], at: [0.5, -1.0, 0.0]}
"""
MISSION = """\
star: 1
name: docs
world: docs_world.yaml
swarm:
  cf1: {start: [-2, -2, 0], camera: aideck}
  cf2: {start: [-1, -2, 0], camera: aideck}
  cf3: {start: [0, -2, 0], camera: aideck}
  cf5: {start: [1, -2, 0]}
  cf6: {start: [2, -2, 0]}
transport: sim
localizer: flow
planner: straight
avoider: {use: orca, radius: 0.2}
mission: [takeoff: {height: 0.8}, land: {}]
"""


class Block(NamedTuple):
    """A fenced block of a page, and the name of the file that its caption gives."""

    page: Path
    name: str
    language: str
    text: str

    def __str__(self) -> str:
        first = self.text.strip().partition("\n")[0]
        return f"{self.page.name}: {first[:40]}"


def blocks(*languages: str) -> list[Block]:
    return [
        Block(page, name, language, re.sub(f"^{indent}", "", text, flags=re.MULTILINE))
        for page in PAGES
        for name, indent, language, text in FENCE.findall(page.read_text())
        if language in languages
        and not (name and page.parent.name == "plugins")  # installed by tests/outside
    ]


def loaded(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


def dumped(value: Any) -> str:
    return json.dumps(value)  # which is YAML


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(ROOT / "missions" / "worlds", tmp_path / "worlds")
    shutil.copytree(ROOT / "missions" / "paths", tmp_path / "paths")
    (tmp_path / "cameras").mkdir()
    (tmp_path / "cameras" / "mine.yaml").write_text("star: 1\nname: mine\n")
    (tmp_path / "docs_world.yaml").write_text(WORLD)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("star_mocap.source.installed", lambda _package: True)  # they are optional
    return tmp_path


def check(content: Any, name: str = "block.yaml") -> int:
    Path(name).write_text(content if isinstance(content, str) else dumped(content))
    return main(["check", name])


def in_mission(part: Any) -> Any:
    """Return a mission with a part of one: some of its keys, or steps."""
    mission = loaded(MISSION)
    if isinstance(part, list):
        first = [] if "takeoff" in part[0] else mission["mission"][:1]
        return mission | {"mission": [*first, *part]}
    agents = {**mission["swarm"], **part.get("swarm", {})}
    reserve = part.get("reserve", {}).get("agents", [])
    if "transport" in part and "radio" in str(part["transport"]):
        for i, agent in enumerate(agents.values()):
            agent.setdefault("uri", f"radio://0/80/2M/E7E7E7E7{i + 16:02X}")
    steps = part.get("mission", mission["mission"])
    merged = mission | part | {"swarm": agents, "mission": steps}
    if "localizer" in part or "cameras" in part or reserve:
        merged["world"] = "docs_world.yaml"
    return merged


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("block", blocks("yaml"), ids=str)
def test_every_yaml_block_is_checked(block: Block, capsys: pytest.CaptureFixture[str]) -> None:
    for other in blocks("yaml"):
        if other.page == block.page and other.name:
            Path(other.name).write_text(other.text)
    content = loaded(block.text)
    keys = {*content} if isinstance(content, dict) else set()
    if "factors" in keys:
        schema = json.loads((ROOT / "plugins/commands/star_ablate/study.schema.json").read_text())
        Draft202012Validator(schema).validate(content)
        return
    whole = bool(keys & {"fence", "parameters", "faults"}) or {"swarm", "world", "mission"} <= keys
    assert check(block.text if whole else in_mission(content)) == 0, capsys.readouterr().err


@pytest.mark.parametrize("block", blocks("text", "yaml"), ids=str)
def test_no_block_has_a_code_that_does_not_exist(block: Block) -> None:
    named = re.findall(r" \[([a-z-]+)\]$", block.text, re.MULTILINE)
    assert [code for code in named if code not in error_catalogue()] == []


@pytest.mark.parametrize("block", blocks("python"), ids=str)
def test_every_python_block_compiles_and_its_imports_resolve(block: Block) -> None:
    tree = ast.parse(block.text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert [name.name for name in node.names if find_spec(name.name) is None] == []
        elif isinstance(node, ast.ImportFrom) and node.module not in FOREIGN:
            module = import_module(node.module or "")
            assert [alias.name for alias in node.names if not hasattr(module, alias.name)] == []


def commands(text: str) -> Iterator[list[str]]:
    """Yield the words of each command of a block; one may be on several lines."""
    waiting = ""
    for line in text.splitlines():
        waiting += line.removesuffix("\\") + "\n"
        if line.endswith("\\"):
            continue
        try:
            words = shlex.split(waiting, comments=True)
        except ValueError:  # a quotation that is not closed
            continue
        waiting = ""
        if words:
            yield words
    assert not waiting


@cache
def parser_of(command: str) -> argparse.ArgumentParser:
    """Return the real parser of a command."""
    return parser_of_spec(_registry().find("command", command).offer)


@cache
def _registry() -> Registry:
    return Registry(star_mcap)  # conftest.py blocks it


def extras() -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return {*project["optional-dependencies"]}


@pytest.mark.parametrize("block", blocks("sh"), ids=str)
def test_every_command_of_a_block_exists_with_its_options(
    block: Block, capsys: pytest.CaptureFixture[str]
) -> None:
    makefile = (ROOT / "Makefile").read_text()
    for words in commands(block.text):
        program, *rest = words
        program = program.removeprefix(".venv/bin/")
        if program == "star-run":
            program, rest = "star", ["run", *rest]
        if program == "star" and rest[0] not in {"--help", "--version", "outcomes"}:
            numbers = [re.sub(r"\$\w+", "1", word) for word in rest[1:]]  # of variables
            try:
                parser_of(rest[0]).parse_args(numbers)
            except SystemExit:
                pytest.fail(f"{shlex.join(words)}: {capsys.readouterr().err}")
        elif program == "make":
            assert [target for target in rest if f"\n{target}:" not in makefile] == []
        elif program == "pip":
            matches = re.findall(r"^(?:\.|star-swarm)\[([\w,]+)\]$", "\n".join(rest), re.MULTILINE)
            assert {name for match in matches for name in match.split(",")} <= extras()
        shipped = r"(missions|examples|benchmarks|tests)/[\w./-]+\.(yaml|py)"
        paths = [word for word in words if re.fullmatch(shipped, word)]
        made = ("missions/pictures.yaml", "missions/cameras/mine.yaml")  # by the reader
        assert [path for path in paths if path not in made and not (ROOT / path).exists()] == []


def spoken() -> list[tuple[str, list[str]]]:
    """Return the page and the words of each command in running text."""
    commands_of_pages = []
    for page in PAGES:
        spans = re.findall(r"`star ([a-z][^`]*)`", FENCE.sub("", page.read_text()))
        commands_of_pages += [(page.name, span.split()) for span in spans]
    return commands_of_pages


def test_every_command_in_running_text_exists_with_its_options() -> None:
    known_commands = {*_registry().names("command")}
    wrong = []
    for page, (command, *rest) in spoken():
        if command == "outcomes":  # an example of a plugin
            continue
        if command not in known_commands:
            wrong.append(f"{page}: star {command}")
            continue
        options = [
            word.partition("=")[0] for word in rest if word.startswith("--") and word[2:3].islower()
        ]
        have = {option for each in (parser_of(command)._actions) for option in each.option_strings}
        for sub in parser_of(command)._actions:
            if isinstance(sub.choices, dict):
                have |= {
                    o for p in sub.choices.values() for a in p._actions for o in a.option_strings
                }
        wrong += [f"{page}: star {command} {option}" for option in options if option not in have]
    assert wrong == []


def test_verbs_on_the_crazyflie_py_page_are_checked(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    verbs = {*Registry().names("task"), "parallel", "repeat", "each"}
    text = (ROOT / "docs" / "from-crazyflie-py.md").read_text()
    parts = [
        loaded(span)
        for row in re.findall(r"^\| .* \| (.*) \|$", text, re.MULTILINE)
        for span in re.findall(r"`([a-z]+: \{[^`]*\})`", row)
        if "..." not in span
    ]
    shutil.copy(ROOT / "missions" / "paths" / "eight.csv", folder / "figure8.csv")
    assert len(parts) >= 8
    for part in parts:
        whole = in_mission([part] if {*part} <= verbs else part)
        assert check(whole) == 0, capsys.readouterr().err
