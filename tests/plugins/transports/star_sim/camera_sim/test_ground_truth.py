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
from star_sim.camera_sim.options import CameraOptions, camera_options


def survey(position: float, turn: float, height: float = 0.0, tilt: float = 0.0) -> CameraOptions:
    """Return standard deviations of sheets, m and rad."""
    turns = {"survey_yaw_std_deg": math.degrees(turn), "survey_tilt_std_deg": math.degrees(tilt)}
    return camera_options(survey_std=position, survey_height_std=height, **turns)


def mounted(position: float, turn: float, **errors: float) -> CameraOptions:
    """Return standard deviations of a camera's mounting, m and rad, and others."""
    turns = {"mounting_std_deg": math.degrees(turn)}
    return camera_options(mounting_position_std=position, **turns, **errors)


WALL = turned(math.pi / 2, 0.0, 0.7)
PAIR = (
    Tag(0, 0.168, (1.0, 1.0, 0.0), turned(0, 0, 0.4), "corner"),
    Tag(1, 0.168, (1.2, 1.1, 0.0), turned(0, 0, 0.4), "corner"),
)
HUNG = Tag(2, 0.168, (0.0, 2.0, 0.5), WALL, "wall")


def test_tags_of_one_sheet_move_together() -> None:
    first, second = real_tags(PAIR, [0], survey(0.05, 0.1, 0.05, 0.1))
    before, after = (np.subtract(b.position, a.position) for a, b in (PAIR, (first, second)))
    turn = Rotation.from_quat(first.rotation) * Rotation.from_quat(PAIR[0].rotation).inv()
    assert after == pytest.approx(turn.apply(before))
    assert second.rotation == pytest.approx(first.rotation)
    assert first.position != pytest.approx(PAIR[0].position, abs=1e-3)
    assert (first.id, first.size, first.of) == (0, 0.168, "corner")


def test_a_sheet_stays_on_its_surface() -> None:
    normal = Rotation.from_quat(WALL).apply([0, 0, 1])
    error = survey(0.1, 0.2)
    for floor, wall in (real_tags((PAIR[0], HUNG), [seed], error) for seed in range(9)):
        assert floor.position[2] == pytest.approx(0.0)
        assert Rotation.from_quat(floor.rotation).apply([0, 0, 1]) == pytest.approx([0, 0, 1])
        assert normal @ np.subtract(wall.position, HUNG.position) == pytest.approx(0.0)
        assert Rotation.from_quat(wall.rotation).apply([0, 0, 1]) == pytest.approx(normal)


def test_sheets_err_by_the_deviations_given() -> None:
    tags = [Tag(i, 0.1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), f"{i}") for i in range(500)]
    real = real_tags(tags, [0], survey(0.005, 0.01, 0.02, 0.03))
    angles = Rotation.from_quat([tag.rotation for tag in real]).as_rotvec()
    positions = np.array([tag.position for tag in real])
    assert positions.std(axis=0) == pytest.approx([0.005, 0.005, 0.02], rel=0.1)
    assert angles.std(axis=0) == pytest.approx([0.03, 0.03, 0.01], rel=0.1)


def test_errors_out_of_the_plane_leave_those_in_it() -> None:
    flat, tilted = (real_tags((HUNG,), [3], survey(0.1, 0.0, *more))[0] for more in ((), (0.1,)))
    along = Rotation.from_quat(WALL).inv().apply(np.subtract(tilted.position, flat.position))
    assert along[:2] == pytest.approx([0.0, 0.0])
    assert abs(along[2]) > 0.01


def test_lenses_err_by_the_deviations_given() -> None:
    error = mounted(0.0, 0.0, focal_length_std=0.01, image_center_std=2.0)
    matrices = np.array(
        [real_camera(Camera(), np.random.default_rng(i), error).matrix for i in range(500)]
    )
    fx, fy, cx, cy = matrices.T
    assert fx / fy == pytest.approx(Camera().matrix[0] / Camera().matrix[1])
    assert fx.std() / fx.mean() == pytest.approx(0.01, rel=0.1)
    assert [cx.std(), cy.std()] == pytest.approx([2.0, 2.0], rel=0.1)


def test_without_deviation_the_truth_is_what_is_believed() -> None:
    for real, believed in zip(
        real_tags((*PAIR, HUNG), [0], survey(0.0, 0.0)), (*PAIR, HUNG), strict=True
    ):
        assert real.position == pytest.approx(believed.position)
        assert real.rotation == pytest.approx(believed.rotation)
    camera = real_camera(Camera(), np.random.default_rng(0), mounted(0.0, 0.0))
    assert camera.rotation == pytest.approx(Camera().rotation)
    assert camera.position == pytest.approx(Camera().position)


@given(
    st.floats(-1.5, 1.5),
    st.sampled_from([0.0, math.pi / 4, math.pi / 2]),
    st.floats(-3.0, 3.0),
    st.integers(0, 99),
)
def test_camera_pose_errors_do_not_depend_on_orientation(
    roll: float, pitch: float, yaw: float, seed: int
) -> None:
    camera = Camera(roll=roll, pitch=pitch, yaw=yaw)
    real = real_camera(camera, np.random.default_rng(seed), mounted(0.01, 0.02))
    drawn = np.random.default_rng(seed).standard_normal((2, 3))
    change = Rotation.from_quat(camera.rotation).inv() * Rotation.from_quat(real.rotation)
    assert change.magnitude() == pytest.approx(0.02 * np.linalg.norm(drawn[1]), rel=1e-3)
    assert np.subtract(real.position, camera.position) == pytest.approx(0.01 * drawn[0])
    assert real.matrix == camera.matrix


def test_a_mounting_errs_about_the_cameras_own_axes() -> None:
    """The same numbers are the same rotation, as seen from the camera, however it is mounted."""

    def error(camera: Camera) -> list[float]:
        real = real_camera(camera, np.random.default_rng(1), mounted(0.0, 0.1))
        nominal, true = (
            Rotation.from_euler("xyz", [mounting.roll, mounting.pitch, mounting.yaw])
            for mounting in (camera, real)
        )
        return list((nominal.inv() * true).as_rotvec())

    ahead = Camera(roll=0.0, pitch=0.0, yaw=0.0)
    down = Camera(roll=0.3, pitch=1.2, yaw=0.0)
    assert error(down) == pytest.approx(error(ahead), abs=1e-12)
    assert np.linalg.norm(error(down)) > 0.05
