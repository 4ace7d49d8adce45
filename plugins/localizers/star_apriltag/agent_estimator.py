"""Estimates the state of one agent from its odometry and its camera, also after it was moved."""

from __future__ import annotations

import cmath
import logging
import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

import gtsam
import numpy as np

from star_apriltag.dead_reckoning import (
    AgentState,
    Anchor,
    odometry_leg,
    predict,
    predicted_covariance,
    start_node,
)
from star_apriltag.floor_odometry import FloorOdometry
from star_apriltag.odometry_track import KnownPose, Motion, OdometryCalibration, OdometryTrack
from star_apriltag.smoother import Smoother
from star_apriltag.vision.body_pose import AT_REST, Prediction, View
from star_apriltag.vision.body_pose import Motion as BodyMotion
from star_apriltag.vision.image_analysis import ImageAnalysis, ImageAnalyzer
from star_core import Agent, Array, Image, Odometry, Pose, Rows, Tag

log = logging.getLogger(__name__)

NODE_PERIOD: Final = 0.5  # s, of nodes without tags
ADVANCE_DELAY: Final = 0.35  # s beyond the latency after which such nodes are added
NO_MOTION: Final = Motion(0j, 0.0, 0.0, 0.0, 0.0, 0.0)


class Settings(NamedTuple):
    """Options of the estimators, as described in the localizer's schema."""

    method: str
    max_tags_per_landmark: int
    latency: float  # s
    mounting_std: float  # rad
    lag: float  # s
    guided_matching: bool
    floor_odometry: bool


class CameraReport(NamedTuple):
    """An image, or the tags that were detected in one on board."""

    row: int  # of the agent
    taken: float  # time of the exposure, s
    image: Image | None  # none if tags were detected on board
    tags: Rows  # (K,) numbers of those
    corners: Array  # (K, 4, 2) px
    arrived: float | None = None  # time of arrival, s; None if it does not matter
    stamped: bool = True  # whether `taken` is known; else it is derived from `arrived`


class AgentEstimator(Protocol):
    """A method to estimate the state of one agent."""

    @property
    def anchor(self) -> Anchor:
        """Where dead reckoning continues."""

    def add_odometry(self, odometry: Odometry, rows: Rows, *, motors: bool) -> None:
        """Add the samples in `rows`, which are the agent's."""

    def add_image(self, report: CameraReport) -> tuple[ImageAnalysis, AgentState | None] | None:
        """Add an image; return its analysis and the predicted state at its exposure.

        Raises:
            ValueError: It is no image of the agent's camera.
        """

    def advance(self, now: float) -> None:
        """Continue up to `now`, s, without further images."""


