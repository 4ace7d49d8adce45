"""The original STAR's localization, for comparison: a pose graph, optimized as a whole every time.

As its paper has it: a node for each image with tags, at 6 Hz; between nodes the motion that the
on-board estimator reports; from node to landmark the pose that the image shows; a prior on each
landmark; Levenberg-Marquardt over all of it since take-off. What the paper leaves open is as in
the released code: one standard deviation for every factor in all six directions, no gate and no
robust factors; a tag's pose is that of its homography, whichever of the two that a small tag has;
an image counts at its arrival; and the camera is in the body's center, rotated only.

Better than in that code, motion between nodes is odometry and not the difference of two sightings,
the camera's rotation counts once, tags may have any orientation, corners are those of
``method: filter``, and no pose is sent to the on-board estimator.
"""

from __future__ import annotations

import math
from typing import Final

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from star_apriltag.agent_estimator import CameraReport
from star_apriltag.dead_reckoning import YAW, Anchor, start
from star_apriltag.odometry_track import OdometryTrack
from star_apriltag.vision.detector import Detector
from star_apriltag.vision.image_analysis import ImageAnalysis
from star_apriltag.vision.tag_poses import MapTag
from star_core import Agent, Array, Odometry, Pose, Rows, Tag
from star_core.toolkit import CameraModel, square_corners

PERIOD: Final = 1 / 6  # s between nodes, at least
STD: Final = 0.03  # m and rad, of every factor
SINGULAR: Final = 1e-9


class BatchEstimator:
    """Estimates one agent's state with a graph of every pose since take-off.

    Its public methods are those of `FilterEstimator`.
    """

    def __init__(self, agent: Agent, landmarks: tuple[Tag, ...]) -> None:
        self._track = OdometryTrack()
        self._lens = None if agent.camera is None else CameraModel(agent.camera)
        self._detector = None if self._lens is None else Detector(self._lens)
        self._map = {tag.id: MapTag(tag) for tag in landmarks}
        self._noise = gtsam.noiseModel.Isotropic.Sigma(6, STD)
        self._graph = gtsam.NonlinearFactorGraph()
        self._values = gtsam.Values()
        self._count = 0
        pose = gtsam.Pose3(gtsam.Rot3.Yaw(agent.yaw), np.array(agent.start, float))
        self._graph.add(gtsam.PriorFactorPose3(X(0), pose, self._noise))
        self._values.insert(X(0), pose)
        self._start = start(agent)
        self._node = pose
        self.anchor = self._anchor(0.0, np.eye(6) * STD**2)

    def add_odometry(self, odometry: Odometry, rows: Rows, *, motors: bool) -> None:
        self._track.add(odometry, rows, motors=motors)

    def advance(self, now: float) -> None:
        """Do nothing: there are no nodes without tags."""

    def add_image(self, report: CameraReport) -> tuple[ImageAnalysis, None] | None:
        if self._lens is None or self._detector is None:
            return None
        time = report.taken if report.arrived is None else report.arrived
        if time < self.anchor.time + PERIOD:
            return None
        tags, corners = report.tags, report.corners
        if report.image is not None:
            detections = self._detector.detect(report.image)
            tags, corners = detections.tag, detections.corners
        turned = Pose(self._lens.mounting.rotation, np.zeros(3))
        poses = {}
        for number, pixels in zip(tags.tolist(), corners, strict=True):
            tag = self._map.get(number)
            pose = homography_pose(self._lens.undistort(pixels), tag.size) if tag else None
            if pose is not None:
                poses[number] = _as_gtsam(turned @ pose)
        if poses:
            self._optimize(time, poses)
        reasons = ("" if tag in poses else "no landmark, or unsolved" for tag in tags.tolist())
        return ImageAnalysis(
            detected=tuple(zip(tags.tolist(), corners, reasons, strict=True))
        ), None

    def _optimize(self, time: float, poses: dict[int, gtsam.Pose3]) -> None:
        """Add a node with the tags seen from it, in the body, and optimize everything."""
        leg = self._leg(time)
        last, key = X(self._count), X(self._count + 1)
        self._count += 1
        self._graph.add(gtsam.BetweenFactorPose3(last, key, leg, self._noise))
        self._values.insert(key, self._node.compose(leg))
        for number, pose in poses.items():
            if not self._values.exists(L(number)):
                landmark = _as_gtsam(self._map[number].pose)
                self._graph.add(gtsam.PriorFactorPose3(L(number), landmark, self._noise))
                self._values.insert(L(number), landmark)
            self._graph.add(gtsam.BetweenFactorPose3(key, L(number), pose, self._noise))
        optimizer = gtsam.LevenbergMarquardtOptimizer(self._graph, self._values)
        self._values = optimizer.optimize()
        covariance = gtsam.Marginals(self._graph, self._values).marginalCovariance(key)
        self._node = self._values.atPose3(key)
        self.anchor = self._anchor(time, covariance)

    def _leg(self, time: float) -> gtsam.Pose3:
        """Return the motion of the body since the newest node, by odometry."""
        motion = self._track.between(self.anchor.time, time)
        first, last = self._track.at(self.anchor.time), self._track.at(time)
        before = gtsam.Pose3(gtsam.Rot3.Ypr(0.0, first.pitch, first.roll), [0.0, 0.0, first.height])
        after = gtsam.Pose3(
            gtsam.Rot3.Ypr(motion.turn, last.pitch, last.roll),
            [motion.shift.real, motion.shift.imag, last.height],
        )
        return before.between(after)

    def _anchor(self, time: float, covariance: Array) -> Anchor:
        """Return the newest node, of uncalibrated odometry, by its (6, 6) covariance."""
        rotation = self._node.rotation().matrix()
        by_step = np.zeros((4, 6))
        by_step[:3, 3:] = rotation
        by_step[3, :3] = rotation[2]
        mean, joint = self._start.mean.copy(), self._start.covariance.copy()
        mean[:2], mean[YAW] = self._node.translation()[:2], self._node.rotation().yaw()
        joint[: YAW + 1, : YAW + 1] = by_step @ covariance @ by_step.T
        return Anchor(time, mean, joint)


