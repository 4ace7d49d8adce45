"""Estimates the state of one agent from its odometry and its camera, also after it was moved."""

from __future__ import annotations

import cmath
import logging
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from star_apriltag.dead_reckoning import AgentState, Z, predict, start
from star_apriltag.floor_odometry import FloorOdometry
from star_apriltag.joint_filter import Deviations, JointFilter
from star_apriltag.odometry_track import OdometryTrack
from star_apriltag.vision.body_pose import (
    MAX_SURPRISE,
    Motion,
    Prediction,
    Verdict,
    View,
    surprise,
)
from star_apriltag.vision.image_analysis import ImageAnalysis, ImageAnalyzer
from star_core import Agent, Array, Image, Odometry, Pose, Rows, Tag

log = logging.getLogger(__name__)

ADVANCE_PERIOD: Final = 0.5  # s, after which the state is carried on without images
ADVANCE_DELAY: Final = 0.35  # s beyond the latency, up to which an image may be late


class Settings(NamedTuple):
    """Options of the estimators, as described in the localizer's schema."""

    method: str
    max_tags_per_landmark: int
    latency: float  # s
    latency_std: float  # s
    mounting_std: float  # rad
    survey_std: float  # m
    survey_turn_std: float  # rad
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


class FilterEstimator:
    """Estimates one agent's state with a `JointFilter`; without a camera, by odometry only.

    Of the targets only the numbers and sizes are used.

    Attributes:
        anchor: Where dead reckoning continues.
    """

    def __init__(
        self,
        agent: Agent,
        landmarks: tuple[Tag, ...],
        targets: tuple[Tag, ...],
        settings: Settings,
    ) -> None:
        self.track = OdometryTrack()
        self._settings = settings
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
        deviations = Deviations(
            settings.mounting_std,
            settings.survey_std,
            settings.survey_turn_std,
            settings.latency_std / math.sqrt(2),
        )
        self._filter = JointFilter(start(agent), mounting, landmarks, self._ground, deviations)
        self._sheets = {tag.id: tag.of for tag in landmarks}
        self._relocation = Relocation(len(set(self._sheets.values())))
        self._earlier: Earlier | None = None
        self.anchor = self._filter.anchor

    def at(self, time: float) -> AgentState:
        """Return the state at `time`, s, no earlier than the newest image."""
        return predict(self.anchor, time, self.track, self._ground)

    def add_odometry(self, odometry: Odometry, rows: Rows, *, motors: bool) -> None:
        """Add the samples in `rows`, which are the agent's."""
        self.track.add(odometry, rows, motors=motors)

    def advance(self, now: float) -> None:
        """Continue up to `now`, s, without further images."""
        end = now - self._settings.latency - ADVANCE_DELAY
        if end - self.anchor.time > ADVANCE_PERIOD:
            self._filter.advance(end, self.track)
            self.anchor = self._filter.anchor
        if self._earlier is not None and end - self._earlier.filter.anchor.time > ADVANCE_PERIOD:
            self._earlier.filter.advance(end, self.track)

    def add_image(self, report: CameraReport) -> tuple[ImageAnalysis, AgentState] | None:
        """Add an image; return its analysis and the predicted state at its exposure.

        Raises:
            ValueError: It is no image of the agent's camera.
        """
        time = report.taken if report.stamped else report.taken - self._filter.latency
        if self._analyzer is None or not time > self.anchor.time:
            return None
        state = self.at(time)
        prediction = _prediction(state, self._filter.camera_turn)
        if report.image is None:
            analysis = self._analyzer.evaluate(report.tags, report.corners, prediction)
        else:
            analysis = self._analyzer.analyze(report.image, prediction)
        measured = self._measure_floor(report.image, time, needed=not analysis.views)
        before = self._filter.copied()
        if analysis.views or measured:
            self.add_views(time, analysis.views, stamped=report.stamped)
        if analysis.accepted:
            self._relocation.forget()
            self._compare(before, prediction, time, analysis)
        elif analysis.other is not None:
            reverted = self._revert(time, analysis, stamped=report.stamped)
            if reverted is not None:
                log.info("the estimate before a jump is restored at %.2f s", time)
                return reverted
            tags = [landmark.tag for landmark in analysis.with_verdict(Verdict.ELSEWHERE)]
            sheets = frozenset(self._sheets[tag] for tag in tags)
            claim = Claim(time, analysis.other.pose, analysis.other.covariance, sheets)
            if self._relocation.consider(claim, self.track):
                log.info("an agent is relocated at %.2f s", time)
                self.restart(claim.time, claim.pose, claim.covariance)
        return analysis, state

    def _compare(
        self, before: JointFilter, prediction: Prediction, time: float, analysis: ImageAnalysis
    ) -> None:
        """Keep the filter before an image that moved the estimate farther than the gate is wide.

        If that image was wrong, the gate rejects the correct ones after it. The filter is kept
        until as many landmarks agree with the image as are required to relocate an agent.

        Args:
            before: The filter before the image.
            prediction: By that filter.
            time: Of the exposure, s.
            analysis: Of the image.
        """
        after = _prediction(self.at(time), self._filter.camera_turn)
        landmarks = frozenset(self._sheets[tag] for tag, _ in analysis.views)
        earlier = self._earlier
        if surprise(prediction.pose, 0.0, after.pose, after.covariance) > MAX_SURPRISE:
            earlier = Earlier(before if earlier is None else earlier.filter, landmarks)
        elif earlier is not None:
            earlier = Earlier(earlier.filter, earlier.landmarks | landmarks)
        confirmed = earlier is not None and len(earlier.landmarks) >= self._relocation.least
        self._earlier = None if confirmed else earlier

    def _revert(
        self, time: float, analysis: ImageAnalysis, *, stamped: bool
    ) -> tuple[ImageAnalysis, AgentState] | None:
        """Return to the filter before a jump if consecutive images agree only with that one.

        Args:
            time: Of the exposure, s.
            analysis: Of an image whose landmarks were all rejected.
            stamped: Whether the image has a timestamp.

        Returns:
            The image's analysis by that filter, and the state that it predicted; else None.
        """
        if self._earlier is None or self._analyzer is None:
            return None
        earlier = self._earlier.filter
        state = predict(earlier.anchor, time, self.track, self._ground)
        tags = np.array([tag for tag, _, _ in analysis.detected])
        corners = np.array([corners for _, corners, _ in analysis.detected])
        prediction = _prediction(state, earlier.camera_turn)
        analysis = self._analyzer.evaluate(tags, corners, prediction)
        if not analysis.accepted:
            return None
        images = self._earlier.images + 1
        if images < MIN_IMAGES:
            self._earlier = self._earlier._replace(images=images)
            return None
        self._relocation.forget()
        self._earlier = Earlier(earlier, frozenset(self._sheets[tag] for tag, _ in analysis.views))
        self._filter = earlier.copied()
        self.anchor = self._filter.anchor
        self.add_views(time, analysis.views, stamped=stamped)
        return analysis, state

    def add_views(
        self, time: float, views: Sequence[tuple[int, View]], *, stamped: bool = True
    ) -> None:
        """Add the tags, with their numbers, that were accepted in an image taken at `time`, s.

        An image that is not newer than the newest one is ignored.
        """
        if time <= self.anchor.time:
            return
        self._filter.advance(time, self.track)
        if views:
            self._filter.update(views, self.track, stamped=stamped)
        self.anchor = self._filter.anchor

    def restart(self, time: float, pose: Pose, covariance: Array) -> None:
        """Continue from a pose, since the previous ones were wrong."""
        self._filter.advance(time, self.track)
        self._filter.move(pose, covariance)
        self.anchor = self._filter.anchor
        self._earlier = None

    def _measure_floor(self, image: Image | None, time: float, *, needed: bool) -> bool:
        """Correct the odometry up to an image by the floor; return whether that was possible."""
        if self._floor is None or image is None:
            return False
        bias = self.anchor.yaw_bias
        measured = self._floor.measure(
            image,
            time,
            self.track,
            ground=self._ground + float(self.anchor.mean[Z]),
            yaw_bias=bias,
            camera_turn=self._filter.camera_turn,
            needed=needed,
        )
        if measured is None:
            return False
        self.track.correct(*measured, yaw_bias=bias)
        return True


