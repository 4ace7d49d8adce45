"""How the truth differs from what is believed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from star_core import Camera, Tag
from star_core.world.quaternions import turned
from star_sim.camera_sim.ground_truth import real_camera, real_tags

WALL = turned(math.pi / 2, 0.0, 0.7)
PAIR = (
    Tag(0, 0.168, (1.0, 1.0, 0.0), turned(0, 0, 0.4), "corner"),
    Tag(1, 0.168, (1.2, 1.1, 0.0), turned(0, 0, 0.4), "corner"),
)
HUNG = Tag(2, 0.168, (0.0, 2.0, 0.5), WALL, "wall")


def test_tags_of_one_sheet_move_together() -> None:
    one, two = real_tags(PAIR, np.random.default_rng(0), position=0.05, turn=0.1)
    before, after = (np.subtract(b.position, a.position) for a, b in (PAIR, (one, two)))
    turn = Rotation.from_quat(one.rotation) * Rotation.from_quat(PAIR[0].rotation).inv()
    assert after == pytest.approx(turn.apply(before))
    assert two.rotation == pytest.approx(one.rotation)
    assert one.position != pytest.approx(PAIR[0].position, abs=1e-3)
    assert (one.id, one.size, one.of) == (0, 0.168, "corner")


def test_a_sheet_stays_on_its_surface() -> None:
    normal = Rotation.from_quat(WALL).apply([0, 0, 1])
    rng = np.random.default_rng(0)
    for floor, wall in (real_tags((PAIR[0], HUNG), rng, position=0.1, turn=0.2) for _ in range(9)):
        assert floor.position[2] == pytest.approx(0.0)
        assert Rotation.from_quat(floor.rotation).apply([0, 0, 1]) == pytest.approx([0, 0, 1])
        assert normal @ np.subtract(wall.position, HUNG.position) == pytest.approx(0.0)
        assert Rotation.from_quat(wall.rotation).apply([0, 0, 1]) == pytest.approx(normal)


def test_sheets_err_by_the_deviations_given() -> None:
    tags = [Tag(i, 0.1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), f"{i}") for i in range(500)]
    real = real_tags(tags, np.random.default_rng(0), position=0.005, turn=0.01)
    angles = Rotation.from_quat([tag.rotation for tag in real]).as_rotvec()[:, 2]
    assert np.std([tag.position[:2] for tag in real]) == pytest.approx(0.005, rel=0.1)
    assert angles.std() == pytest.approx(0.01, rel=0.1)


def test_without_deviation_the_truth_is_what_is_believed() -> None:
    rng = np.random.default_rng(0)
    for real, believed in zip(
        real_tags((*PAIR, HUNG), rng, position=0.0, turn=0.0), (*PAIR, HUNG), strict=True
    ):
        assert real.position == pytest.approx(believed.position)
        assert real.rotation == pytest.approx(believed.rotation)
    camera = real_camera(Camera(), rng, position=0.0, turn=0.0)
    assert camera.rotation == pytest.approx(Camera().rotation)
    assert camera.position == pytest.approx(Camera().position)


@given(
    st.floats(-1.5, 1.5),
    st.sampled_from([0.0, math.pi / 4, math.pi / 2]),
    st.floats(-3.0, 3.0),
    st.integers(0, 99),
)
def test_a_camera_is_turned_by_as_much_as_was_drawn_however_it_looks(
    roll: float, pitch: float, yaw: float, seed: int
) -> None:
    camera = Camera(roll=roll, pitch=pitch, yaw=yaw)
    real = real_camera(camera, np.random.default_rng(seed), position=0.01, turn=0.02)
    drawn = np.random.default_rng(seed).standard_normal((2, 3))
    change = Rotation.from_quat(camera.rotation).inv() * Rotation.from_quat(real.rotation)
    assert change.magnitude() == pytest.approx(0.02 * np.linalg.norm(drawn[1]), rel=1e-3)
    assert np.subtract(real.position, camera.position) == pytest.approx(0.01 * drawn[0])
    assert real.matrix == camera.matrix
