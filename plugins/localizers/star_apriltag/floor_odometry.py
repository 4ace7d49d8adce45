"""Measures how the body moved between two images, by the floor, which stands still."""

from __future__ import annotations

import cmath
from typing import Final, NamedTuple

import cv2
import gtsam
import numpy as np
from numpy.typing import NDArray

from star_apriltag.odometry_track import Motion, Stance, Track
from star_apriltag.vision.body_pose import NEAREST
from star_apriltag.vision.detector import checked
from star_core import Array, CameraModel, Image

COLUMNS, ROWS = 10, 8  # of the points that are followed, over the whole image
COARSE: Final = 16  # px between the points for which it is worked out where they were
WINDOW: Final = 21  # px, edge of the square around a point that is found again
STEPS: Final = 6  # of Lucas and Kanade's, at most; they begin at most a few px off
SETTLED: Final = 0.02  # px
LEAST_TEXTURE: Final = 1e-3  # OpenCV's smaller eigenvalue; a third of what a floor of stains has

LOWEST: Final = 0.2  # m: nearer to the floor it moves too fast
LEAST_DIP: Final = 0.3  # slope of a ray, down over along it: what is farther tells little
LEAST_POINTS: Final = 12
NOWHERE: Final = -1e4  # px: where a pixel comes from that does not show the floor
LONGEST: Final = 1.0  # s between two images

# px, deviation of a point about what all agree on. In simulation a floor of stains has 0.1, or 0.25
# if the last image is 0.4 s old; where there is only the camera's noise it is 0.36 and more.
MOST_SPREAD: Final = 0.3

HUBER: Final = 1.5  # deviations, from which on a point weighs less
ROUNDS: Final = 4

# How far the way may be from what odometry says: else what was followed is not the floor.
OFF: Final = 0.01  # m
OFF_SHARE: Final = 0.3  # of the way
OFF_RATE: Final = 0.05  # m/√s

NO_TURN: Final = np.eye(3)

Places = NDArray[np.complex128]


class Passage(NamedTuple):
    """A way between two images.

    Attributes:
        begin: When the first was taken, s.
        end: When the second was taken, s.
        shift: x + iy in the level body frame at the beginning, m.
    """

    begin: float
    end: float
    shift: complex


class _Shot(NamedTuple):
    image: Image
    time: float
    stance: Stance


