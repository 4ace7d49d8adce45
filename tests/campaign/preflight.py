"""``star preflight`` against a fleet: each injected fault is named, and no other.

``python -m tests.campaign.preflight`` checks a swarm with a fault of each drone, and a swarm
without, over UDP in real time. A faulty drone must be reported by exactly the checks in `FAULTS`.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, redirect_stdout
from pathlib import Path
from typing import Any, Final, NamedTuple
from unittest.mock import patch

import numpy as np

from star_core import Registry, load
from star_core.commands import run_command
from star_core.toolkit import fill_defaults
from star_fleet.aideck import Wifi
from star_fleet.conditions import Condition
from star_fleet.link_faults import LinkFaults
from star_fleet.server import Fleet
from star_sim import OPTIONS, simulator_arguments

NOWHERE: Final = "udp://127.0.0.1:9"
LOSS: Final = 0.25  # of a lossy link, each way
WORLD: Final = Path(__file__).parents[2] / "missions/worlds/paper_sparse.yaml"
PACKAGE: Final = """
import json, time
from types import SimpleNamespace

def connect(kind, options):
    return System(options["hostname"])

class System:
    def __init__(self, file):
        self.rigidBodies = {
            name: SimpleNamespace(
                position=pose[:3], rotation=SimpleNamespace(x=0.0, y=0.0, z=pose[3], w=pose[4])
            )
            for name, pose in json.load(open(file)).items()
        }

    def waitForNextFrame(self):
        time.sleep(0.01)
