"""Visual odometry by the floor's texture: motion of the body between two images."""

from __future__ import annotations

import cmath
import math
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from star_apriltag.dead_reckoning import level_rotation
from star_apriltag.odometry_track import Motion, OdometrySample, OdometryTrack
from star_apriltag.vision.body_pose import MIN_DEPTH
from star_apriltag.vision.detector import checked
from star_core import Array, Image
from star_core.toolkit import CameraModel

COLUMNS, ROWS = 10, 8  # of the points that are tracked, over the whole image
COARSE: Final = 16  # px between the points whose previous pixels are computed
WINDOW: Final = 21  # px, edge of the square around a point that is tracked
MAX_STEPS: Final = 6  # of Lucas and Kanade's method, which begins at most a few px off
CONVERGED: Final = 0.02  # px
MIN_TEXTURE: Final = 1e-3  # OpenCV's smaller eigenvalue; a third of that of a stained floor

MIN_HEIGHT: Final = 0.2  # m: nearer to the floor it moves too fast
MIN_DIP: Final = 0.3  # slope of a ray, down per length: farther points are too uncertain
WARPED_DIP: Final = 0.05  # likewise, of what is drawn: the windows of points contain farther ones
MIN_POINTS: Final = 12
OUTSIDE: Final = -1e4  # px, of a point that is not on the floor
MAX_INTERVAL: Final = 1.0  # s between two images

# px, standard deviation of points about their consensus. In simulation a stained floor has 0.1, or
# 0.25 if the last image is 0.4 s old; with only the camera's noise it is 0.36 and more.
MAX_SPREAD: Final = 0.3

HUBER: Final = 1.5  # standard deviations above which a point weighs less
ITERATIONS: Final = 4

# Greatest difference from odometry over all consecutive images; with a larger one the points are
# not on the floor, or are a pattern of the sensor that does not move in the image.
MAX_OFF: Final = 0.02  # m
MAX_OFF_SHARE: Final = 0.25  # of the length
MAX_OFF_RATE: Final = 0.05  # m/√s

POINT_STD: Final = 0.15  # px, of a tracked point
# Standard deviations of odometry's errors between two images, beside its shift of about 1 m: of the
# turn, with times of images that are off by 0.02 s, and of the change of roll and pitch.
ODOMETRY_STD: Final = np.array([1.0, 1.0, 0.02, 0.01, 0.01])

RAYLEIGH: Final = 1.1774
"""Median length of a vector whose two components have the standard deviation 1."""

Points = NDArray[np.complex128]


class MeasuredMotion(NamedTuple):
    """Motion between two images."""

    begin: float  # exposure of the first, s
    end: float  # exposure of the second, s
    shift: complex  # x + iy in the level body frame at the beginning, m


class _Frame(NamedTuple):
    image: Image
    time: float
    sample: OdometrySample


class _Difference(NamedTuple):
    """Difference of consecutive measurements from odometry, and the motion over which it arose."""

    shift: complex = 0j  # in the level body frame, m
    length: float = 0.0  # m
    duration: float = 0.0  # s

    def after(self, motion: Motion, off: complex) -> _Difference:
        return _Difference(
            self.shift * cmath.rect(1.0, -motion.turn) + off,
            self.length + motion.length,
            self.duration + motion.duration,
        )

    @property
    def plausible(self) -> bool:
        most = MAX_OFF + MAX_OFF_SHARE * self.length + MAX_OFF_RATE * math.sqrt(self.duration)
        return abs(self.shift) <= most


