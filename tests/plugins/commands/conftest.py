"""What tests of several commands share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest

from star_ablate.flight import Job, Result, fly_job
from star_core import Registry, Run, read_run
from star_core.commands.main import main

MISSION = """\
star: 1
name: swap
world: room.yaml
seed: 7
swarm: {cf1: {start: [-0.6, 0, 0]}, cf2: {start: [0.6, 0.1, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {height: 0.4, speed: 0.5}
  - goto: {agents: cf1, by: [0.6, 0.5, 0]}
  - land: {speed: 0.5}
"""
WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
obstacles: {pillar: {polygon: [[1, 1], [1.2, 1], [1.2, 1.2], [1, 1.2]], height: [0, 2]}}
landmarks: {door: {tags: [300, 301], size: 0.05, at: [0, 1.5, 0]}}
"""


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Has `star ablate` fly in this process: a worker process needs a second to start."""

    def fly_all(
        _: object, jobs: Sequence[Job], *__: object, **___: object
    ) -> Iterator[tuple[int, Result]]:
        registry = Registry()
        for index, job in enumerate(jobs):
            yield index, fly_job(job, registry)

    monkeypatch.setattr("star_ablate.workers.Processes.fly_all", fly_all)


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A flight that is recorded."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "room.yaml").write_text(WORLD)
    (folder / "swap.yaml").write_text(MISSION)
    assert main(["run", str(folder / "swap.yaml"), "--out", str(folder / "run")]) == 0
    return read_run(folder / "run")
