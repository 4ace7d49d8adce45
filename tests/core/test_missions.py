"""Every mission in the repository flies, and two flights with the same seed are the same."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import star_sim
from star_core import AgentPhase, Registry, fly, load
from star_core.commands.main import main, run
from star_core.toolkit import fill_defaults

pytestmark = pytest.mark.shipped_world

MISSIONS = Path(__file__).parents[2] / "missions"
GEOMETRIC = "transport.camera.mode=geometric"  # not images, which three_eyes has
ONE_LAP = ("mission.1.follow.laps=1", "mission.1.follow.speed=0.45")
IN_PROCESS = "localizer.processes=0"  # a process takes seconds to start; results are the same
PAPER = (GEOMETRIC, IN_PROCESS, *ONE_LAP)
SETTINGS = {  # to shorten long flights, and to fly `external` beside other tests
    "external": ("mission.1.external.port=0",),
    "paper_box": PAPER,
    "paper_circle": PAPER,
    "paper_figure8": PAPER,
    "paths": ("mission.2.parallel.1.repeat.times=1",),
    "relief": (
        "mission.1.repeat.times=1",
        "transport.endurance=100",
        "transport.swap_time=15",
    ),
    "search": ("mission.1.search.speed=0.45", IN_PROCESS),
    "three_eyes": ("mission.1.follow.until={elapsed: 4}", IN_PROCESS),
}


def flown(
    mission: Path, out: Path, *arguments: str, settings: Sequence[str] = ()
) -> dict[str, Any]:
    """Fly a mission, record it in `out`, and return its summary."""
    run([str(mission), "--json", "--out", str(out), *arguments, *(f"--set={s}" for s in settings)])
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    assert (summary["outcome"], summary["reason"]) == ("completed", "")
    return summary


@pytest.mark.parametrize("mission", sorted(MISSIONS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_mission_checks_and_completes_without_collision(
    mission: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(mission)]) == 0
    assert not capsys.readouterr().err  # no warning
    summary = flown(mission, tmp_path, settings=SETTINGS.get(mission.stem, ()))
    assert summary["collisions"] == {"agent_agent": 0, "agent_obstacle": 0}
    assert summary["targets"]["found"] == summary["targets"]["total"]


def test_by_default_the_world_is_that_of_a_careful_lab() -> None:
    options = fill_defaults({}, star_sim.OPTIONS)
    assert (options["profile"], options["controller"]) == ("realistic", "pid")


@pytest.mark.campaign
@pytest.mark.parametrize("mission", sorted(MISSIONS.glob("paper_*.yaml")), ids=lambda p: p.stem)
def test_the_flights_of_the_paper_complete_all_their_laps(mission: Path, tmp_path: Path) -> None:
    assert flown(mission, tmp_path)["position_rmse_m"] < 0.05


@pytest.mark.campaign
@pytest.mark.parametrize("name", ["relief", "search", "three_eyes"])
def test_long_missions_complete_as_they_are(name: str, missions: Path, tmp_path: Path) -> None:
    assert flown(missions / f"{name}.yaml", tmp_path)["collisions"]["agent_agent"] == 0


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The record and the summary of a flight of first_flight.yaml."""
    out = tmp_path_factory.mktemp("first") / "out"
    return out, flown(MISSIONS / "first_flight.yaml", out)


def test_drifting_drones_that_swap_positions_stay_apart_and_fly_differently_with_another_seed(
    first: tuple[Path, dict[str, Any]], missions: Path, tmp_path: Path
) -> None:
    summary = flown(missions / "first_flight.yaml", tmp_path, "--seed", "1")
    assert summary["min_separation_m"] >= 0.2
    assert summary["position_rmse_m"] > 0.01  # they do drift
    assert summary["path_length_m"] != first[1]["path_length_m"]


def test_the_same_seed_gives_the_same_flight(
    first: tuple[Path, dict[str, Any]], missions: Path, tmp_path: Path
) -> None:
    out, summary = first
    again = flown(missions / "first_flight.yaml", tmp_path)
    assert again == summary
    with np.load(out / "trajectory.npz") as a, np.load(tmp_path / "trajectory.npz") as b:
        assert all(
            np.array_equal(a[name], b[name], equal_nan=a[name].dtype.kind == "f") for name in a
        )


def test_agents_keep_their_height_after_the_takeoff(first: tuple[Path, dict[str, Any]]) -> None:
    with np.load(first[0] / "trajectory.npz") as flight:
        height, goal = flight["truth_position"][:, :, 2], flight["goal_position"][:, :, 2]
        steered = (flight["phase"] == AgentPhase.FLYING) & (flight["time"] < 10)[:, None]
    assert steered.any(axis=0).all()
    np.testing.assert_array_equal(goal[steered], 0.8)  # of the takeoff, and then of the crossing
    assert abs(height - goal)[steered].max() < 0.15


def test_from_python_paths_may_be_text(missions: Path, tmp_path: Path) -> None:
    registry = Registry()
    mission = load(
        str(missions / "first_flight.yaml"), registry, ["mission=[takeoff: {}, land: {}]"]
    )
    summary = fly(mission, registry, folder=str(tmp_path))
    assert summary["outcome"] == "completed"
    assert (tmp_path / "summary.json").exists()
