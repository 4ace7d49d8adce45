"""Follows one agent: what it hears and sees, and where it is then."""

from __future__ import annotations

import logging
from typing import Final, NamedTuple, Protocol

import gtsam
import numpy as np

from star_apriltag.dead_reckoning import Belief, Known
from star_apriltag.floor_odometry import Floor
from star_apriltag.relocation import Claim, Relocation
from star_apriltag.smoother import Smoother
from star_apriltag.tracker import Tracker
from star_apriltag.vision.prediction import Prediction
from star_apriltag.vision.tag_measurement import Eye, Look
from star_core import Agent, Array, Image, Odometry, Pose, Rows, Tag

log = logging.getLogger(__name__)

BEHIND: Final = 0.35  # s beyond the latency, by which the graph trails where nothing is seen


class Settings(NamedTuple):
    """Options of the estimators; see the localizer's schema for what they mean."""

    method: str
    max_tags_per_landmark: int
    latency: float  # s
    mounting_std: float  # rad
    lag: float  # s
    guided_matching: bool
    floor_odometry: bool


class Sight(NamedTuple):
    """An image, or the tags found in one on board.

    Attributes:
        row: Of the agent.
        taken: When it was taken, s.
        image: None if tags were found on board.
        tags: (K,) numbers of those.
        corners: (K, 4, 2) px.
        arrived: When it arrived, s; None if that does not matter.
    """

    row: int
    taken: float
    image: Image | None
    tags: Rows
    corners: Array
    arrived: float | None = None


class Follower(Protocol):
    """What the localizer asks of a way to follow one agent."""

    def hear(self, odometry: Odometry, rows: Rows, *, motors: bool) -> None:
        """Take in those samples of the odometry that are this agent's."""

    def look(self, sight: Sight) -> tuple[Look, Belief] | None:
        """Take in an image; return what it said and where the agent was believed to be then.

        Raises:
            ValueError: It is no image of the agent's camera.
        """

    def go_on(self, now: float) -> None:
        """It is `now`, s, and there is nothing else to be seen."""

    @property
    def known(self) -> Known:
        """What is known of the agent by now."""


class Smoothed:
    """Follows one agent with a fixed-lag smoother.

    Args:
        agent: With its camera, or without: then it has odometry only.
        landmarks: The map.
        targets: Tags to be found; only their numbers and sizes are used.
        settings: Options.
    """

    def __init__(
        self,
        agent: Agent,
        landmarks: tuple[Tag, ...],
        targets: tuple[Tag, ...],
        settings: Settings,
    ) -> None:
        self._behind = settings.latency + BEHIND
        self._eye = self._floor = None
        mounting = Pose(np.eye(3), np.zeros(3))
        if agent.camera is not None:
            self._eye = Eye(
                agent.camera,
                {tag.id: tag for tag in landmarks},
                {tag.id: tag.size for tag in targets},
                guided=settings.guided_matching,
            )
            mounting = self._eye.lens.mounting
            self._floor = Floor(self._eye.lens) if settings.floor_odometry else None
        smoother = Smoother(mounting, mounting_std=settings.mounting_std, lag=settings.lag)
        self.tracker = Tracker(agent, smoother)
        self._relocation = Relocation()

    def hear(self, odometry: Odometry, rows: Rows, *, motors: bool) -> None:
        """Take in those samples of the odometry that are this agent's."""
        self.tracker.track.add(odometry, rows, motors=motors)

    def go_on(self, now: float) -> None:
        """It is `now`, s, and there is nothing else to be seen."""
        self.tracker.go_on(now - self._behind)

    @property
    def known(self) -> Known:
        """What is known of the agent by now."""
        return self.tracker.known

    def look(self, sight: Sight) -> tuple[Look, Belief] | None:
        """Take in an image; return what it said and where the agent was believed to be then."""
        tracker = self.tracker
        if self._eye is None or not sight.taken > tracker.node.time:
            return None
        measured = False
        if sight.image is not None and self._floor is not None:
            measured = tracker.measure(self._floor, sight.image, sight.taken)
        belief = tracker.at(sight.taken)
        prediction = _prediction(belief, tracker.camera_turn)
        if sight.image is None:
            look = self._eye.consider(sight.tags, sight.corners, prediction)
        else:
            look = self._eye.look(sight.image, prediction)
        if look.accepted:
            self._relocation.forget()
        if look.views:
            tracker.see(sight.taken, look.views, prediction.motion)
        elif look.other is not None:
            pose = gtsam.Pose3(gtsam.Rot3(look.other.pose.rotation), look.other.pose.position)
            claim = Claim(sight.taken, pose, look.other.covariance)
            if (agreed := self._relocation.consider(claim, tracker.track)) is not None:
                log.info("an agent is found again elsewhere at %.2f s", sight.taken)
                tracker.restart(agreed.time, agreed.pose, agreed.covariance)
                measured = False
        if measured and not look.views:
            tracker.see(sight.taken, (), prediction.motion)
        return look, belief


def _prediction(belief: Belief, camera_turn: Array) -> Prediction:
    rotation = gtsam.Rot3.Ypr(belief.yaw, belief.pitch, belief.roll).matrix()
    return Prediction(
        pose=Pose(rotation, belief.position),
        covariance=belief.covariance[np.ix_([0, 1, 3], [0, 1, 3])],
        roll=belief.roll,
        pitch=belief.pitch,
        height=float(belief.position[2]),
        velocity=belief.velocity @ rotation,
        rates=np.array([0.0, 0.0, belief.yaw_rate]),
        camera_turn=camera_turn,
    )