"""
"""A stand-in for ``motioncapture``, whose bodies are those of a file."""


class Case(NamedTuple):
    """A drone of the campaign.

    Attributes:
        conditions: Of its firmware.
        reported: The checks that are not ok, with their severities.
        camera: Whether it carries a camera.
        other: What is wrong beside its firmware: its link, or its body.
    """

    conditions: frozenset[Condition]
    reported: Mapping[str, str]
    camera: bool = False
    other: str = ""


def _case(*conditions: Condition, camera: bool = False, other: str = "", **checks: str) -> Case:
    return Case(
        frozenset(conditions),
        {name.replace("_", "-"): severity for name, severity in checks.items()},
        camera,
        other,
    )


FAULTS: Final = {
    "battery": _case(Condition.EMPTY_BATTERY, battery="error"),
    "self_test": _case(Condition.FAILED_SELF_TEST, self_test="error"),
    "flow_deck": _case(Condition.NO_FLOW_DECK, decks="error", estimator="error"),
    "camera_deck": _case(Condition.NO_AI_DECK, decks="warning", camera=True),
    "deck_fault": _case(Condition.DECK_FAULT, supervisor="error"),
    "locked": _case(Condition.LOCKED, supervisor="error"),
    "crashed": _case(Condition.CRASHED, supervisor="error"),
    "tumbled": _case(Condition.TUMBLED, supervisor="error"),
    "estimator": _case(Condition.UNSETTLED, estimator="error"),
    "displaced": _case(Condition.DISPLACED, start="error"),
    "stations": _case(Condition.NO_STATIONS, positioning="warning"),
    "silent": Case(frozenset({Condition.NO_IMAGES}), {"camera": "warning"}, camera=True),
    "dark": Case(frozenset({Condition.DARK_IMAGES}), {"camera": "warning"}, camera=True),
    "lossy": _case(other="loss", link="warning or error"),  # it may not be connected in time
    "absent": _case(other="absent", link="error"),
    "hidden": _case(other="body", positioning="error"),
}
CLEAN: Final = {"plain": _case(), "eye": _case(camera=True), "base": _case(Condition.LIGHTHOUSE)}


def mission_text(cases: Mapping[str, Case], seed: int) -> str:
    """Return a mission of these drones, which stand in a grid."""
    random = np.random.default_rng(seed)
    agents = []
    for number, (name, case) in enumerate(cases.items()):
        x, y = -1.5 + number % 4, -1.5 + number // 4
        yaw = int(random.integers(-180, 180))
        eye = ", camera: aideck" if case.camera else ""
        uri = f"udp://127.0.0.1:{20000 + number}"
        agents.append(f"  {name}: {{start: [{x}, {y}, 0], yaw_deg: {yaw}, uri: {uri!r}{eye}}}")
    return "\n".join(
        [
            "star: 1",
            "name: preflight",
            f"seed: {seed}",
            "world: world.yaml",
            "swarm:",
            *agents,
            "transport: radio",
            "localizer: flow",
            "planner: straight",
            "avoider: none",
            "mission: [takeoff: {height: 0.5}, land: {}]",
            "",
        ]
    )


@contextmanager
def served(cases: Mapping[str, Case], folder: Path, seed: int) -> Iterator[list[str]]:
    """Serve drones, and yield the arguments of ``star preflight`` for them."""
    mission = folder / "mission.yaml"
    mission.write_text(mission_text(cases, seed), encoding="utf-8")
    (folder / "world.yaml").write_text(WORLD.read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "motioncapture.py").write_text(PACKAGE, encoding="utf-8")
    scene = load(mission, Registry()).scene
    simulated = simulator_arguments(
        **{**fill_defaults({}, OPTIONS), "camera": {"mode": "rendered"}, "speed": 1.0}
    )
    conditions = {row: case.conditions for row, case in enumerate(cases.values())}
    fleet = Fleet(scene, port=0, conditions=conditions, **simulated)
    with closing(Wifi(fleet, scene, "127.0.0.1", links=None, cameras=0)) as wifi, fleet:
        bodies = {}
        arguments = [str(mission)]
        names = [*cases]
        cameras = {names[row]: address for row, address in wifi.cameras.items()}
        for row, (name, case) in enumerate(cases.items()):
            if case.other == "loss":
                fleet.links.faults[row] = LinkFaults(loss=LOSS)
            uri = NOWHERE if case.other == "absent" else fleet.addresses[row]
            arguments.append(f"--set=swarm.{name}.uri={uri}")
            if case.other != "body":
                drone, half = fleet.simulator.drones[row], scene.agents[row].yaw / 2
                bodies[name] = [*drone["position"].tolist(), np.sin(half), np.cos(half)]
        (folder / "bodies.json").write_text(json.dumps(bodies), encoding="utf-8")
        bodies_file = str(folder / "bodies.json")
        radio = {
            "use": "radio",
            "cache": str(folder / "tables"),
            "cameras": cameras,
            "mocap": {"source": {"motioncapture": {"type": "mock", "host": bodies_file}}},
        }
        yield [*arguments, f"--set=transport={json.dumps(radio)}"]


def flagged(arguments: Sequence[str]) -> tuple[int, dict[str, dict[str, str]]]:
    """Return the exit status, and by agent the checks that are not ok with their severities."""
    output = io.StringIO()
    with redirect_stdout(output):
        status = run_command("preflight", [*arguments, "--json"], Registry())
    report: dict[str, dict[str, str]] = {}
    for finding in json.loads(output.getvalue())["findings"]:
        checks = report.setdefault(finding["agent"], {})
        if finding["severity"] != "ok":
            assert finding["remedy"], finding
            checks[finding["check"]] = finding["severity"]
    return status, report


def misreports(cases: Mapping[str, Case], folder: Path, seed: int) -> dict[str, Any]:
    """Return, by agent, what is reported if it is not what is wrong."""
    sys.path.insert(0, str(folder))
    try:
        with served(cases, folder, seed) as arguments:
            status, report = flagged(arguments)
    finally:
        sys.path.remove(str(folder))
    wrong: dict[str, Any] = {
        name: report.get(name)
        for name, case in cases.items()
        if not _as_expected(report.get(name, {}), case.reported)
    }
    if status != any("error" in case.reported.values() for case in cases.values()):
        wrong["exit status"] = status
    return wrong


def _as_expected(report: Mapping[str, str], expected: Mapping[str, str]) -> bool:
    return report.keys() == expected.keys() and all(
        report[check] in severity.split(" or ") for check, severity in expected.items()
    )


def main() -> int:
    """Run the campaign; return 1 if a fault was not named, or another one was."""
    line = argparse.ArgumentParser(description=__doc__)
    line.add_argument("--runs", type=int, default=30, help="runs with faults: %(default)s")
    line.add_argument("--clean", type=int, default=100, help="runs without: %(default)s")
    options = line.parse_args()
    named: Counter[str] = Counter()
    alarms = 0
    for number in range(options.runs + options.clean):
        cases = FAULTS if number < options.runs else CLEAN
        with (
            tempfile.TemporaryDirectory() as folder,
            patch.dict(os.environ, XDG_CACHE_HOME=folder),
        ):
            wrong = misreports(cases, Path(folder), 1000 + number)
        if cases is FAULTS:
            named.update(name for name in cases if name not in wrong)
        else:
            alarms += bool(wrong)
        if wrong:
            print(f"run {number}: {wrong}")
    for name in FAULTS:
        print(f"{name:12} {named[name]} of {options.runs} named, and no other")
    print(f"false alarms in {alarms} of {options.clean} runs without a fault")
    return int(alarms > 0 or any(named[name] < options.runs for name in FAULTS))


if __name__ == "__main__":
    sys.exit(main())