def _prediction(state: AgentState, camera_turn: Array) -> Prediction:
    rotation = state.rotation
    return Prediction(
        pose=Pose(rotation, state.position),
        covariance=state.covariance[np.ix_([0, 1, 3], [0, 1, 3])],
        motion=Motion(state.velocity @ rotation, np.array([0.0, 0.0, state.yaw_rate])),
        camera_turn=camera_turn,
    )


MIN_IMAGES: Final = 4  # consecutive ones that must agree
MAX_DISTANCE: Final = 0.15  # m between their positions
MAX_TURN: Final = math.radians(10.0)  # rad between their headings
MAX_TIME: Final = 6.0  # s between the first and the last
MIN_LANDMARKS: Final = 2  # that must agree, if the map has more than one


class Earlier(NamedTuple):
    """The filter before an image that moved its estimate far, and may be wrong."""

    filter: JointFilter
    landmarks: frozenset[str]  # names of those that agree with the image
    images: int = 0  # consecutive ones that agree with this filter only


class Claim(NamedTuple):
    """Pose of the agent according to one image alone."""

    time: float  # of its exposure, s
    pose: Pose  # body in the map
    covariance: Array  # (6, 6) of a rotation and then a shift in the body's own frame
    landmarks: frozenset[str]  # names of those in the image


class Relocation:
    """Collects the claims of images whose tags were all rejected, until enough of them agree.

    Images of one landmark always agree with each other, also if it is not where the map has it. So
    two landmarks must.

    Args:
        landmarks: Number of those of the map.

    Attributes:
        least: Number of landmarks that must agree.
    """

    def __init__(self, landmarks: int) -> None:
        self.least = min(MIN_LANDMARKS, landmarks)
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
        same = [old for old in self._claims if old.landmarks == claim.landmarks]
        if len(same) >= MIN_IMAGES:
            self._claims = [old for old in self._claims if old is not same[0]]
        self._claims.append(claim)
        landmarks = frozenset[str]().union(*(claim.landmarks for claim in self._claims))
        if len(self._claims) < MIN_IMAGES or len(landmarks) < self.least:
            return False
        self._claims.clear()
        return True


def _agree(old: Claim, new: Claim, track: OdometryTrack) -> bool:
    motion = track.between(old.time, new.time)
    yaw = old.pose.yaw
    turned = new.pose.yaw - yaw - motion.turn
    x, y, _ = (new.pose.position - old.pose.position).tolist()
    apart = complex(x, y) - motion.shift * cmath.rect(1.0, yaw)
    return abs(apart) < MAX_DISTANCE and abs(math.remainder(turned, math.tau)) < MAX_TURN
