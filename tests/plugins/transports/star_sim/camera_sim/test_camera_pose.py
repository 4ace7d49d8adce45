"""Where the camera is when."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from star_core import Camera
from star_core.world.quaternions import moved
from star_sim.camera_sim.camera_pose import mounting, optics, poses
from tests.plugins.transports.star_sim.camera_sim.conftest import take

CAMERA = Camera()


def test_a_camera_at_rest_has_one_pose() -> None:
    shot = take((1.0, 2.0, 0.5), (0.1, 0.2, 0.3))
    track = poses(shot.packed(), mounting(CAMERA), optics(CAMERA), 3)
    body = Rotation.from_quat(shot.attitude)
    expected = (body * Rotation.from_quat(CAMERA.rotation)).as_matrix()
    assert track.shape == (244, 3, 12)
    assert np.ptp(track, axis=(0, 1)) == pytest.approx(0.0, abs=1e-12)
    assert track[0, 0, :9].reshape(3, 3) == pytest.approx(expected)
    assert track[0, 0, 9:] == pytest.approx(shot.position + body.apply(CAMERA.position))


def test_a_level_camera_has_its_pitch() -> None:
    track = poses(take().packed(), mounting(CAMERA), optics(CAMERA), 1)
    ahead = track[0, 0, :9].reshape(3, 3) @ [0, 0, 1]
    assert ahead == pytest.approx([np.sqrt(0.5), 0, -np.sqrt(0.5)])
    assert moved(CAMERA.rotation, (0, 0, 1)) == pytest.approx(ahead)


def test_rows_follow_each_other_over_the_read_out() -> None:
    track = poses(take(velocity=(1.0, 0, 0)).packed(), mounting(CAMERA), optics(CAMERA), 1)
    x = track[:, 0, 9] - CAMERA.position[0]
    assert x[0] == pytest.approx(-0.015)
    assert x[-1] == pytest.approx(0.015)
    assert np.diff(x) == pytest.approx(0.03 / 243)


def test_slices_are_the_middles_of_thirds_of_the_exposure() -> None:
    camera = dataclasses.replace(CAMERA, readout=0.0, exposure=0.03)
    track = poses(take(velocity=(1.0, 0, 0)).packed(), mounting(camera), optics(camera), 3)
    assert track[100, :, 9] - camera.position[0] == pytest.approx([-0.01, 0.0, 0.01])


def test_a_body_that_turns_carries_its_camera_round() -> None:
    camera = dataclasses.replace(CAMERA, readout=0.1, exposure=0.0)
    rates = np.array([1.0, -2.0, 3.0])
    shot = take(turn=(0.3, -0.2, 1.0), rates=rates)
    track = poses(shot.packed(), mounting(camera), optics(camera), 1)
    body = Rotation.from_quat(shot.attitude) * Rotation.from_rotvec(0.05 * rates)
    matrix = (body * Rotation.from_quat(camera.rotation)).as_matrix()
    assert track[-1, 0, :9].reshape(3, 3) == pytest.approx(matrix)
    assert track[-1, 0, 9:] == pytest.approx(shot.position + body.apply(camera.position))
