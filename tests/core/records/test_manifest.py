"""What is kept of a flight is enough to fly it again."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import pytest

from star_core import TaskSpec, hookimpl
from star_core.commands.main import main
from star_core.discovery import Source
from star_core.plugin_support.registry import Registry
from star_core.records.manifest import manifest, packages
from star_yaml.mission_loader import load

ROOT = Path(__file__).parents[3]
WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
obstacles:
  pillar: {polygon: [[0.8, 0.8], [1.2, 0.8], [1, 1.2]], height: [0, 2]}
  wall: {polyline: [[-1, 1], [0, 1.5]], thickness: 0.1, height: [0, 1.5]}
"""
MISSION = """\
star: 1
name: again
world: worlds/room.yaml
limits: {speed: 0.6}
swarm:
  cf1: {start: [-0.5, 0, 0], yaw_deg: 30}
  cf2: {start: [0.5, 0, 0]}
groups: {pair: [cf1, cf2]}
transport: {use: sim, battery: 0.9}
localizer: flow
planner: straight
avoider: {use: orca, radius: 0.15}
mission:
  - takeoff: {height: 0.4, speed: 0.5}
  - goto: {agents: pair, to: [0, -0.1, 0.5]}
  - land: {speed: 0.5}
"""
PLACE = re.compile(r"^\S+?:\d+ ")  # where a step is written; elsewhere once it is JSON


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("m.yaml"), MISSION)
    write(Path("worlds/room.yaml"), WORLD)


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def flown(path: Path, *arguments: str, out: str = "out") -> tuple[dict[str, Any], dict[str, Any]]:
    """Fly a mission; return its manifest, and its summary without places."""
    assert main(["run", str(path), "--json", "--out", out, *arguments]) == 0
    kept, summary = (
        json.loads((Path(out) / name).read_text()) for name in ("manifest.json", "summary.json")
    )
    summary["events"] = [
        event | {"text": PLACE.sub("", event["text"]), "details": located(event.get("details"))}
        for event in summary["events"]
    ]
    summary["steps"] = [located(step) for step in summary["steps"]]
    return kept, summary


def located(details: dict[str, Any] | None) -> dict[str, Any]:
    """Return the details of a step without its location."""
    return {**(details or {}), "location": "", "included_from": []}


def unpacked(kept: dict[str, Any], folder: Path) -> Path:
    """Write the mission and the world that a manifest keeps into a folder of their own."""
    write(folder / kept["mission"]["world"], json.dumps(kept["world"]))
    write(folder / "mission.json", json.dumps(kept["mission"]))
    for name, text in kept["files"].items():
        write(folder / name, text)
    return folder / "mission.json"


def test_flights_from_a_manifest_repeat_flight_and_manifest(tmp_path: Path) -> None:
    changes = ("--seed", "11", "--set", "mission.1.goto.to.2=0.6", "--set", "rate=25")
    kept, summary = flown(Path("m.yaml"), *changes)
    again, repeated = flown(unpacked(kept, tmp_path / "elsewhere"), out="again")
    assert repeated == summary
    assert summary["seed"] == 11
    files = {"mission_file", "world_file"}
    assert {k: again[k] for k in again.keys() - files} == {k: kept[k] for k in kept.keys() - files}


def test_a_flight_along_a_file_can_be_flown_again(tmp_path: Path) -> None:
    write(Path("path.csv"), "x,y,z\n-0.5,0,0.4\n-0.5,-0.2,0.4\n")
    along = "follow: {agents: cf1, file: path.csv}"
    write(Path("m.yaml"), MISSION.replace("goto: {agents: pair, to: [0, -0.1, 0.5]}", along))
    kept, summary = flown(Path("m.yaml"))
    _, again = flown(unpacked(kept, tmp_path / "elsewhere"), out="again")
    assert again == summary


def test_manifest_keeps_mission_and_world_as_flown() -> None:
    kept = manifest(load(Path("m.yaml"), Registry(), ["seed=3"]), Registry())
    assert kept["mission"]["seed"] == kept["seed"] == 3
    assert kept["mission"]["swarm"]["cf1"] == {"start": [-0.5, 0, 0], "yaw_deg": 30}
    assert kept["world"]["obstacles"]["wall"]["thickness"] == 0.1
    assert (kept["mission_file"], kept["world_file"]) == ("m.yaml", "worlds/room.yaml")


def test_manifest_keeps_each_plugin_with_options_and_source() -> None:
    kept = manifest(load(Path("m.yaml"), Registry()), Registry())
    assert kept["seed"] == 0
    assert kept["plugins"].keys() >= {"transport", "localizer", "planner", "avoider"}
    assert kept["plugins"]["transport"] == {
        "name": "sim",
        "options": {"battery": 0.9},
        "plugin": "star-swarm:sim",
        "version": version("star-swarm"),
    }


class Nudger:
    """A third party's plugin that offers the verb ``nudge``."""

    @hookimpl
    def star_tasks(self) -> Iterable[TaskSpec]:
        return [TaskSpec(name="nudge", summary="Nudges.", make=cast("Any", object))]


def test_the_plugin_of_a_verb_is_kept() -> None:
    registry = Registry()
    registry.add(Nudger(), Source("their-dist:nudger", "1.2"))
    kept = manifest(load(Path("m.yaml"), registry, ["mission.1={nudge: {}}"]), registry)
    assert kept["verbs"]["nudge"] == {"plugin": "their-dist:nudger", "version": "1.2"}
    assert kept["third_parties"] == {"their-dist:nudger": "1.2"}


def test_manifest_keeps_the_versions_of_all_dependencies() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = {re.split("[<>=!~ ]", line)[0].replace(".", "-") for line in project["dependencies"]}
    kept = packages()
    assert {name.replace(".", "-") for name in kept} == {"star-swarm", *needed}
    assert all(kept_version == version(name) for name, kept_version in kept.items())
