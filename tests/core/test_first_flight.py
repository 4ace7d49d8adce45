"""The flight of the first mission: drones drift, keep their heights, and stay apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import AgentPhase, Registry, fly, load

MISSION = Path(__file__).parents[2] / "missions" / "first_flight.yaml"


def flown(out: Path, *settings: str) -> dict[str, Any]:
    """Fly the mission, record it in `out`, and return its summary."""
    registry = Registry()
    return fly(load(MISSION, registry, settings), registry, folder=out)


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The record and the summary of a flight."""
    out = tmp_path_factory.mktemp("first") / "out"
    return out, flown(out)


@pytest.mark.extended
def test_drifting_drones_swap_safely_and_vary_with_the_seed(
    first: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    summary = flown(tmp_path, "seed=1")
    assert summary["min_separation_m"] >= 0.2
    assert summary["position_rmse_m"] > 0.01  # they do drift
    assert summary["path_length_m"] != first[1]["path_length_m"]


def test_agents_keep_their_height_after_the_takeoff(first: tuple[Path, dict[str, Any]]) -> None:
    with np.load(first[0] / "trajectory.npz") as flight:
        height, goal = flight["truth_position"][:, :, 2], flight["goal_position"][:, :, 2]
        steered = (flight["phase"] == AgentPhase.FLYING) & (flight["time"] < 10)[:, None]
    assert steered.any(axis=0).all()
    np.testing.assert_array_equal(goal[steered], 0.8)  # of the takeoff, and then of the crossing
    assert abs(height - goal)[steered].max() < 0.15
