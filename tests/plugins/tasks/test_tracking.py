"""How precisely drones fly trajectories in their own time, and what the check expects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from star_core import Registry, Tick, fly, hookimpl, load
from star_verbs.follow.files import read_trajectory
from star_verbs.follow.tracking_error import tracking_error
from star_yaml.check_file import check_file
from tests.plugins.mission_files import write_mission
from tests.plugins.tasks.trajectories import HEADER, rest_to_rest, row

MISSION = """\
  - takeoff: {height: 1.0}
  - hold: {for: 1.5}
  - follow: {file: path.csv, format: poly7}
  - land: {}
"""


def zigzag() -> str:
    """Rest to rest by 0.8 m in 1.6 s, to and fro along x and then along y: 0.94 m/s, 1.8 m/s²."""
    ways = [rest_to_rest(0.0, 0.8, 1.6), rest_to_rest(0.8, -0.8, 1.6)]
    lines = [HEADER, *(row(1.6, way) for way in ways), *(row(1.6, y=way) for way in ways)]
    return "\n".join(lines) + "\n"


class Track:
    """True distances from where the trajectory leads, each tick while it is flown, m."""

    def __init__(self) -> None:
        self.error: list[float] = []
        self.followed: list[bool] = []
        self.ticks: list[Tick] = []

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self.ticks.append(tick)
        if tick.truth is not None and np.linalg.norm(tick.goals.velocity[0]) > 0:
            self.error.append(float(np.linalg.norm(tick.truth.position - tick.goals.position)))
            self.followed.append(bool(tick.sent.followed()[0]))

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(np.square(self.error))))


def written(folder: Path, steps: str = MISSION) -> Path:
    (folder / "path.csv").write_text(zigzag())
    return write_mission(
        folder,
        steps,
        limits="{speed: 1.6, acceleration: 4.0}",
        swarm="{cf1: {start: [0, 0, 0]}}",
        transport="{use: sim, noise: false}",
    )


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    return written(tmp_path)


def flown(mission: Path, *changes: str) -> Track:
    track = Track()
    registry = Registry(track)
    summary = fly(load(mission, registry, changes), registry)
    assert summary["outcome"] == "completed", summary["reason"]
    return track


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Track:
    """The flight of the mission as it is."""
    return flown(written(tmp_path_factory.mktemp("flight")))


@pytest.mark.parametrize(
    "changes",
    [
        (),
        ("transport.controller=mellinger",),
        ("transport.profile=ideal", "transport.controller=ideal"),
        ("planner=visibility",),
    ],
)
def test_trajectories_are_flown_in_their_own_time(
    mission: Path, flight: Track, changes: Sequence[str]
) -> None:
    track = flown(mission, *changes) if changes else flight
    assert len(track.error) > 80
    assert track.rms < 0.06
    assert max(track.error) < 0.15
    assert np.mean(track.followed) > 0.9


def test_the_expected_error_is_that_of_the_simulator(mission: Path, flight: Track) -> None:
    path = read_trajectory(mission.with_name("path.csv"), "path.csv", "poly7")
    expected = tracking_error(path, 1.0, 0.05, on_board=False)
    assert expected.rms == pytest.approx(flight.rms, abs=0.015)
    assert expected.most == pytest.approx(max(flight.error), abs=0.04)


def test_the_check_reports_the_error_to_expect(mission: Path) -> None:
    text, warnings = check_file(mission, Registry())
    expected = "can be flown, with 1 agent; path.csv followed within 0.03 m RMS, besides drift"
    assert text.endswith(expected)
    assert not warnings


def test_the_check_warns_of_imprecise_trajectories(tmp_path: Path) -> None:
    path = written(tmp_path, MISSION.replace("format: poly7}", "format: poly7, on_board: true}"))
    (warning,) = load(path, Registry()).warnings
    assert "flight.yaml:13:20: warning: path.csv: drones are expected to be 0.2" in warning
    assert warning.endswith("[imprecise-trajectory]")


def test_goals_along_trajectories_have_their_derivatives(flight: Track) -> None:
    goals = [tick.goals for tick in flight.ticks]
    moving = [(g.velocity[0], g.acceleration[0]) for g in goals if g.acceleration is not None]
    velocity, acceleration = (np.array(column) for column in zip(*moving, strict=True))
    difference = (velocity[2:] - velocity[:-2]) / 0.1
    assert len(moving) > 80
    assert abs(difference - acceleration[1:-1]).max() < 1.0  # between pieces its slope jumps
    others = [tick for tick in flight.ticks if tick.goals.acceleration is None]
    assert all(tick.sent.position is None for tick in others)
