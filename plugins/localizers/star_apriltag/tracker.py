"""One agent's poses: odometry between images, tags in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import gtsam

from star_apriltag.dead_reckoning import Belief, Known, carried, carry, standing, travel
from star_apriltag.floor_odometry import Floor
from star_apriltag.odometry_calibration import Calibration, Place
from star_apriltag.odometry_track import Motion, Track
from star_apriltag.smoother import Node, Smoother
from star_apriltag.vision.body_pose import AT_REST, View
from star_apriltag.vision.body_pose import Motion as BodyMotion
from star_core import Agent, Array, Image

NODE_EVERY: Final = 0.5  # s: without tags the graph goes on all the same
NOWHERE: Final = Motion(0j, 0.0, 0.0, 0.0, 0.0, 0.0)


class Tracker:
    """Follows one agent.

    Args:
        agent: Where it stands before take-off.
        smoother: To optimise with.

    Attributes:
        track: Its odometry; the caller fills it.
        calibration: What was learnt of that odometry.
    """

    def __init__(self, agent: Agent, smoother: Smoother) -> None:
        self.track = Track()
        self.calibration = Calibration()
        self._smoother = smoother
        self._ground = float(agent.start[2])  # z of the odometry frame, m
        first = standing(agent)
        smoother.start(first.time, first.pose, first.covariance)

    @property
    def node(self) -> Node:
        """The newest pose that was optimised."""
        return self._smoother.node

    @property
    def known(self) -> Known:
        """What is known of the agent by now."""
        return Known(self.node, self.calibration.scale, self.calibration.yaw_bias)

    def measure(self, floor: Floor, image: Image, time: float) -> bool:
        """Correct the odometry up to an image taken at `time`, s; return whether it could be.

        Raises:
            ValueError: It is no image of the agent's camera.
        """
        bias = self.calibration.yaw_bias
        passage = floor.look(
            image,
            time,
            self.track,
            ground=self._ground,
            yaw_bias=bias,
            camera_turn=self.camera_turn,
        )
        if passage is None:
            return False
        self.track.correct(passage.begin, passage.end, passage.shift, yaw_bias=bias)
        return True

    @property
    def camera_turn(self) -> Array:
        """(3, 3) by which the camera turned out to be turned against its mounting, in its frame."""
        return self._smoother.camera_turn

    def at(self, time: float) -> Belief:
        """Return where it is at `time`, s, no earlier than the newest node."""
        return carry(self.known, time, self.track, self._ground)

    def see(self, time: float, views: Sequence[View], moving: BodyMotion) -> None:
        """Take in the tags that passed the gate in an image taken at `time`, s.

        An image that is no later than the newest node is passed over.
        """
        if time <= self.node.time:
            return
        self._add(time, views, moving)
        if views:
            node = self._smoother.node
            x, y, _ = node.pose.translation()
            spread = carried(node, 0j, NOWHERE)
            self.calibration.learn(
                Place(
                    time,
                    complex(x, y),
                    node.pose.rotation().yaw(),
                    math.sqrt(max(spread[0, 0], spread[1, 1])),
                    math.sqrt(spread[3, 3]),
                ),
                self.track,
            )

    def go_on(self, time: float) -> None:
        """Keep the graph's chain whole up to `time`, s, though nothing is seen."""
        while time - self.node.time > NODE_EVERY:
            self._add(self.node.time + NODE_EVERY, (), AT_REST)

    def restart(self, time: float, pose: gtsam.Pose3, covariance: Array) -> None:
        """Begin anew at a pose: what was believed before was wrong."""
        self._smoother.start(time, pose, covariance)
        self.calibration.forget_places()

    def _add(self, time: float, views: Sequence[View], moving: BodyMotion) -> None:
        leg = travel(self.known, time, self.track)
        stance = self.track.at(time)
        level = gtsam.Rot3.Ypr(0.0, stance.pitch, stance.roll)
        self._smoother.add(time, leg, level, self._ground + stance.height, views, moving)
