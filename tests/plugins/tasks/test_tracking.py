"""How precisely drones fly trajectories in their own time, and what the check expects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from star_core import Registry, Tick, fly, hookimpl, load
from star_verbs.follow.files import PIECE_COLUMNS, read_trajectory
from star_verbs.follow.tracking_error import tracking_error
from star_yaml.check_file import check_file

WORLD = "star: 1\nname: room\nfence: {low: [-3, -3, 0], high: [3, 3, 3]}\n"
MISSION = """\
star: 1
name: fast
world: room.yaml
limits: {speed: 1.6, acceleration: 4.0}
swarm: {cf1: {start: [0, 0, 0]}}
transport: {use: sim, noise: false}
localizer: flow
planner: straight
avoider: none
mission:
  - takeoff: {height: 1.0}
  - hold: {for: 1.5}
  - follow: {file: path.csv, format: poly7}
  - land: {}
"""


def zigzag() -> str:
    """Rest to rest by 0.8 m in 1.6 s, to and fro along x and then along y: 0.94 m/s, 1.8 m/s²."""
    lines = [",".join(PIECE_COLUMNS)]
    for axis, begin, way in ((0, 0.0, 0.8), (0, 0.8, -0.8), (1, 0.0, 0.8), (1, 0.8, -0.8)):
        axes = np.zeros((4, 8))
        axes[axis, 0] = begin
        for power, factor in ((3, 10), (4, -15), (5, 6)):
            axes[axis, power] = factor * way / 1.6**power
        lines.append(",".join(map(repr, [1.6, *axes.ravel().tolist()])))
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


def written(folder: Path) -> Path:
    for name, text in (("room", WORLD), ("mission", MISSION)):
        (folder / f"{name}.yaml").write_text(text)
    (folder / "path.csv").write_text(zigzag())
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return written(tmp_path)


def flown(folder: Path, *changes: str) -> Track:
    track = Track()
    registry = Registry(track)
    summary = fly(load(folder / "mission.yaml", registry, changes), registry)
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
    folder: Path, flight: Track, changes: Sequence[str]
) -> None:
    track = flown(folder, *changes) if changes else flight
    assert len(track.error) > 80
    assert track.rms < 0.06
    assert max(track.error) < 0.15
    assert np.mean(track.followed) > 0.9


def test_the_expected_error_is_that_of_the_simulator(folder: Path, flight: Track) -> None:
    path = read_trajectory(folder / "path.csv", "path.csv", "poly7")
    expected = tracking_error(path, 1.0, 0.05, on_board=False)
    assert expected.rms == pytest.approx(flight.rms, abs=0.015)
    assert expected.most == pytest.approx(max(flight.error), abs=0.04)


def test_the_check_reports_the_error_to_expect(folder: Path) -> None:
    text, warnings = check_file(folder / "mission.yaml", Registry())
    expected = "can be flown, with 1 agent; path.csv followed within 0.03 m RMS, besides drift"
    assert text.endswith(expected)
    assert not warnings


def test_the_check_warns_of_imprecise_trajectories(folder: Path) -> None:
    registry = Registry()
    assert load(folder / "mission.yaml", registry).warnings == ()
    path = folder / "mission.yaml"
    path.write_text(MISSION.replace("format: poly7}", "format: poly7, on_board: true}"))
    (warning,) = load(path, registry).warnings
    assert "mission.yaml:13:20: warning: path.csv: drones are expected to be 0.2" in warning
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
