"""Options that disturb images: each shows, is repeatable, and is off by default."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import Camera, Image
from star_core.testing import scene
from star_sim.camera_sim.cameras import Cameras
from star_sim.camera_sim.options import camera_options
from star_sim.drone import standing

CASES: list[dict[str, Any]] = [
    {"exposure_step": 0.6},
    {"fixed_pattern_std": 6.0},
    {"jpeg_quality": 20},
    {"vibration_std_deg": 1.0},
    {"lamps": 300},
    {"clutter": 300},
]


def taken(count: int = 3, seed: int = 0, **options: Any) -> list[Image]:
    """Return images of a camera that hovers."""
    (agent,) = (made := scene(1)).agents
    where = replace(made, agents=(replace(agent, camera=Camera()),), seed=seed)
    cameras = Cameras(where, camera_options(**options))
    images: list[Image] = []
    for _ in range(count):
        cameras.take(standing(np.array([[0.0, 0.0, 0.8]]), np.zeros(1), 1.0), cameras.next_step)
        images += cameras.arrived(1e9)[0].image
    return images


@pytest.mark.parametrize("options", CASES, ids=lambda changes: next(iter(changes)))
def test_a_disturbance_changes_images_and_repeats(options: dict[str, Any]) -> None:
    usual, disturbed, again = taken(), taken(**options), taken(**options)
    assert np.array_equal(disturbed, again)
    assert np.abs(np.array(usual, float) - np.array(disturbed)).mean() > 0.1
    assert not np.array_equal(disturbed, taken(seed=1, **options))


def test_a_fixed_pattern_stays_and_noise_does_not() -> None:
    first, second = np.array(taken(2, fixed_pattern_std=10.0, pixel_noise_std=0.0), float)
    assert np.abs(first - second).mean() < 0.1


def test_the_exposure_steps_every_ten_images() -> None:
    means = [image.mean() for image in taken(20, exposure_step=0.6)]
    assert np.ptp(means[:10]) < 1
    assert np.ptp(means[10:]) < 1
    assert abs(means[0] - means[10]) > 3


def test_lamps_saturate() -> None:
    assert max(image.max() for image in taken(lamps=300)) == 255
    assert max(image.max() for image in taken()) < 255
