"""What ships in ``missions/``: enough to copy from, short, and listed in its README."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

from star_core import InputError, load
from star_core.commands.main import main
from star_core.plugin_support.registry import Registry
from star_yaml import schema
from star_yaml.editor_schema import editor_schema
from star_yaml.schema import compose
from star_yaml.yaml_reader import parse

MISSIONS = Path(__file__).parents[2] / "missions"
FILES = sorted(MISSIONS.glob("*.yaml"))
README = (MISSIONS / "README.md").read_text(encoding="utf-8")
MOST_LINES = 40
HEAVY = (
    "numba",
    "cv2",
    "gtsam",
    "cflib",
    "star_external.tcp_server",
)  # numpy, shapely and scipy may


LEFT_OUT = {
    *("around", "search", "search_flow"),  # their rehearsals call planner and avoider
    *("paper_box", "paper_circle"),  # as paper_figure8, but for the path
}


def verbs(steps: list[dict[str, Any]]) -> Iterator[str]:
    """Every verb of some steps, and of the steps in them."""
    for step in steps:
        for verb, options in step.items():
            yield verb
            lists = [options]
            if isinstance(options, dict):
                lists = [options.get(key, []) for key in ("steps", "then", "else")]
            for inner in lists:
                yield from verbs(inner)


def test_first_flight_notes_its_hardware_requirements() -> None:
    path, registry = MISSIONS / "first_flight.yaml", Registry()
    (line,) = [line for line in path.read_text().splitlines() if line.startswith("transport: ")]
    assert re.search(r"# on hardware: radio, with the extra \[radio\] and a uri per agent$", line)
    radio = ["transport=radio"]
    with pytest.raises(InputError, match="uri"):
        load(path, registry, radio)
    uris = [f"swarm.cf{i}.uri=radio://0/80/2M/E7E7E7E70{i}" for i in (1, 2, 3)]
    assert load(path, registry, [*radio, *uris]).plugins["transport"].use == "radio"


@pytest.mark.extended
def test_checking_the_missions_imports_nothing_heavy() -> None:
    """Between them they use every verb and plugin, so this holds for all built-in checks.

    The rehearsal imports numpy, and for more than four agents scipy. In a world with obstacles it
    calls planner and avoider, if these lead around them.
    """
    paths = [str(path) for path in FILES if path.stem not in LEFT_OUT]
    ask = (
        "import sys; from star_core.commands.main import main\n"
        "exact = ['--set', 'limits.uncertainty_margin=0']\n"
        f"assert [main(['check', path, *exact]) for path in sys.argv[1:]] == [0] * {len(paths)}\n"
        f"assert not {{*{HEAVY!r}}} & {{*sys.modules}}"
    )
    subprocess.run([sys.executable, "-c", ask, *paths], check=True)


def test_rehearsing_three_agents_imports_neither_scipy_nor_numba() -> None:
    ask = (
        "import sys; from star_core.commands.main import main; main(['check', sys.argv[1]])\n"
        "assert 'star_explain.drift' in sys.modules\n"
        "assert 'star_core.execution.executor' in sys.modules\n"
        "assert not {'scipy', 'numba'} & {*sys.modules}"
    )
    path = MISSIONS / "first_flight.yaml"
    subprocess.run([sys.executable, "-c", ask, path], check=True)


def test_plugins_receive_target_positions_as_the_schema_states() -> None:
    targets = load(MISSIONS / "search.yaml", Registry()).scene.world.targets
    assert all(np.isfinite(tag.position).all() for tag in targets)
    said = schema.load("world")["properties"]["targets"]["description"]
    assert "Every plugin gets them in Scene.world.targets" in said


def test_every_verb_occurs_in_a_mission_that_ships() -> None:
    used = {
        verb for path in FILES for verb in verbs(parse(path.read_text(), "").plain()["mission"])
    }
    offered = compose(Registry().offers())["$defs"]["step"]["properties"]
    assert used == set(offered)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_missions_are_short_commented_and_name_their_schema(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= MOST_LINES
    assert lines[0] == "# yaml-language-server: $schema=mission.schema.json"
    assert re.match(r"# [A-Z].*[.:;,a-z]", lines[1])
    assert lines[lines.index("star: 1") + 1] == f"name: {path.stem.replace('_', '-')}"


@pytest.mark.parametrize("kind", ["mission", "steps"])
def test_the_schemas_beside_them_are_what_star_writes(kind: str) -> None:
    beside = json.loads((MISSIONS / f"{kind}.schema.json").read_text())
    assert beside == editor_schema(kind, Registry())


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
