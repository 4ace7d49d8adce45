"""Where one agent is: odometry between images, tags in them."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import gtsam
import numpy as np

from star_apriltag.calibration import Calibration, Place
from star_apriltag.smoother import Leg, Node, Smoother
from star_apriltag.track import Motion, Track
from star_apriltag.vision.pose import AT_REST, HEIGHT_DEVIATION, View
from star_apriltag.vision.pose import Motion as BodyMotion
from star_core import Array

NODE_EVERY: Final = 0.5  # s: without tags the graph goes on all the same
START_DEVIATION: Final = 0.05  # m: how well an agent is put where the mission says it starts
START_TILT: Final = 0.05  # rad: a floor is not quite level
START_YAW: Final = math.radians(3.0)  # rad

# What odometry is good for between two nodes.
WAY: Final = 0.025  # m/√m
SWAY: Final = 0.008  # m/√s
LEAST: Final = 0.0005  # m
RISE: Final = 0.01  # m/√s
YAW: Final = math.radians(0.2)  # rad/√s
TILT: Final = math.radians(0.3)  # rad/√s
LEAST_TILT: Final = math.radians(0.06)  # rad

NOWHERE: Final = Motion(0j, 0.0, 0.0, 0.0)


class Belief(NamedTuple):
    """Where the agent is believed to be at one time.

    Attributes:
        time: s.
        position: (3,) in the map, m.
        yaw: rad.
        roll: rad.
        pitch: rad.
        velocity: (3,) in the map, m/s.
        yaw_rate: rad/s.
        covariance: (4, 4) of x, y, z and yaw: m and rad.
    """

    time: float
    position: Array
    yaw: float
    roll: float
    pitch: float
    velocity: Array
    yaw_rate: float
    covariance: Array


class Tracker:
    """Follows one agent.

    Args:
        start: Where it stands before take-off, map frame, m.
        yaw: Its heading there, rad.
        smoother: To optimise with.

    Attributes:
        track: Its odometry; the caller fills it.
        calibration: What was learnt of that odometry.
    """

    def __init__(self, start: Sequence[float], yaw: float, smoother: Smoother) -> None:
        self.track = Track()
        self.calibration = Calibration()
        self._smoother = smoother
        self._ground = float(start[2])  # z of the odometry frame, m
        turn = [START_TILT, START_TILT, START_YAW]
        deviations = np.array([*turn, START_DEVIATION, START_DEVIATION, HEIGHT_DEVIATION])
        pose = gtsam.Pose3(gtsam.Rot3.Yaw(yaw), np.array(start, float))
        smoother.start(0.0, pose, np.diag(deviations**2))

    @property
    def node(self) -> Node:
        """The newest pose that was optimised."""
        return self._smoother.node

    @property
    def camera_turn(self) -> Array:
        """(3, 3) by which the camera turned out to be turned against its mounting, in its frame."""
        return self._smoother.camera_turn

    def at(self, time: float) -> Belief:
        """Return where it is at `time`, s, no earlier than the newest node."""
        return carry(self._smoother.node, time, self.track, self._ground, self.calibration)

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
            spread = _carried(node, 0j, NOWHERE)
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
        leg = travel(self.node.time, time, self.track, self.calibration)
        stance = self.track.at(time)
        level = gtsam.Rot3.Ypr(0.0, stance.pitch, stance.roll)
        self._smoother.add(time, leg, level, self._ground + stance.height, views, moving)


def carry(node: Node, time: float, track: Track, ground: float, calibration: Calibration) -> Belief:
    """Return where an agent is at `time`, s, that was at a node and then followed its odometry.

    Args:
        node: Where it was.
        time: No earlier than the node's, s.
        track: Its odometry.
        ground: z of its odometry frame in the map, m.
        calibration: Of that odometry.
    """
    motion = track.between(node.time, time, scale=calibration.scale, yaw_bias=calibration.yaw_bias)
    stance = track.at(time)
    yaw = node.pose.rotation().yaw()
    way = motion.shift * cmath.rect(1.0, yaw)
    x, y, _ = node.pose.translation()
    ahead = complex(stance.velocity[0], stance.velocity[1]) * calibration.scale
    ahead *= cmath.rect(1.0, yaw + motion.turn)
    return Belief(
        time=time,
        position=np.array([x + way.real, y + way.imag, ground + stance.height]),
        yaw=yaw + motion.turn,
        roll=stance.roll,
        pitch=stance.pitch,
        velocity=np.array([ahead.real, ahead.imag, stance.velocity[2]]),
        yaw_rate=stance.yaw_rate - calibration.yaw_bias,
        covariance=_carried(node, way, motion),
    )


def travel(begin: float, end: float, track: Track, calibration: Calibration) -> Leg:
    """Return what odometry says of the way from `begin` to `end`, s."""
    motion = track.between(begin, end, scale=calibration.scale, yaw_bias=calibration.yaw_bias)
    first, last = track.at(begin), track.at(end)
    before = gtsam.Pose3(
        gtsam.Rot3.Ypr(0.0, first.pitch, first.roll), np.array([0.0, 0.0, first.height])
    )
    after = gtsam.Pose3(
        gtsam.Rot3.Ypr(motion.turn, last.pitch, last.roll),
        np.array([motion.shift.real, motion.shift.imag, last.height]),
    )
    return Leg(before.between(after), _deviations(motion))


def _deviations(motion: Motion) -> Array:
    """(6,) of turn and shift, over a motion."""
    passed = math.sqrt(motion.duration)
    tilt = TILT * passed + LEAST_TILT
    aside = math.sqrt(WAY**2 * motion.length + SWAY**2 * motion.duration) + LEAST
    return np.array([tilt, tilt, YAW * passed, aside, aside, RISE * passed + LEAST])


def _carried(node: Node, way: complex, motion: Motion) -> Array:
    """The (4, 4) covariance of x, y, z and yaw after a motion by `way` in the map."""
    rotation = node.pose.rotation().matrix()
    by_tangent = np.zeros((4, 6))
    by_tangent[:3, 3:] = rotation
    by_tangent[3, :3] = rotation[2]
    by_tangent[0] -= way.imag * by_tangent[3]
    by_tangent[1] += way.real * by_tangent[3]
    covariance: Array = by_tangent @ node.covariance @ by_tangent.T
    turn, aside, rise = _deviations(motion)[[2, 3, 5]]
    across = np.array([-way.imag, way.real, 0.0]) / math.sqrt(3)  # the turn came about on the way
    covariance[:3, :3] += np.diag([aside**2, aside**2, rise**2]) + turn**2 * np.outer(
        across, across
    )
    covariance[3, 3] += turn**2
    return covariance
