"""The scenarios in ``missions/scenarios`` are what `star bench` writes, and fly.

To write them anew: ``star bench --write-only --seeds 1 --agents 6 --out DIR``, then copy what is in
``DIR/missions``.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from star_bench.files import mission_lines, text, world_lines
from star_bench.scenarios import CATALOGUE, Case
from star_core import Registry, fly, load
from star_core.commands.main import main

AGENTS = 6


@pytest.mark.parametrize("name", CATALOGUE)
def test_an_example_is_what_the_generator_writes(name: str, missions: Path) -> None:
    case = Case(name, AGENTS, 0)
    folder, file = missions / "scenarios", f"{case.name}.yaml"
    assert (folder / file).read_text() == text(mission_lines(case, case.draw()))
    assert (folder / "worlds" / file).read_text() == text(world_lines(case, case.draw()))


def test_there_is_an_example_of_every_scenario_and_no_other_file(missions: Path) -> None:
    expected = sorted(f"{name}-{AGENTS}-0.yaml" for name in CATALOGUE)
    for folder in (missions / "scenarios", missions / "scenarios" / "worlds"):
        assert sorted(path.name for path in folder.glob("*.yaml")) == expected


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_example_checks_and_flies_without_collision(name: str, missions: Path) -> None:
    mission = missions / "scenarios" / f"{name}-{AGENTS}-0.yaml"
    assert main(["check", str(mission)]) == 0
    registry = Registry()
    summary = fly(load(mission, registry, ["rate=10"]), registry)
    assert summary["outcome"] == "completed"
    assert summary["collisions"] == {"agent_agent": 0, "agent_obstacle": 0}
