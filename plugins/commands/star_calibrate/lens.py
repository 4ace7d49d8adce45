"""A camera's intrinsics from images of a board, and their standard deviations."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Final, NamedTuple

import cv2
import numpy as np

from star_calibrate.board import Board, Corners, View, Views
from star_core import Array, InputError

MIN_IMAGES: Final = 6  # three determine the matrix, and some are always poor
OUTLIER: Final = 3.0  # times the median of all images' errors
MAX_ERROR: Final = 1.0  # px RMS: a larger one is no lens of this model, or another board
MAX_FOCAL_STD: Final = 0.01  # of the focal length
CELLS: Final = (6, 4)  # of an image, for the share of it that corners cover

POSE: Final = 6  # parameters of one board: three of its rotation, three of its position
LENS: Final = 8  # parameters of all images: fx, fy, cx, cy, k1, k2, p1, p2
SINGULAR: Final = 1e-12  # information of an unconstrained parameter, by rounding


class Fit(NamedTuple):
    """Fit of one image."""

    name: str  # of its file
    error: float  # RMS distance of its corners from their projections, px
    distance: float  # from the camera to the board's center, m


class Lens(NamedTuple):
    """A camera by OpenCV's pinhole model."""

    width: int  # px
    height: int  # px
    matrix: tuple[float, ...]  # fx, fy, cx, cy, px
    deviation: tuple[float, ...]  # standard deviation of each of these, px
    distortion: tuple[float, ...]  # k1, k2, p1, p2, k3; k3 is fixed at 0
    error: float  # RMS distance of all corners from their projections, px
    used: tuple[Fit, ...]  # the images it is based on
    rejected: tuple[Fit, ...]  # images that fit much worse than the others, with their errors
    covered: float  # share of the image's cells with a corner


def solve(views: Views, board: Board) -> Lens:
    """Return the lens with the least reprojection error.

    This is Zhang's method (IEEE PAMI 22(11), 2000) by OpenCV. Images whose error is more than
    `OUTLIER` times the median are rejected, and the rest is solved again. The third radial
    coefficient is fixed at 0: corners seldom reach where it differs from the second.

    Raises:
        InputError: There are too few images, they do not fit, or they do not determine the focal
            length.
    """
    usable, rejected = list(views.with_board), list[Fit]()
    while True:
        if len(usable) < MIN_IMAGES:
            raise InputError(_too_few(views, board, rejected), "calibration-failed")
        lens = _solved(views, usable, board)
        limit = OUTLIER * statistics.median(fit.error for fit in lens.used)
        poor = [fit for fit in lens.used if fit.error > limit]
        if not poor:
            break
        rejected += poor
        names = {fit.name for fit in poor}
        usable = [view for view in usable if view.name not in names]
    _check(lens, board)
    return lens._replace(rejected=tuple(rejected))


def deviations(
    points: Array,
    poses: Sequence[tuple[Array, Array]],
    matrix: Array,
    distortion: Array,
    error: float,
) -> tuple[float, ...]:
    """Return the standard deviations of fx, fy, cx and cy, px; infinite if not determined.

    They are those of linear least squares at the solution, with the boards' poses eliminated from
    the normal equations. OpenCV's own leave out what is not constrained: they were 0.02 px for a
    focal length that was 53 px wrong, from eight images of a board that was never tilted.

    Args:
        points: (K, 3) the board's corners, m.
        poses: Rotation vector and translation of each board, from the board to the camera.
        matrix: (3, 3) of the camera.
        distortion: (5,) k1, k2, p1, p2, k3; k3 counts as known.
        error: RMS distance of all corners from their projections, px.
    """
    jacobians = [
        np.asarray(cv2.projectPoints(points, *pose, matrix, distortion)[1], np.float64)
        for pose in poses
    ]
    scale = np.linalg.norm(np.concatenate(jacobians)[:, POSE : POSE + LENS], axis=0)
    normal = np.zeros((LENS, LENS))
    for jacobian in jacobians:
        basis = np.linalg.qr(jacobian[:, :POSE]).Q
        shared = jacobian[:, POSE : POSE + LENS] / scale
        rest = shared - basis @ (basis.T @ shared)
        normal += rest.T @ rest
    corners = len(jacobians) * len(points)
    free = 2 * corners - POSE * len(jacobians) - LENS
    information, direction = np.linalg.eigh(normal)
    if free <= 0 or information[0] <= SINGULAR:
        return (float("inf"),) * 4
    spread = ((direction**2) / information).sum(axis=1) / scale**2
    deviation = np.sqrt(corners * error**2 / free * spread)
    return tuple(map(float, deviation[:4]))


