"""Pictures of a chessboard through a lens that is known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from star_core import Array, Camera, Image

FINE = 2  # samples to a pixel, each way
EXACT = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-10)
BLUR, NOISE = 0.7, 4.0  # px and grey values, as the simulator's camera has them
DARK, LIGHT = 40.0, 200.0
SEED = 0


class Studio:
    """Takes pictures of a board of black and white squares."""

    def __init__(
        self, camera: Camera, columns: int = 9, rows: int = 6, square: float = 0.025
    ) -> None:
        self.camera, self.columns, self.rows, self.square = camera, columns, rows, square
        fx, fy, cx, cy = camera.matrix
        self.matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        self.bend = np.array(camera.distortion)
        offset = (np.arange(FINE) + 0.5) / FINE - 0.5
        u = (np.arange(camera.width)[:, None] + offset).ravel()
        v = (np.arange(camera.height)[:, None] + offset).ravel()
        samples = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 1, 2)
        flat = cv2.undistortPoints(samples, self.matrix, self.bend, criteria=EXACT).reshape(-1, 2)
        self.rays = np.column_stack([flat, np.ones(len(flat))])
        row, column = np.indices((rows, columns)).reshape(2, -1)
        self.points = square * np.stack([column, row, 0 * row], axis=1)

    def corners(self, turn: Array, place: Array) -> Array:
        """(K, 2) where the inner corners are in the picture, px."""
        at = cv2.projectPoints(self.points, cv2.Rodrigues(turn)[0], place, self.matrix, self.bend)[
            0
        ]
        return np.asarray(at, np.float64).reshape(-1, 2)

    def pose(self, rng: np.random.Generator, tilt: float = 45.0) -> tuple[Array, Array]:
        """A turn and a place, m, of a board that the picture has the whole of."""
        while True:
            angles = rng.uniform(-tilt, tilt, 3) * (1, 1, 0.7)
            turn = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
            far = rng.uniform(0.16, 0.30)
            middle = far * np.array([rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.4), 1.0])
            place = middle - turn @ self.points.mean(axis=0)
            pixels = self.corners(turn, place)
            size = (self.camera.width, self.camera.height)
            if (pixels > 8).all() and (pixels < np.subtract(size, 8)).all():
                return turn, place

    def picture(self, turn: Array, place: Array, rng: np.random.Generator) -> Image:
        far = (turn[:, 2] @ place) / (self.rays @ turn[:, 2])
        on_board = (self.rays * far[:, None] - place) @ turn
        cell = np.floor(on_board[:, :2] / self.square + 1).astype(int)
        inside = ((cell >= 0) & (cell < (self.columns + 1, self.rows + 1))).all(axis=1) & (far > 0)
        grey = np.where(inside & (cell.sum(axis=1) % 2 == 0), DARK, LIGHT)
        sharp = grey.reshape(self.camera.height, FINE, self.camera.width, FINE).mean(axis=(1, 3))
        noisy = cv2.GaussianBlur(sharp, (0, 0), BLUR) + rng.normal(0, NOISE, sharp.shape)
        return np.asarray(np.clip(np.round(noisy), 0, 255), np.uint8)


@pytest.fixture(scope="session")
def studio() -> Studio:
    return Studio(Camera())


@pytest.fixture(scope="session")
def shots(studio: Studio, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Files of 16 pictures from all sides."""
    return _shots(studio, tmp_path_factory.mktemp("shots"), 16, 45.0)


@pytest.fixture
def take(studio: Studio, tmp_path: Path) -> Callable[[int, float], list[str]]:
    """Takes so many pictures of a board tilted by up to so many degrees."""
    return lambda count, tilt: _shots(studio, tmp_path, count, tilt)


def _shots(studio: Studio, folder: Path, count: int, tilt: float) -> list[str]:
    rng = np.random.default_rng(SEED)
    names = []
    for number in range(count):
        name = str(folder / f"{number:02d}.png")
        assert cv2.imwrite(name, studio.picture(*studio.pose(rng, tilt), rng))
        names.append(name)
    return names
