"""Every mission in the repository flies, and leaves the same numbers when it flies again."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import Registry, fly, load
from star_core.cli.main import main, run

MISSIONS = Path(__file__).parents[2] / "missions"
PAPER = "--set=transport.camera.mode=geometric"  # of its long flights; three_eyes has pictures
FREE_PORT = "--set=mission.1.external.port=0"  # of a listener that another test may have too
ONE_LAP = "--set=mission.1.follow.laps=1"
WALL = ("wall_time_s", "realtime_factor", "compute_us", "compute_s")


def flown(mission: Path, out: Path, *arguments: str) -> dict[str, Any]:
    assert run([str(mission), "--json", "--out", str(out), *arguments]) == 0
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return summary


@pytest.mark.parametrize("mission", sorted(MISSIONS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_mission_checks_and_completes_without_collision(
    mission: Path, tmp_path: Path
) -> None:
    assert main(["check", str(mission)]) == 0
    changes = [PAPER, ONE_LAP] * mission.stem.startswith("paper") + [FREE_PORT] * (
        mission.stem == "external"
    )
    summary = flown(mission, tmp_path, *changes)
    assert summary["outcome"] == "completed"
    assert summary["collisions"] == {"agent_agent": 0, "agent_obstacle": 0}
    assert summary["targets"]["found"] == summary["targets"]["total"]


@pytest.mark.campaign
@pytest.mark.parametrize("mission", sorted(MISSIONS.glob("paper_*.yaml")), ids=lambda p: p.stem)
def test_the_flights_of_the_paper_complete_all_their_laps(mission: Path, tmp_path: Path) -> None:
    summary = flown(mission, tmp_path, PAPER)
    assert summary["outcome"] == "completed"
    assert summary["position_rmse_m"] < 0.1


@pytest.mark.parametrize("seed", range(5))
def test_drifting_drones_that_swap_places_stay_apart(
    seed: int, missions: Path, tmp_path: Path
) -> None:
    summary = flown(missions / "first_flight.yaml", tmp_path, "--seed", str(seed))
    assert summary["min_separation_m"] >= 0.2
    assert summary["position_rmse_m"] > 0.01  # they do drift


def test_the_same_seed_gives_the_same_flight(missions: Path, tmp_path: Path) -> None:
    first = flown(missions / "first_flight.yaml", tmp_path / "a")
    second = flown(missions / "first_flight.yaml", tmp_path / "b")
    for key in WALL:
        first.pop(key)
        second.pop(key)
    assert first == second
    with (
        np.load(tmp_path / "a" / "trajectory.npz") as a,
        np.load(tmp_path / "b" / "trajectory.npz") as b,
    ):
        assert all(
            np.array_equal(a[name], b[name], equal_nan=a[name].dtype.kind == "f") for name in a
        )


def test_another_seed_gives_another_flight(missions: Path, tmp_path: Path) -> None:
    first = flown(missions / "first_flight.yaml", tmp_path / "a", "--seed", "1")
    second = flown(missions / "first_flight.yaml", tmp_path / "b", "--seed", "2")
    assert first["path_length_m"] != second["path_length_m"]


def test_from_python_paths_may_be_text(missions: Path, tmp_path: Path) -> None:
    registry = Registry()
    mission = load(str(missions / "first_flight.yaml"), registry)
    summary = fly(mission, registry, folder=str(tmp_path))
    assert summary["outcome"] == "completed"
    assert (tmp_path / "summary.json").exists()