def homography_pose(rays: Array, size: float) -> Pose | None:
    """Return the pose of a square in the camera by its homography, or None if there is none.

    Up to a factor, the homography from the square's plane to the image is the first two columns of
    the rotation and the position. The factor makes the geometric mean of those columns' lengths 1;
    with their cross product, the nearest rotation is taken. Errors of the corners are not weighted,
    and either of the two poses that a small square may have can result.

    Args:
        rays: (4, 2) its corners: bottom left, bottom right, top right, top left.
        size: Its edge, m.
    """
    if not np.isfinite(rays).all():
        return None
    (x, y), (u, v) = square_corners(size)[:, :2].T, rays.T
    ones, zeros = np.ones(4), np.zeros(4)
    equations = np.concatenate(  # in double precision, which OpenCV's findHomography has not
        [
            np.stack([x, y, ones, zeros, zeros, zeros, -u * x, -u * y, -u], axis=1),
            np.stack([zeros, zeros, zeros, x, y, ones, -v * x, -v * y, -v], axis=1),
        ]
    )
    homography = np.linalg.svd(equations)[2][-1].reshape(3, 3)
    if abs(np.linalg.det(homography)) < SINGULAR or abs(homography[2, 2]) < SINGULAR:
        return None
    length = math.sqrt(float(np.prod(np.linalg.norm(homography[:, :2], axis=0))))
    right, up, position = (homography / math.copysign(length, homography[2, 2])).T
    before, _, after = np.linalg.svd(np.column_stack([right, up, np.cross(right, up)]))
    return Pose(before @ after, position)


def _as_gtsam(pose: Pose) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3(pose.rotation), pose.position)
