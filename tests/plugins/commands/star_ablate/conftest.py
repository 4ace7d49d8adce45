"""A short mission to study, and a plugin that ends its process, raises or hangs on request."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from textwrap import dedent
from typing import TypeAlias

import pytest

from star_ablate.flight import Job, Result

Write: TypeAlias = Callable[[str], Path]

WORLD = "star: 1\nname: room\nfence: {low: [-2, -2, 0], high: [2, 2, 2]}\n"
MISSION = """\
star: 1
name: hop
world: room.yaml
swarm: {cf1: {start: [0, 0, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: none
mission:
  - takeoff: {height: 0.3}
  - land: {}
"""
WRECKER = '''
"""Avoider ``wrecker``: avoids no agent, and does harm when it is made or used."""

import os
import signal
import subprocess
import time

from star_core import AvoiderSpec, hookimpl

HARM = {
    "exit": lambda: os._exit(3),
    "segfault": lambda: os.kill(os.getpid(), signal.SIGSEGV),
    "raise": lambda: {}["harm"],
    "quit": lambda: exit("harm"),
    "hang": lambda: time.sleep(1000),
    "nap": lambda: time.sleep(0.3),
    "breed": lambda: time.sleep(print(subprocess.Popen(["sleep", "1000"]).pid, flush=True) or 1000),
}


class Wrecker:
    def __init__(self, scene, made="", used=""):
        self.used = used
        if made:
            HARM[made]()

    def avoid(self, estimate, wanted):
        if self.used:
            HARM[self.used]()
        return wanted


@hookimpl
def star_avoiders():
    text = {"type": "string", "description": "What to do.", "default": ""}
    options = {"type": "object", "properties": {"made": text, "used": text}}
    yield AvoiderSpec(name="wrecker", summary="Does harm.", make=Wrecker, options=options)
'''


def install(site: Path, text: str) -> Path:
    """Write the plugin and its metadata into a folder, and return the folder."""
    about = site / "star_wrecker-1.0.dist-info"
    about.mkdir(parents=True)
    (site / "star_wrecker.py").write_text(text)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: star-wrecker\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[star.plugins]\nwrecker = star_wrecker\n")
    return site


@pytest.fixture(scope="session")
def laid_out() -> Callable[[Path], Write]:
    """Lays two equal missions out, ``hop.yaml`` and ``jump.yaml``; returns a writer of studies."""

    def lay_out(folder: Path) -> Write:
        (folder / "lab" / "studies").mkdir(parents=True)
        (folder / "lab" / "room.yaml").write_text(WORLD)
        for name in ("hop", "jump"):
            (folder / "lab" / f"{name}.yaml").write_text(MISSION)

        def write(text: str) -> Path:
            path = folder / "lab" / "studies" / "study.yaml"
            path.write_text("star: 1\nname: study\n" + dedent(text))
            return path

        return write

    return lay_out


@pytest.fixture
def study(tmp_path: Path, laid_out: Callable[[Path], Write]) -> Write:
    """Writes a study of that text."""
    return laid_out(tmp_path)


@pytest.fixture
def instant(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replaces flights by a summary whose measures depend on the seed."""

    def fly_all(
        _: object, jobs: Sequence[Job], *__: object, **___: object
    ) -> Iterator[tuple[int, Result]]:
        for index, job in enumerate(jobs):
            measure = float(job.mission.scene.seed)
            summary = {"flight_time_s": measure, "path_length_m": {"total": measure}}
            yield index, Result("completed", "", 0.1, summary)

    monkeypatch.setattr("star_ablate.workers.Processes.fly_all", fly_all)


@pytest.fixture
def wrecker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Installs the wrecker for this process and those it starts; where it stands is returned."""
    site = install(tmp_path / "site", WRECKER)
    monkeypatch.syspath_prepend(site)
    monkeypatch.delitem(sys.modules, "star_wrecker", raising=False)  # that of another test
    return site


def rows(folder: Path) -> list[dict[str, str]]:
    """Read the results of a study."""
    with (folder / "results.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(name="rows")
def _rows() -> Callable[[Path], list[dict[str, str]]]:
    return rows
