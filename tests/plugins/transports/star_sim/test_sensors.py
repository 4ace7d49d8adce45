"""How the Flow deck's sensors err."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import star_sim
from star_core import Array
from star_core.toolkit import compiled
from star_sim import sensors
from star_sim.drone import Drones, standing

flow = compiled(sensors.flow.py_func)  # type: ignore[attr-defined]  # for Python to call
FLAT = np.zeros((sensors.TEXTURE_POINTS, sensors.TEXTURE_POINTS))
COUNT = 0.8 / sensors.COUNTS  # m/s that one count is at 0.8 m


def shown(
    drones: Drones, *, cycles: int = 1000, texture: Array = FLAT, upright: float = 1.0
) -> Array:
    """What the flow sensor shows, (cycles, 2), at 0.8 m and 0.1 m/s ahead."""
    drones["position"], drones["seen_position"] = [0.001, 0.0, 0.8], [0.0, 0.0, 0.8]
    quiet = np.zeros(4)
    return np.array(
        [flow(drones[0], quiet, texture, (1.0, 0.0), 0.8, upright, 0.0) for _ in range(cycles)]
    )


def lone_drone() -> Drones:
    return standing(np.zeros((1, 3)), np.zeros(1), 1.0)


def test_the_flow_sensor_shows_whole_counts() -> None:
    counts = shown(lone_drone()) / COUNT
    assert np.abs(counts - np.round(counts)).max() < 1e-9
    assert set(np.round(counts[:, 0])) == {0.0, 1.0}


@pytest.mark.parametrize(
    ("options", "ahead"), [({}, 0.1), ({"upright": 0.9}, 0.1), ({"texture": FLAT + 0.2}, 0.12)]
)
def test_fractions_of_counts_tilt_and_texture_are_in_the_mean(
    options: dict[str, Any], ahead: float
) -> None:
    assert shown(lone_drone(), **options).mean(axis=0) == pytest.approx(
        [ahead, 0.0], abs=COUNT / 1000
    )


def test_scale_misalignment_and_bias_show() -> None:
    drones = lone_drone()
    drones["scale"] = 0.1
    drones["misalignment"] = [math.cos(0.3), math.sin(0.3)]
    drones["velocity_bias"] = [0.01, -0.02]
    expected = [0.11 * math.cos(0.3) + 0.01, 0.11 * math.sin(0.3) - 0.02]
    assert shown(drones).mean(axis=0) == pytest.approx(expected, abs=COUNT / 1000)


def test_a_flow_beyond_the_sensors_range_is_cut() -> None:
    drones = lone_drone()
    drones["scale"] = 1000.0
    assert shown(drones, cycles=1)[0, 0] == pytest.approx(sensors.OUTLIER * COUNT)


def test_ranger_reports_millimetres_and_noise_grows_with_height() -> None:
    assert sensors.ranged(0.80049, 0.0) == pytest.approx(0.8)
    assert sensors.ranged(1.0, 1.0) == pytest.approx(1.003, abs=6e-4)
    assert sensors.ranged(4.0, 1.0) == pytest.approx(4.2, abs=5e-3)


@pytest.mark.parametrize("keep", [0.9, np.array([0.5, 0.99, 1.0])], ids=["one", "each its own"])
def test_slowly_changing_errors_are_those_of_a_linear_filter(keep: float | Array) -> None:
    random = np.random.default_rng(1)
    drive, last = random.standard_normal((100, 3)), random.standard_normal(3)
    states = sensors.gauss_markov(drive, keep, last)
    for k, share in enumerate(np.broadcast_to(keep, 3)):
        expected, _ = lfilter([1.0], [1.0, -share], drive[:, k], zi=[share * last[k]])
        assert np.array_equal(states[:, k], expected)


def test_no_two_sources_of_errors_share_a_random_stream() -> None:
    lines = [
        line
        for file in Path(star_sim.__file__).parent.rglob("*.py")
        for line in file.read_text(encoding="utf-8").splitlines()
        if re.match(r"\w*_STREAM\b.* = ", line)
    ]
    numbers = [number for line in lines for number in re.findall(r"\b\d\w+", line.split("#")[0])]
    assert len(numbers) > len(lines)  # some lines have several
    assert len({*numbers}) == len(numbers)