class Floor:
    """Follows a lattice of points from one image of a camera to the next.

    What they show is taken to lie on the floor, the map's plane z = 0: with the on-board tilt and
    height each pixel is then a place beside the body. The last image is drawn again as it should
    look from where odometry says that the body is now; by the method of Lucas and Kanade (IJCAI
    1981) the points of that are found in the new image, and the way is what odometry says, plus the
    weighted mean of how far they are off. Points that disagree weigh less, by Huber's rule; the
    turn is the gyro's. A tilt or a mounting that is wrong by an angle e makes the way too long by a
    constant factor, which `odometry_calibration` learns, and lets the body seem to turn about a
    point that lies e (h² + d²) / h beside it, with what is seen at a distance d from a height h.

    Args:
        lens: Of the camera.
    """

    def __init__(self, lens: CameraModel) -> None:
        self._lens = lens
        height, width = lens.shape
        self._size = np.array([width, height])
        self._pixels = _lattice(width, height, COLUMNS, ROWS, WINDOW)
        self._rays = lens.undistort(self._pixels)
        self._shape = height // COARSE, width // COARSE
        self._coarse = _lattice(width, height, self._shape[1], self._shape[0], 0)
        self._coarse_rays = lens.undistort(self._coarse)
        v, u = np.mgrid[:height, :width].astype(np.float32)
        self._between = (  # where each pixel lies among the coarse points
            u * np.float32((self._shape[1] - 1) / (width - 1)),
            v * np.float32((self._shape[0] - 1) / (height - 1)),
        )
        self._turned = lens.mounting.rotation
        self._last: _Shot | None = None

    def look(
        self,
        image: Image,
        time: float,
        track: Track,
        *,
        ground: float,
        yaw_bias: float,
        camera_turn: Array = NO_TURN,
    ) -> Passage | None:
        """Take in an image; return the way since the one before, or None if it does not show.

        Args:
            image: As the lens shows it.
            time: At which it was taken, later than the one before, s.
            track: What odometry says.
            ground: z of its odometry frame in the map, m.
            yaw_bias: What is to be taken from its yaw rate, rad/s.
            camera_turn: (3, 3) by which the camera is turned against its mounting, in its frame.

        Raises:
            ValueError: It is no grey image of the camera's size.
        """
        image = checked(image, self._lens)
        self._turned = self._lens.mounting.rotation @ camera_turn.T
        stance = track.at(time)
        stance = stance._replace(height=stance.height + ground, yaw_rate=stance.yaw_rate - yaw_bias)
        last, self._last = self._last, None
        if not stance.height > LOWEST:
            return None
        self._last = _Shot(image, time, stance)
        if last is None or not 0 < time - last.time <= LONGEST or track.newest < time:
            return None
        motion = track.between(last.time, time, yaw_bias=yaw_bias)
        before, after = self._followed(last, image, stance, motion)
        off = _agreed(before - after, before, stance.height, self._lens.matrix[0, 0])
        most = OFF + OFF_SHARE * motion.length + OFF_RATE * motion.duration**0.5
        if off is None or abs(off) > most:
            return None
        return Passage(last.time, time, motion.shift + off * cmath.rect(1.0, motion.turn))

    def _followed(
        self, last: _Shot, image: Image, stance: Stance, motion: Motion
    ) -> tuple[Places, Places]:
        """Return where points should lie now, by odometry, and where they do, beside the body."""
        coarse = self._floor(self._coarse_rays, self._coarse, stance)
        whence = self._source(last.stance, coarse, motion).T.reshape(2, *self._shape)
        columns, rows = (
            cv2.remap(one, *self._between, cv2.INTER_LINEAR) for one in whence.astype(np.float32)
        )
        drawn = cv2.remap(last.image, columns, rows, cv2.INTER_LINEAR)
        floor = self._floor(self._rays, self._pixels, stance)
        source = self._source(last.stance, floor, motion)
        seen = (source > WINDOW / 2) & (source < self._size - WINDOW / 2)
        chosen = np.flatnonzero(seen.all(axis=1))
        if len(chosen) < LEAST_POINTS:
            return np.zeros(0, np.complex128), np.zeros(0, np.complex128)
        points = np.ascontiguousarray(self._pixels[chosen, None], np.float32)
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            drawn,
            image,
            points,
            points.copy(),
            winSize=(WINDOW, WINDOW),
            maxLevel=0,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, STEPS, SETTLED),
            minEigThreshold=LEAST_TEXTURE,
        )
        pixels = np.asarray(found, np.float64)[:, 0]
        there = self._floor(self._lens.undistort(pixels), pixels, stance)
        good = (status[:, 0] == 1) & np.isfinite(there)
        return floor[chosen[good]], there[good]

    def _source(self, stance: Stance, floor: Places, motion: Motion) -> Array:
        """Return where in the last image (K,) places of the floor were, (K, 2) px.

        Args:
            stance: Of the body then.
            floor: Beside the body now, m; NaN for what is no floor.
            motion: From then to now.
        """
        rotation, place = self._camera(stance)
        then = floor * cmath.rect(1.0, motion.turn) + motion.shift
        going = complex(stance.velocity[0], stance.velocity[1])
        delay = np.zeros(len(floor))
        for _ in range(2):  # first as of the middle row, then as of its own
            there = (then - delay * going) * np.exp(-1j * stance.yaw_rate * delay)
            ahead = np.column_stack([there.real, there.imag, np.zeros(len(floor))]) - place
            ahead = np.nan_to_num(ahead @ rotation, nan=-1.0)
            seen = ahead[:, 2:] > NEAREST
            pixels = np.where(seen, self._lens.project(np.where(seen, ahead, 1.0)), NOWHERE)
            delay = np.clip(self._lens.row_delay(pixels), -1.0, 1.0)
        return np.clip(pixels, NOWHERE, -NOWHERE)

    def _floor(self, rays: Array, pixels: Array, stance: Stance) -> Places:
        """Return where (K, 2) rays meet the floor beside the level body, (K,) x + iy, NaN if not.

        Pixels are read at different times: what is returned is as of the image's middle row.
        """
        rotation, place = self._camera(stance)
        away = np.column_stack([rays, np.ones(len(rays))]) @ rotation.T
        down = -away[:, 2]
        meets = down > LEAST_DIP * np.sqrt((away * away).sum(axis=1))  # not so for NaN
        x, y, _ = (place + away * (place[2] / np.where(meets, down, np.nan))[:, None]).T
        delay = self._lens.row_delay(pixels)
        going = complex(stance.velocity[0], stance.velocity[1])
        met: Places = np.exp(1j * stance.yaw_rate * delay) * (x + 1j * y) + delay * going
        return met

    def _camera(self, stance: Stance) -> tuple[Array, Array]:
        """Return the (3, 3) rotation of the camera in the level body and its (3,) place, m."""
        level = gtsam.Rot3.Ypr(0.0, stance.pitch, stance.roll).matrix()
        place = level @ self._lens.mounting.position + np.array([0.0, 0.0, stance.height])
        return level @ self._turned, place


def _lattice(width: int, height: int, columns: int, rows: int, margin: int) -> Array:
    """Return points all over an image, row by row, (columns rows, 2) px."""
    across = np.linspace(margin, width - 1 - margin, columns)
    down = np.linspace(margin, height - 1 - margin, rows)
    points: Array = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    return points


def _agreed(shifts: Places, places: Places, height: float, focal: float) -> complex | None:
    """Return what most points agree on, or None if too few do.

    Args:
        shifts: (K,) ways that points say, m.
        places: (K,) where they lie: a pixel is ``(h² + d²) / h`` per focal length on the floor.
        height: m.
        focal: px.
    """
    if len(shifts) < LEAST_POINTS:
        return None
    fine = focal * height / (height**2 + np.abs(places) ** 2)  # px/m
    exact = weight = fine**2
    for _ in range(ROUNDS):
        shift = complex((weight @ shifts) / weight.sum())
        off = np.abs(shifts - shift) * fine
        spread = float(np.median(off)) / RAYLEIGH
        weight = exact / np.maximum(1.0, off / (HUBER * max(spread, SETTLED)))
    return shift if spread < MOST_SPREAD else None


RAYLEIGH: Final = 1.1774
"""Median of the length of a vector whose two components have the deviation 1."""