class FloorOdometry:
    """Tracks a lattice of points from one image of a camera to the next.

    They are assumed to be on the floor, the map's plane z = 0: with the on-board tilt and height
    each pixel is then a point relative to the body. The last image is warped to the pose that
    odometry predicts; its points are tracked in the new image by the method of Lucas and Kanade
    (IJCAI 1981), and errors of odometry's displacement, turn and change of tilt are fitted to
    them. Outliers weigh less, by Huber's rule. The turn that is kept is the gyro's.
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
        self._between = (  # each pixel's coordinates among the coarse points
            u * np.float32((self._shape[1] - 1) / (width - 1)),
            v * np.float32((self._shape[0] - 1) / (height - 1)),
        )
        self._turned = lens.mounting.rotation
        self._last: _Frame | None = None
        self._difference = _Difference()

    def measure(
        self,
        image: Image,
        time: float,
        track: OdometryTrack,
        *,
        ground: float,
        yaw_bias: float,
        camera_turn: Array,
        needed: bool = True,
    ) -> MeasuredMotion | None:
        """Return the motion since the previous image, or None if it cannot be measured.

        Args:
            image: As the lens shows it.
            time: Of its exposure, later than that of the previous one, s.
            track: Odometry.
            ground: z of its odometry frame in the map, m.
            yaw_bias: Subtracted from its yaw rate, rad/s.
            camera_turn: (3, 3) rotation of the camera against its mounting, in its frame.
            needed: False only keeps the image for the next call.

        Raises:
            ValueError: It is no gray image of the camera's size.
        """
        image = checked(image, self._lens)
        self._turned = self._lens.mounting.rotation @ camera_turn.T
        sample = track.at(time)
        sample = sample._replace(height=sample.height + ground, yaw_rate=sample.yaw_rate - yaw_bias)
        last, self._last = self._last, None
        before, self._difference = self._difference, _Difference()
        if not sample.height > MIN_HEIGHT:
            return None
        self._last = _Frame(image, time, sample)
        if not needed or last is None or not 0 < time - last.time <= MAX_INTERVAL:
            return None
        if track.newest < time:
            return None
        motion = track.between(last.time, time, yaw_bias=yaw_bias)
        predicted, measured = self._tracked(last, image, sample, motion)
        off = _consensus(predicted - measured, predicted, sample.height, self._lens.matrix[0, 0])
        self._difference = before.after(motion, off or 0j)
        if off is None or not self._difference.plausible:
            return None
        return MeasuredMotion(last.time, time, motion.shift + off * cmath.rect(1.0, motion.turn))

    def _tracked(
        self, last: _Frame, image: Image, sample: OdometrySample, motion: Motion
    ) -> tuple[Points, Points]:
        """Return points relative to the body: as predicted by odometry, and as seen."""
        coarse = self._floor(self._coarse_rays, self._coarse, sample, min_dip=WARPED_DIP)
        coarse_source = self._source(last.sample, coarse, motion).T.reshape(2, *self._shape)
        columns, rows = (
            cv2.remap(channel, *self._between, cv2.INTER_LINEAR)
            for channel in coarse_source.astype(np.float32)
        )
        drawn = cv2.remap(last.image, columns, rows, cv2.INTER_LINEAR)
        floor = self._floor(self._rays, self._pixels, sample)
        source = self._source(last.sample, floor, motion)
        inside = (source > WINDOW / 2) & (source < self._size - WINDOW / 2)
        chosen = np.flatnonzero(inside.all(axis=1))
        if len(chosen) < MIN_POINTS:
            return np.zeros(0, np.complex128), np.zeros(0, np.complex128)
        points = np.ascontiguousarray(self._pixels[chosen, None], np.float32)
        tracked, status, _ = cv2.calcOpticalFlowPyrLK(
            drawn,
            image,
            points,
            points.copy(),
            winSize=(WINDOW, WINDOW),
            maxLevel=0,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, MAX_STEPS, CONVERGED),
            minEigThreshold=MIN_TEXTURE,
        )
        pixels = np.asarray(tracked, np.float64)[:, 0]
        floor_points = self._floor(self._lens.undistort(pixels), pixels, sample)
        good = (status[:, 0] == 1) & np.isfinite(floor_points)
        return floor[chosen[good]], floor_points[good]

    def _source(self, sample: OdometrySample, floor: Points, motion: Motion) -> Array:
        """Return the (K, 2) px of points of the floor in the last image.

        Args:
            sample: Of the body then.
            floor: (K,) relative to the body now, m; NaN for points that are not on the floor.
            motion: From then to now.
        """
        rotation, position = self._camera(sample)
        floor_then = floor * cmath.rect(1.0, motion.turn) + motion.shift
        velocity = complex(sample.velocity[0], sample.velocity[1])
        delay = np.zeros(len(floor))
        for _ in range(2):  # first as of the middle row, then as of its own
            point = (floor_then - delay * velocity) * np.exp(-1j * sample.yaw_rate * delay)
            ahead = np.column_stack([point.real, point.imag, np.zeros(len(floor))]) - position
            ahead = np.nan_to_num(ahead @ rotation, nan=-1.0)
            in_front = ahead[:, 2:] > MIN_DEPTH
            pixels = np.where(in_front, self._lens.project(np.where(in_front, ahead, 1.0)), OUTSIDE)
            delay = np.clip(self._lens.row_delay(pixels), -1.0, 1.0)
        return np.clip(pixels, OUTSIDE, -OUTSIDE)

    def _floor(
        self, rays: Array, pixels: Array, sample: OdometrySample, *, min_dip: float = MIN_DIP
    ) -> Points:
        """Return the (K,) points x + iy on the floor of (K, 2) rays, relative to the level body.

        They refer to the time of the image's middle row; NaN for rays that are not
        at least `min_dip` steep.
        """
        rotation, position = self._camera(sample)
        away = np.column_stack([rays, np.ones(len(rays))]) @ rotation.T
        down = -away[:, 2]
        meets = down > min_dip * np.sqrt((away * away).sum(axis=1))  # not so for NaN
        x, y, _ = (position + away * (position[2] / np.where(meets, down, np.nan))[:, None]).T
        delay = self._lens.row_delay(pixels)
        velocity = complex(sample.velocity[0], sample.velocity[1])
        met: Points = np.exp(1j * sample.yaw_rate * delay) * (x + 1j * y) + delay * velocity
        return met

    def _camera(self, sample: OdometrySample) -> tuple[Array, Array]:
        """Return the (3, 3) rotation of the camera in the level body and its (3,) position, m."""
        level = level_rotation(sample.roll, sample.pitch)
        position = level @ self._lens.mounting.position + np.array([0.0, 0.0, sample.height])
        return level @ self._turned, position


def _lattice(width: int, height: int, columns: int, rows: int, margin: int) -> Array:
    """Return a lattice of points over an image, row by row, (columns rows, 2) px."""
    across = np.linspace(margin, width - 1 - margin, columns)
    down = np.linspace(margin, height - 1 - margin, rows)
    points: Array = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    return points


def _consensus(shifts: Points, points: Points, height: float, focal: float) -> complex | None:
    """Return the robust displacement of the body, or None if too few points agree.

    A turn by t shifts a point p by itp; a change of tilt by a about the axis ahead and b about that
    to the left shifts it by ``h (ia - b) + p (a y - b x) / h``, for p = x + iy.

    Args:
        shifts: (K,) displacements, m.
        points: (K,) their positions: a pixel is ``(h² + d²) / h`` per focal length on the floor.
        height: m.
        focal: px.
    """
    if len(shifts) < MIN_POINTS:
        return None
    fine = focal * height / (height**2 + np.abs(points) ** 2)  # px/m
    even = np.ones(len(points), np.complex128)
    roll, pitch = points * points.imag / height, points * points.real / height
    columns = even, 1j * even, 1j * points, 1j * height + roll, -height - pitch
    by = np.column_stack([_parts(np.asarray(column * fine)) for column in columns])
    pixel_shifts = _parts(shifts * fine)
    prior = np.diag((POINT_STD / ODOMETRY_STD) ** 2)
    weight = np.ones(len(points))
    for _ in range(ITERATIONS):
        weighted = by * np.tile(weight, 2)[:, None]
        solution = np.linalg.solve(weighted.T @ by + prior, weighted.T @ pixel_shifts)
        off = np.hypot(*(pixel_shifts - by @ solution).reshape(2, -1))
        spread = float(np.median(off)) / RAYLEIGH
        weight = 1 / np.maximum(1.0, off / (HUBER * max(spread, CONVERGED)))
    return complex(*solution[:2]) if spread < MAX_SPREAD else None


def _parts(values: Points) -> Array:
    """Return the real parts, and then the imaginary parts."""
    parts: Array = np.concatenate([values.real, values.imag])
    return parts
