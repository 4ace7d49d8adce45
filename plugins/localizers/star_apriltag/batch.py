"""The original STAR's localisation, to compare with: a pose graph, optimised whole every time.

As its paper has it: a node for each image with tags, at 6 Hz; between nodes the motion that the
on-board estimator reports; from node to landmark the pose that the image shows; a prior on each
landmark; Levenberg and Marquardt over all of it since take-off. What the paper leaves open is as in
the released code: one deviation serves every factor in all six directions, nothing is gated and no
factor is robust; a tag's pose is the one that its homography gives, whichever of the two a small
tag looks like; an image counts for when it arrived; and the camera sits in the body's middle,
turned only.

Kinder than that code, motion between nodes is odometry and not the difference of two sights, the
camera's rotation counts once, tags may be mounted anyhow, corners are those of
``method: smoother``, and no fix reaches the on-board estimator.
"""

from __future__ import annotations

from typing import Final

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from star_apriltag.agent_estimator import Sight
from star_apriltag.dead_reckoning import Belief, Known, travel
from star_apriltag.odometry_track import Track
from star_apriltag.smoother import Node
from star_apriltag.vision.detector import Detector
from star_apriltag.vision.homography import flat_pose
from star_apriltag.vision.landmark import Place
from star_apriltag.vision.tag_measurement import Look
from star_core import Agent, CameraModel, Odometry, Pose, Rows, Tag

PERIOD: Final = 1 / 6  # s from one node to the next, at least
DEVIATION: Final = 0.03  # m and rad, of every factor


class Batched:
    """Follows one agent with a graph of every pose since take-off.

    Args:
        agent: With its camera, or without: then it has odometry only.
        landmarks: The map.

    Attributes:
        known: What is known of the agent by now.
    """

    def __init__(self, agent: Agent, landmarks: tuple[Tag, ...]) -> None:
        self._track = Track()
        self._lens = None if agent.camera is None else CameraModel(agent.camera)
        self._detector = None if self._lens is None else Detector(self._lens)
        self._places = {tag.id: Place(tag) for tag in landmarks}
        self._noise = gtsam.noiseModel.Isotropic.Sigma(6, DEVIATION)
        self._graph = gtsam.NonlinearFactorGraph()
        self._values = gtsam.Values()
        self._count = 0
        start = gtsam.Pose3(gtsam.Rot3.Yaw(agent.yaw), np.array(agent.start, float))
        self._graph.add(gtsam.PriorFactorPose3(X(0), start, self._noise))
        self._values.insert(X(0), start)
        self.known = Known(Node(0.0, start, np.eye(6) * DEVIATION**2))  # odometry as it is

    def hear(self, odometry: Odometry, rows: Rows, *, motors: bool) -> None:
        """Take in those samples of the odometry that are this agent's."""
        self._track.add(odometry, rows, motors=motors)

    def go_on(self, now: float) -> None:
        """Without tags there are no nodes."""

    def look(self, sight: Sight) -> tuple[Look, Belief] | None:
        """Take in an image, if it is time for a node; targets are not looked for."""
        if self._lens is None or self._detector is None:
            return None
        time = sight.taken if sight.arrived is None else sight.arrived
        if time < self.known.node.time + PERIOD:
            return None
        tags, corners = sight.tags, sight.corners
        if sight.image is not None:
            found = self._detector.detect(sight.image)
            tags, corners = found.tag, found.corners
        turned = Pose(self._lens.mounting.rotation, np.zeros(3))
        seen = {}
        for tag, pixels in zip(tags.tolist(), corners, strict=True):
            place = self._places.get(tag)
            if place is None:
                continue
            pose = flat_pose(self._lens.undistort(pixels), place.size)
            if pose is not None:
                seen[tag] = _as_gtsam(turned @ pose)
        if seen:
            self._optimise(time, seen)
        return None

    def _optimise(self, time: float, seen: dict[int, gtsam.Pose3]) -> None:
        """Add a node with the tags seen from it, in the body, and optimise everything."""
        leg = travel(self.known, time, self._track)
        last, key = X(self._count), X(self._count + 1)
        self._count += 1
        self._graph.add(gtsam.BetweenFactorPose3(last, key, leg.delta, self._noise))
        self._values.insert(key, self.known.node.pose.compose(leg.delta))
        for tag, pose in seen.items():
            if not self._values.exists(L(tag)):
                known = _as_gtsam(self._places[tag].pose)
                self._graph.add(gtsam.PriorFactorPose3(L(tag), known, self._noise))
                self._values.insert(L(tag), known)
            self._graph.add(gtsam.BetweenFactorPose3(key, L(tag), pose, self._noise))
        optimiser = gtsam.LevenbergMarquardtOptimizer(self._graph, self._values)
        self._values = optimiser.optimize()
        covariance = gtsam.Marginals(self._graph, self._values).marginalCovariance(key)
        self.known = Known(Node(time, self._values.atPose3(key), covariance))


def _as_gtsam(pose: Pose) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3(pose.rotation), pose.position)
