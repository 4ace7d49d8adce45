"""The localizer ``mocap``, on the simulated positioning system."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from star_core import (
    Agent,
    Array,
    Estimate,
    InputError,
    Localizer,
    PoseFixes,
    Registry,
    Supervisor,
    Tick,
    fly,
    hookimpl,
    load,
)
from star_core.testing import scene
from star_core.toolkit import fill_defaults
from star_mocap.odometry import expected_std
from tests.plugins.localizers.conftest import fixes, report

MISSION = """\
star: 1
name: rows
world: hall.yaml
swarm:
{swarm}
transport: {{use: sim, positioning: {{{positioning}}}}}
localizer: {{use: mocap, max_pose_age: 10}}
planner: straight
avoider: none
mission:
  - takeoff: {{height: 0.8}}
  - goto: {{by: [1.5, 0, 0]}}
  - goto: {{by: [-1.0, 0.5, 0]}}
  - land: {{}}
"""
WORLD = "star: 1\nname: hall\nfence: {low: [-4, -1, 0], high: [4, 21, 3]}\n"
AGENTS = 10


class Errors:
    """Keeps the errors and covariances of positions while all drones are in the air."""

    def __init__(self) -> None:
        self.error: list[Array] = []
        self.covariance: list[Array] = []

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        assert tick.truth is not None
        if (tick.truth.position[:, 2] > 0.2).all():
            self.error.append(tick.estimate.position - tick.truth.position)
            self.covariance.append(tick.estimate.covariance)

    def nees(self) -> float:
        """Return the mean normalized estimation error squared, over its expected value."""
        error, covariance = np.array(self.error), np.array(self.covariance)
        scaled = np.linalg.solve(covariance, error[..., None])[..., 0]
        return float(np.vecdot(error, scaled).mean() / 3)

    def std(self) -> Array:
        """Return the (T, N) standard deviations along x, m."""
        return np.sqrt(np.array(self.covariance)[..., 0, 0])


def written(folder: Path, positioning: str) -> Path:
    """Write a mission, and return its path."""
    swarm = "\n".join(f"  cf{i}: {{start: [0, {2 * i}, 0]}}" for i in range(AGENTS))
    (folder / "hall.yaml").write_text(WORLD)
    path = folder / "rows.yaml"
    path.write_text(MISSION.format(swarm=swarm, positioning=positioning))
    return path


@cache
def flown(positioning: str) -> Errors:
    errors = Errors()
    registry = Registry(errors)
    with TemporaryDirectory() as folder:
        mission = load(written(Path(folder), positioning), registry)
        summary = fly(mission, registry)
    assert summary["outcome"] == "completed", summary["reason"]
    return errors


@pytest.mark.parametrize(
    ("positioning", "widest"),
    [
        ("std: 0.03", 0.035),
        ("std: 0.03, correlation_time: 0, rate: 10, latency: 0.1", 0.025),
        ("std: 0.002, rate: 50, latency: 0.05, yaw_std_deg: null", 0.01),
        ("std: 0.03, correlation_time: 5, dropout_rate: 0.1, dropout_time: 3", 0.2),
    ],
)
def test_covariances_are_honest_and_bounded(positioning: str, widest: float) -> None:
    errors = flown(positioning)
    assert 0.7 <= errors.nees() <= 1.5
    assert errors.std().max() < widest


def localizer(**options: Any) -> Localizer:
    offer = Registry().find("localizer", "mocap").offer
    room = replace(scene(1), agents=(Agent("cf1", (1.0, 2.0, 0.8)),))
    plugin: Localizer = offer.make(room, **fill_defaults(options, offer.options))
    return plugin


def located(plugin: Localizer, measured: Iterator[PoseFixes]) -> Estimate:
    """Return the last estimate of an agent that flies along its x at 0.5 m/s, with fixes."""
    velocity = np.array([[0.5, 0.0, 0.0]])
    for tick, some in enumerate(measured):
        time = tick / 20
        now = report([[0.5 * time, 0, 0.8]], time=time, velocity=velocity, fixes=some)
        estimate = plugin.locate(now)
    return estimate


def test_late_fixes_count_for_the_time_at_which_they_were_taken() -> None:
    late = (
        fixes(max(0.0, k / 20 - 0.4), [[1 + max(0.0, k / 40 - 0.2), 2, 0.8]]) for k in range(200)
    )
    estimate = located(localizer(), late)
    assert estimate.position[0] == pytest.approx([1 + 0.5 * 199 / 20, 2, 0.8], abs=0.01)


def test_a_body_that_is_frozen_in_flight_is_lost() -> None:
    plugin, velocity = localizer(), np.array([[0.5, 0.0, 0.0]])
    flying = np.array([int(Supervisor.FLYING)])
    valid, error = [], []
    for tick in range(140):
        time = tick / 20
        measured = 2.0 if 2.0 <= time < 5.0 else time
        now = report(
            [[0.5 * time, 0, 0.8]],
            time=time,
            velocity=velocity,
            state=flying,
            fixes=fixes(time, [[1 + 0.5 * measured, 2, 0.8]]),
        )
        estimate = plugin.locate(now)
        valid.append(bool(estimate.valid[0]))
        error.append(abs(estimate.position[0, 0] - 1 - 0.5 * time))
    assert max(error) < 0.01
    assert [valid[20 * second + 10] for second in range(2, 7)] == [True, False, False, True, True]


@pytest.mark.parametrize("state", [0, int(Supervisor.FLYING)])
def test_a_body_that_stays_where_its_agent_does_is_located(state: int) -> None:
    plugin = localizer()
    for tick in range(100):
        measured = fixes(tick / 20, [[1.0, 2.0, 0.8]])
        now = report([[0, 0, 0.8]], time=tick / 20, state=np.array([state]), fixes=measured)
        estimate = plugin.locate(now)
    assert estimate.valid.all()


def test_a_wrong_start_and_heading_are_corrected() -> None:
    measured = (fixes(k / 20, [[1.1, 1.9 + k / 40, 0.8]], yaw=np.pi / 2) for k in range(200))
    estimate = located(localizer(), measured)
    assert estimate.position[0] == pytest.approx([1.1, 1.9 + 199 / 40, 0.8], abs=0.02)
    assert estimate.yaw == pytest.approx([np.pi / 2], abs=0.02)
    frames = estimate.map_from_odom.apply(np.array([[0.5 * 199 / 20, 0, 0.8]]))
    assert frames == pytest.approx(estimate.position)


def test_without_fixes_the_covariance_grows() -> None:
    plugin = localizer()
    located(plugin, (fixes(k / 20, [[1 + k / 40, 2, 0.8]]) for k in range(20)))
    std = [
        np.sqrt(located(plugin, iter([PoseFixes.none()] * ticks)).covariance[0, 0, 0])
        for ticks in (25, 40, 80)
    ]
    assert std[0] < 0.03
    assert std[0] < std[1] < std[2]
    assert std[2] > 0.05


def test_fixes_that_are_not_finite_are_ignored() -> None:
    measured = (fixes(k / 20, [[np.nan if k % 2 else 1 + k / 40, 2, 0.8]]) for k in range(40))
    estimate = located(localizer(), measured)
    assert estimate.position[0] == pytest.approx([1 + 39 / 40, 2, 0.8], abs=0.02)


def test_a_transport_without_positions_is_an_error(tmp_path: Path) -> None:
    path = written(tmp_path, "")
    path.write_text(path.read_text().replace("{use: sim, positioning: {}}", "sim"))
    with pytest.raises(InputError, match=r"rows.yaml:16:12: .*\[no-positioning\]"):
        load(path, Registry())


@pytest.mark.extended
@pytest.mark.parametrize(
    ("positioning", "gap"),
    [("std: 0.03", 0.07), ("std: 0.01, dropout_rate: 0.2, dropout_time: 3", 3.07)],
)
def test_the_expected_deviation_is_that_of_flights(positioning: str, gap: float) -> None:
    errors = flown(positioning)
    measured = errors.std()[40:].max()
    around = replace(scene(1), measurement_errors=(0.03 if "0.03" in positioning else 0.01, gap))
    time = np.arange(0.0, 5.0, 0.5)
    path = np.zeros((len(time), 1, 3))
    path[:, 0, 0] = 0.5 * time
    expected = expected_std(around, time, path, np.zeros((len(time), 1))).max()
    assert 0.6 * expected < measured < 1.2 * expected