def _solved(views: Views, usable: Sequence[View], board: Board) -> Lens:
    try:
        error, matrix, bend, turns, positions, _, _, errors = cv2.calibrateCameraExtended(
            [board.points.astype(np.float32)] * len(usable),
            [view.corners for view in usable],
            (views.width, views.height),
            np.eye(3),
            np.zeros(5),
            flags=cv2.CALIB_FIX_K3,
        )
    except cv2.error as failure:
        reason = f"no lens explains these images: {failure.err}"
        raise InputError(reason, "calibration-failed") from failure
    center = board.points.mean(axis=0)
    poses = [
        (np.asarray(turn, np.float64), np.asarray(position, np.float64))
        for turn, position in zip(turns, positions, strict=True)
    ]
    distances = [
        float(np.linalg.norm(cv2.Rodrigues(turn)[0] @ center + np.ravel(position)))
        for turn, position in poses
    ]
    intrinsics, distortion = np.asarray(matrix, np.float64), np.asarray(bend, np.float64)
    return Lens(
        width=views.width,
        height=views.height,
        matrix=tuple(float(intrinsics[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))),
        deviation=deviations(board.points, poses, intrinsics, distortion, float(error)),
        distortion=tuple(map(float, np.ravel(distortion)[:5])),
        error=float(error),
        used=tuple(
            Fit(view.name, float(poor), distance)
            for view, poor, distance in zip(usable, np.ravel(errors), distances, strict=True)
        ),
        rejected=(),
        covered=_covered(np.concatenate([view.corners for view in usable]), views),
    )


def _covered(corners: Corners, views: Views) -> float:
    cells = np.floor(corners / (views.width, views.height) * CELLS).astype(int)
    return len({tuple(cell) for cell in cells.tolist()}) / (CELLS[0] * CELLS[1])


def _too_few(views: Views, board: Board, rejected: Sequence[Fit]) -> list[str]:
    usable = len(views.with_board) - len(rejected)
    return [
        *(f"{name}: no board of {board} inner corners found" for name in views.without),
        *(f"{fit.name}: fits {fit.error:.2f} px poorly" for fit in rejected),
        f"{usable} images with a board of {board} inner corners are too few, expected at least"
        f" {MIN_IMAGES}; take more, with the whole board in each, or correct --board",
    ]


def _check(lens: Lens, board: Board) -> None:
    """Reject a lens with too large errors.

    Raises:
        InputError: They are too large.
    """
    if not lens.error <= MAX_ERROR:
        worst = max(lens.used, key=lambda fit: fit.error)
        problems = [
            f"{worst.name}: fits worst, {worst.error:.2f} px",
            f"the images fit {lens.error:.2f} px RMS, expected at most {MAX_ERROR:g} px; is the"
            f" board flat, are the images sharp, and has it {board} inner corners?",
        ]
        raise InputError(problems, "calibration-failed")
    focal, deviation = max(lens.matrix[:2]), max(lens.deviation[:2])
    if not deviation <= MAX_FOCAL_STD * focal:
        raise InputError(
            f"the images do not determine the focal length: {focal:.1f} +- {deviation:.1f} px,"
            f" expected +- {MAX_FOCAL_STD * focal:.1f} px or less; add some of the board tilted by"
            " 30 to 45 degrees, to all sides",
            "calibration-failed",
        )
