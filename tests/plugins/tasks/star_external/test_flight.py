"""Whole missions with the verb ``external``."""

from __future__ import annotations

import json
import random
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import pytest

from star_core import Estimate, Registry, Scene, fly, load
from star_core.commands.main import main
from star_external.planner import Answer, Done, Goal
from tests.plugins.mission_files import write_mission
from tests.plugins.tasks.star_external.conftest import Offering
from tests.waiting import free_port

LED = """\
  - takeoff: {height: 0.5}
  - external: {port: PORT}
  - external: {port: PORT, until: {elapsed: 0.5}}
  - repeat: {times: 2, steps: [external: {port: PORT, agents: cf1, until: {elapsed: 0.5}}]}
"""
PLANNED = "  - takeoff: {height: 0.5}\n  - external: {planner: theirs}\n"
STEPS = 4
SOON = 30.0  # s


def connected(port: int) -> socket.socket:
    until = time.monotonic() + SOON
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=SOON)
        except ConnectionRefusedError:
            assert time.monotonic() < until
            time.sleep(0.01)


def lead_up(lines: TextIO, dawdle: random.Random) -> None:
    """Answer every state, slowly now and then, with goals above the agents."""
    for line in lines:
        state = json.loads(line)
        if "star" in state:
            continue
        if dawdle.random() < 0.1:
            time.sleep(0.02 * dawdle.random())
        positions = {name: agent["position"] for name, agent in state["agents"].items()}
        goals = {
            name: {"position": [x, y, min(z + 0.2, 1.5)]} for name, (x, y, z) in positions.items()
        }
        over = all(z > 1.2 for _, _, z in positions.values())
        print(json.dumps({"done": True} if over else {"goals": goals}), file=lines, flush=True)


def lead(port: int, seed: int) -> None:
    """Lead the agents of every step up."""
    dawdle = random.Random(seed)  # noqa: S311 -- a pause is no secret
    for _ in range(STEPS):
        with connected(port) as client, client.makefile("rw") as lines:
            lead_up(lines, dawdle)


def flown(folder: Path, seed: int) -> dict[str, Any]:
    folder.mkdir()
    port = free_port()
    mission = write_mission(folder, LED.replace("PORT", str(port)), seed="3")
    leader = threading.Thread(target=lead, args=(port, seed))
    leader.start()
    assert main(["run", str(mission), "--json", "--out", str(folder / "out")]) == 0
    leader.join(SOON)
    summary: dict[str, Any] = json.loads((folder / "out" / "summary.json").read_text())
    return summary


def test_lockstep_flights_do_not_depend_on_process_speed(tmp_path: Path) -> None:
    steps = flown(tmp_path / "a", 1)["steps"]
    assert [step["verb"] for step in steps] == ["takeoff", *STEPS * ["external"]]
    assert flown(tmp_path / "b", 2)["steps"] == [
        {**step, "location": step["location"].replace("/a/", "/b/")} for step in steps
    ]
    with (
        np.load(tmp_path / "a" / "out" / "trajectory.npz") as a,
        np.load(tmp_path / "b" / "out" / "trajectory.npz") as b,
    ):
        assert a["truth_position"][:, :, 2].max() > 1.2
        for name in a:
            assert np.array_equal(a[name], b[name], equal_nan=a[name].dtype.kind == "f")


def test_the_example_leads_two_drones_round_a_circle(missions: Path, tmp_path: Path) -> None:
    port = str(free_port())
    once = "import external_goals as example; example.LAPS = 1; example.main()"
    script = [sys.executable, "-c", once, port]
    folder = missions.parent / "examples"
    with subprocess.Popen(script, cwd=folder, stderr=subprocess.PIPE, text=True) as example:
        arguments = ["--set", f"mission.1.external.port={port}", "--json", "--out", str(tmp_path)]
        assert main(["run", str(missions / "external.yaml"), *arguments]) == 0
        assert example.communicate(timeout=SOON)[1] == ""
    assert example.returncode == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "completed"
    assert [step["outcome"] for step in summary["steps"]] == 3 * ["success"]
    assert summary["path_length_m"]["total"] > 2 * 5.0  # two drones, a circle of 5 m round


def test_without_another_process_the_example_lands(missions: Path, tmp_path: Path) -> None:
    settings = {"port": free_port(), "response_timeout": 0.05}
    arguments = [f"--set=mission.1.external.{key}={value}" for key, value in settings.items()]
    assert main(["run", str(missions / "external.yaml"), *arguments, "--out", str(tmp_path)]) == 0
    assert "no client connected to 127.0.0.1:" in (tmp_path / "summary.json").read_text()


def test_a_port_in_use_is_reported_before_takeoff(
    missions: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        arguments = [f"--set=mission.1.external.port={port}", "--no-record"]
        assert main(["run", str(missions / "external.yaml"), *arguments]) == 2
    assert f"cannot listen on 127.0.0.1:{port}: " in capsys.readouterr().err


class Rising:
    """A planner that leads the agents to 1 m, and is done when they are there."""

    def __init__(self, scene: Scene, rows: tuple[int, ...]) -> None:
        self._names = scene.names

    def plan(self, estimate: Estimate, _health: object, rows: tuple[int, ...]) -> Answer:
        if (estimate.position[list(rows), 2] > 0.95).all():
            return self.arrive()
        positions = estimate.position.tolist()
        return {self._names[row]: Goal((*positions[row][:2], 1.0)) for row in rows}

    def arrive(self) -> Answer:
        return Done()


class Breaking(Rising):
    """One that breaks when they are there."""

    def arrive(self) -> Answer:
        raise KeyError("altitude")


def planned(folder: Path, make: Callable[..., object]) -> dict[str, Any]:
    mission = write_mission(folder, PLANNED)
    registry = Registry(Offering(make))
    return fly(load(mission, registry), registry, folder=folder / "out")


def test_a_planner_in_this_process_leads_the_agents(tmp_path: Path) -> None:
    summary = planned(tmp_path, Rising)
    assert [step["outcome"] for step in summary["steps"]] == ["success", "success"]
    with np.load(tmp_path / "out" / "trajectory.npz") as record:
        assert record["truth_position"][:, :, 2].max() > 0.9


def test_all_agents_land_when_a_planner_fails_and_it_is_named(tmp_path: Path) -> None:
    summary = planned(tmp_path, Breaking)
    assert summary["outcome"] == "failed"
    assert summary["reason"].startswith("task 'external' (star-swarm ")
    origin = "tests.plugins.tasks.star_external.conftest:Offering"
    assert f"external planner 'theirs' ({origin}): KeyError: 'altitude' (" in summary["reason"]
    with np.load(tmp_path / "out" / "trajectory.npz") as record:
        height = record["truth_position"][:, :, 2]
    assert height.max() > 0.9
    assert height[-1].max() < 0.05
