"""The texture of the floor."""

from __future__ import annotations

import numpy as np
import pytest

from star_sim.camera_sim.floor_texture import GRAY, JOINT, SIDE, TILE, floor
from tests.plugins.transports.star_sim.camera_sim.conftest import ground


def test_a_seed_has_one_floor() -> None:
    assert (floor.__wrapped__(0).texels == ground().texels).all()
    assert (floor(1).texels != ground().texels).any()


def test_each_level_is_the_mean_of_the_one_before() -> None:
    sizes = np.diff([*ground().starts, len(ground().texels)])
    assert list(sizes) == [(SIDE >> level) ** 2 for level in range(11)]
    finest = ground().texels[: SIDE**2].reshape(SIDE, SIDE).astype(float)
    third = ground().texels[ground().starts[3] :][: (SIDE // 8) ** 2].reshape(SIDE // 8, SIDE // 8)
    means = finest.reshape(SIDE // 8, 8, SIDE // 8, 8).mean(axis=(1, 3))
    assert third == pytest.approx(means, abs=1.0)


def test_joints_are_darker_than_tiles() -> None:
    texture = ground().texels[: SIDE**2].reshape(SIDE, SIDE).astype(float)
    joints = np.arange(SIDE) % TILE < JOINT
    assert texture[joints].mean() < texture[~joints][:, ~joints].mean() - 20
    assert texture[~joints][:, ~joints].mean() == pytest.approx(GRAY, abs=5)
