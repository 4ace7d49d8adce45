"""The localizer behind the simulator's cameras: what it makes of a whole flight."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import star_sim
from star_core import Agent, Array, Camera, Command, Fence, Order, Scene, Setpoint, World
from star_core.commands.main import main
from star_core.toolkit import fill_defaults
from tests.plugins.localizers.apriltag.conftest import TICK, sheets
from tests.plugins.localizers.apriltag.conftest import localizer as apriltag

RISE, SPEED, TURN = 2.0, 0.28, 0.28  # s, m/s and rad/s
SECONDS = 9.0
SEEDS = range(3)
WORLD = """\
star: 1
name: mat
fence: {low: [-3, -3, 0], high: [3, 3, 3]}
landmarks:
  mat: {tags: [0, 1], at: [0.8, 0.0, 0.0]}
"""
MISSION = """\
star: 1
name: peek
world: mat.yaml
cameras: {eye: {rate: 8}}
swarm: {cf1: {start: [0, 0, 0], camera: eye}}
transport: sim
localizer: apriltag
planner: straight
avoider: none
mission:
  - takeoff: {height: 0.6, speed: 0.5}
  - land: {speed: 0.5}
"""
IN_PROCESS = ("--set", "localizer.processes=0")  # a process takes seconds to start


class Errors(NamedTuple):
    """From the end of take-off on, in every tick.

    Attributes:
        squared: Squared distance from estimate to truth, m².
        surprise: The same over the covariance, a degree of freedom.
    """

    squared: Array
    surprise: Array


@cache
def flight(
    seed: int,
    mode: str = "geometric",
    wrong_ids: float = 0.0,
    tags: int = 2,
    profile: str = "ideal",
) -> Errors:
    """A circle flown by the drone's own estimate."""
    scene = Scene(
        agents=(Agent("cf1", (1.0, 0.0, 0.0), np.pi / 2, camera=Camera()),),
        period=TICK,
        world=World("mat", Fence((-5, -5, 0), (5, 5, 3)), landmarks=tuple(sheets(4))),
        seed=seed,
    )
    simulator = star_sim.make(
        scene,
        **fill_defaults(
            {"profile": profile, "camera": {"mode": mode, "wrong_id_rate": wrong_ids}},
            star_sim.OPTIONS,
        ),
    )
    localizer = apriltag(scene, max_tags_per_landmark=tags)
    simulator.connect()
    row, on = np.zeros(1, np.int64), np.ones(1, np.bool_)
    simulator.command(
        Command(Order.TAKEOFF, row, np.array([[0, 0, 0.8]]), np.zeros(1), np.array([RISE]))
    )
    squared, surprise = [], []
    for tick in range(1, round(SECONDS / TICK) + 1):
        now = tick * TICK
        if now > RISE + 0.5:
            yaw = TURN * (now - RISE - 0.5)  # in its odometry frame
            ahead = SPEED * np.array([[np.cos(yaw), np.sin(yaw), 0.0]])
            simulator.send(Setpoint(ahead, np.array([yaw]), on))
        simulator.wait(now)
        estimate = localizer.locate(simulator.receive())
        truth = simulator.truth()
        assert truth is not None
        if now > RISE + 0.5:
            error = estimate.position[0] - truth.position[0]
            squared.append(error @ error)
            surprise.append(error @ np.linalg.solve(estimate.covariance[0], error) / 3)
    return Errors(np.array(squared), np.array(surprise))


def mse(**options: Any) -> float:
    return float(np.mean([flight(seed, **options).squared for seed in SEEDS]))


def test_tags_take_away_most_of_the_drift() -> None:
    assert mse() < 0.2 * mse(tags=0)
    assert mse() < 0.0035


@pytest.mark.extended
def test_a_tenth_of_wrong_numbers_does_hardly_any_harm() -> None:
    assert mse(wrong_ids=0.1) <= 1.15 * mse() + 1e-4


@pytest.mark.extended
def test_half_of_them_wrong_is_still_better_than_no_tag() -> None:
    assert mse(wrong_ids=0.5) < mse(tags=0)


def test_the_covariance_is_honest() -> None:
    assert 0.05 < np.mean([flight(seed).surprise for seed in SEEDS]) < 2.0


@pytest.mark.extended
def test_realistic_errors_cost_little_and_are_in_the_covariance() -> None:
    assert mse(profile="realistic") < 0.0075
    assert np.mean([flight(seed, profile="realistic").surprise for seed in SEEDS]) < 1.6


@pytest.mark.extended
def test_tags_in_rendered_images_serve_as_well() -> None:
    assert np.mean(flight(0, mode="rendered").squared) < 0.0025


def flown(mission: Path, out: Path, *arguments: str) -> dict[str, Any]:
    assert main(["run", str(mission), "--json", "--out", str(out), *arguments]) == 0
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return summary


@pytest.mark.extended
def test_rendered_flights_are_reproducible_by_seed(tmp_path: Path) -> None:
    (tmp_path / "mat.yaml").write_text(WORLD)
    mission = tmp_path / "peek.yaml"
    mission.write_text(MISSION)
    first = flown(mission, tmp_path / "a")
    assert first == flown(mission, tmp_path / "b", *IN_PROCESS)
    assert first["position_rmse_m"] < 0.05
    other = flown(mission, tmp_path / "c", "--seed", "1", *IN_PROCESS)
    assert first["position_mse_m2"] != other["position_mse_m2"]
