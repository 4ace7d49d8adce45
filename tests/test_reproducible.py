"""A simulated flight is the same each time: summary.json byte by byte, and the trajectory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from star_core import read_run
from star_core.commands.main import main
from star_record.read_record import split_timing

MISSION = str(Path(__file__).parents[1] / "missions" / "first_flight.yaml")
STEPS = "{takeoff: {height: 0.5}}, {goto: {by: [0.2, 0.1, 0]}}, {land: {speed: 0.5}}"
SETTINGS = (
    *("--set", "transport={use: sim, profile: realistic, controller: pid}"),
    *("--set", f"mission=[{STEPS}]"),
)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A record of the mission."""
    folder = tmp_path_factory.mktemp("flight") / "first"
    assert main(["run", MISSION, *SETTINGS, "--out", str(folder)]) == 0
    return folder


def test_two_flights_are_the_same(flown: Path, tmp_path: Path) -> None:
    assert main(["run", MISSION, *SETTINGS, "--out", str(tmp_path)]) == 0
    assert (tmp_path / "summary.json").read_bytes() == (flown / "summary.json").read_bytes()
    with np.load(flown / "trajectory.npz") as a, np.load(tmp_path / "trajectory.npz") as b:
        for name in a:
            np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def test_hash_seed_and_threads_do_not_change_the_summary(flown: Path, tmp_path: Path) -> None:
    star = Path(sys.executable).with_name("star")
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "3")
    subprocess.run(
        [str(star), "run", MISSION, *SETTINGS, "--out", str(tmp_path / "other")],
        env=os.environ | threads | {"PYTHONHASHSEED": "12345"},
        capture_output=True,
        check=True,
    )
    summary = (tmp_path / "other" / "summary.json").read_bytes()
    assert summary == (flown / "summary.json").read_bytes()


def test_events_of_slow_ticks_are_in_timing_json(flown: Path) -> None:
    timing, summary = flown / "timing.json", flown / "summary.json"
    slow = {"time": 1.5, "kind": "slow", "text": "planner 'far' took 2.00 s for one tick"}
    original = timing.read_text()
    content = json.loads(original)
    assert content["wall_time_s"] > 0
    timing.write_text(json.dumps(content | {"events": [slow]}))
    run = read_run(flown)
    timing.write_text(original)
    times = [event["time"] for event in run.summary["events"]]
    assert slow in run.summary["events"]
    assert times == sorted(times)
    first, second = split_timing(run.summary)
    assert first == json.loads(summary.read_text())
    assert second == content | {"events": [slow]}


def test_a_record_without_timing_json_is_read(flown: Path, tmp_path: Path) -> None:
    for file in ("manifest.json", "trajectory.npz"):
        (tmp_path / file).write_bytes((flown / file).read_bytes())
    summary = read_run(flown).summary
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    assert read_run(tmp_path).summary == summary