class SmoothingEstimator:
    """Estimates one agent's state with a fixed-lag smoother; without a camera, by odometry only.

    Of the targets only the numbers and sizes are used.
    """

    def __init__(
        self,
        agent: Agent,
        landmarks: tuple[Tag, ...],
        targets: tuple[Tag, ...],
        settings: Settings,
    ) -> None:
        self.track = OdometryTrack()
        self.calibration = OdometryCalibration()
        self._delay = settings.latency + ADVANCE_DELAY
        self._ground = float(agent.start[2])  # z of the odometry frame, m
        self._analyzer = self._floor = None
        mounting = Pose(np.eye(3), np.zeros(3))
        if agent.camera is not None:
            self._analyzer = ImageAnalyzer(
                agent.camera,
                landmarks,
                {tag.id: tag.size for tag in targets},
                guided_matching=settings.guided_matching,
            )
            mounting = self._analyzer.lens.mounting
            self._floor = FloorOdometry(self._analyzer.lens) if settings.floor_odometry else None
        self._smoother = Smoother(mounting, mounting_std=settings.mounting_std, lag=settings.lag)
        self._smoother.start(*start_node(agent))
        self._relocation = Relocation()

    @property
    def anchor(self) -> Anchor:
        return Anchor(self._smoother.node, self.calibration.scale, self.calibration.yaw_bias)

    def at(self, time: float) -> AgentState:
        """Return the state at `time`, s, no earlier than the newest node."""
        return predict(self.anchor, time, self.track, self._ground)

    def add_odometry(self, odometry: Odometry, rows: Rows, *, motors: bool) -> None:
        self.track.add(odometry, rows, motors=motors)

    def advance(self, now: float) -> None:
        while now - self._delay - self._smoother.node.time > NODE_PERIOD:
            self._add_node(self._smoother.node.time + NODE_PERIOD, (), AT_REST)

    def add_image(self, report: CameraReport) -> tuple[ImageAnalysis, AgentState] | None:
        time = report.taken
        if self._analyzer is None or not time > self._smoother.node.time:
            return None
        measured = report.image is not None and self._measure_floor(report.image, time)
        state = self.at(time)
        prediction = _prediction(state, self._smoother.camera_turn)
        if report.image is None:
            analysis = self._analyzer.evaluate(report.tags, report.corners, prediction)
        else:
            analysis = self._analyzer.analyze(report.image, prediction)
        if analysis.accepted:
            self._relocation.forget()
        if analysis.views:
            self.add_views(time, analysis.views, prediction.motion)
        elif analysis.other is not None:
            pose = gtsam.Pose3(
                gtsam.Rot3(analysis.other.pose.rotation), analysis.other.pose.position
            )
            claim = Claim(time, pose, analysis.other.covariance)
            if self._relocation.consider(claim, self.track):
                log.info("an agent is relocated at %.2f s", time)
                self.restart(*claim)
                measured = False
        if measured and not analysis.views:
            self.add_views(time, (), prediction.motion)
        return analysis, state

    def add_views(self, time: float, views: Sequence[View], motion: BodyMotion) -> None:
        """Add the tags that were accepted in an image taken at `time`, s.

        An image that is not newer than the newest node is ignored.
        """
        if time <= self._smoother.node.time:
            return
        self._add_node(time, views, motion)
        if views:
            node = self._smoother.node
            x, y, _ = node.pose.translation()
            spread = predicted_covariance(node, 0j, NO_MOTION)
            deviation = math.sqrt(max(spread[0, 0], spread[1, 1]))
            yaw, yaw_deviation = node.pose.rotation().yaw(), math.sqrt(spread[3, 3])
            known = KnownPose(time, complex(x, y), yaw, deviation, yaw_deviation)
            self.calibration.add(known, self.track)

    def restart(self, time: float, pose: gtsam.Pose3, covariance: Array) -> None:
        """Restart from a pose, since the previous ones were wrong."""
        self._smoother.start(time, pose, covariance)
        self.calibration.forget_poses()

    def _measure_floor(self, image: Image, time: float) -> bool:
        """Correct the odometry up to an image by the floor; return whether that was possible."""
        if self._floor is None:
            return False
        bias = self.calibration.yaw_bias
        turn = self._smoother.camera_turn
        measured = self._floor.measure(
            image, time, self.track, ground=self._ground, yaw_bias=bias, camera_turn=turn
        )
        if measured is None:
            return False
        self.track.correct(*measured, yaw_bias=bias)
        return True

    def _add_node(self, time: float, views: Sequence[View], motion: BodyMotion) -> None:
        leg = odometry_leg(self.anchor, time, self.track)
        sample = self.track.at(time)
        level = gtsam.Rot3.Ypr(0.0, sample.pitch, sample.roll)
        self._smoother.add(time, leg, level, self._ground + sample.height, views, motion)


def _prediction(state: AgentState, camera_turn: Array) -> Prediction:
    rotation = state.rotation
    return Prediction(
        pose=Pose(rotation, state.position),
        covariance=state.covariance[np.ix_([0, 1, 3], [0, 1, 3])],
        motion=BodyMotion(state.velocity @ rotation, np.array([0.0, 0.0, state.yaw_rate])),
        camera_turn=camera_turn,
    )


MIN_IMAGES: Final = 4  # consecutive ones that must agree
MAX_DISTANCE: Final = 0.15  # m between their positions
MAX_TURN: Final = math.radians(10.0)  # rad between their headings
MAX_TIME: Final = 3.0  # s between the first and the last


class Claim(NamedTuple):
    """Pose of the agent according to one image alone."""

    time: float  # of its exposure, s
    pose: gtsam.Pose3  # body in the map
    covariance: Array  # (6, 6) in gtsam's tangent


class Relocation:
    """Collects the claims of images whose tags were all rejected, until enough of them agree."""

    def __init__(self) -> None:
        self._claims: list[Claim] = []

    def forget(self) -> None:
        """Begin again, after an image was accepted."""
        self._claims.clear()

    def consider(self, claim: Claim, track: OdometryTrack) -> bool:
        """Add a claim; return whether the previous ones agree with it, given the odometry."""
        self._claims = [
            old
            for old in self._claims
            if claim.time - old.time < MAX_TIME and _agree(old, claim, track)
        ]
        self._claims.append(claim)
        if len(self._claims) < MIN_IMAGES:
            return False
        self._claims.clear()
        return True


def _agree(old: Claim, new: Claim, track: OdometryTrack) -> bool:
    motion = track.between(old.time, new.time)
    yaw = old.pose.rotation().yaw()
    turned = new.pose.rotation().yaw() - yaw - motion.turn
    x, y, _ = new.pose.translation() - old.pose.translation()
    apart = complex(x, y) - motion.shift * cmath.rect(1.0, yaw)
    return abs(apart) < MAX_DISTANCE and abs(math.remainder(turned, math.tau)) < MAX_TURN
