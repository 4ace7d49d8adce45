"""State of an agent by its odometry since its newest optimized pose."""

from __future__ import annotations

import cmath
import math
from typing import Final, NamedTuple

import gtsam
import numpy as np

from star_apriltag.odometry_track import Motion, OdometryTrack
from star_apriltag.smoother import Leg, Node
from star_apriltag.vision.body_pose import HEIGHT_STD
from star_core import Agent, Array, Odometry, Rows

# Standard deviations of an agent's manual placement at its start.
START_STD: Final = 0.05  # m
START_TILT_STD: Final = 0.05  # rad: a floor is not quite level
START_YAW_STD: Final = math.radians(3.0)  # rad

# Standard deviations of odometry between two nodes.
PER_LENGTH: Final = 0.038  # m/√m; large, because errors by the floor are correlated
PER_TIME: Final = 0.007  # m/√s
SEEN_PER_LENGTH: Final = 0.006  # m/√m, measured by images
SEEN_PER_TIME: Final = 0.002  # m/√s, likewise
MIN_STD: Final = 0.0005  # m
HEIGHT_PER_TIME: Final = 0.01  # m/√s
YAW_PER_TIME: Final = math.radians(0.175)  # rad/√s
MIN_YAW_STD: Final = math.radians(0.01)  # rad
TILT_PER_TIME: Final = math.radians(0.3)  # rad/√s
MIN_TILT_STD: Final = math.radians(0.06)  # rad


class Anchor(NamedTuple):
    """Where dead reckoning begins, and the calibration of the odometry."""

    node: Node  # the newest pose
    scale: complex = 1.0  # factor of the odometry's velocities
    yaw_bias: float = 0.0  # subtracted from its yaw rates, rad/s


class AgentState(NamedTuple):
    """Estimated state of an agent at one time."""

    position: Array  # (3,) in the map, m
    yaw: float  # rad
    roll: float  # rad
    pitch: float  # rad
    velocity: Array  # (3,) in the map, m/s
    yaw_rate: float  # rad/s
    covariance: Array  # (4, 4) of x, y, z and yaw: m and rad

    @property
    def rotation(self) -> Array:
        """(3, 3) from the body to the map."""
        matrix: Array = gtsam.Rot3.Ypr(self.yaw, self.pitch, self.roll).matrix()
        return matrix


class DeadReckoner:
    """Predicts one agent's current state from `anchor`, which is replaced, and its odometry."""

    def __init__(self, agent: Agent) -> None:
        self._track = OdometryTrack()
        self._ground = float(agent.start[2])
        self.anchor = Anchor(start_node(agent))

    def add_odometry(self, odometry: Odometry, rows: Rows, *, motors: bool) -> None:
        """Add the agent's samples."""
        self._track.add(odometry, rows, motors=motors)

    def at(self, time: float) -> AgentState:
        """Return the state at `time`, s, or at that of the newest pose if that is later."""
        return predict(self.anchor, max(time, self.anchor.node.time), self._track, self._ground)


def start_node(agent: Agent) -> Node:
    """Return an agent's pose before take-off."""
    turn = [START_TILT_STD, START_TILT_STD, START_YAW_STD]
    deviations = np.array([*turn, START_STD, START_STD, HEIGHT_STD])
    pose = gtsam.Pose3(gtsam.Rot3.Yaw(agent.yaw), np.array(agent.start, float))
    return Node(0.0, pose, np.diag(deviations**2))


def predict(anchor: Anchor, time: float, track: OdometryTrack, ground: float) -> AgentState:
    """Return an agent's state at `time`, s, no earlier than the newest pose, by dead reckoning.

    `ground` is the z of its odometry frame in the map, m.
    """
    node = anchor.node
    motion = track.between(node.time, time, scale=anchor.scale, yaw_bias=anchor.yaw_bias)
    sample = track.at(time)
    yaw = node.pose.rotation().yaw()
    shift = motion.shift * cmath.rect(1.0, yaw)
    x, y, _ = node.pose.translation()
    velocity = complex(sample.velocity[0], sample.velocity[1]) * anchor.scale
    velocity *= cmath.rect(1.0, yaw + motion.turn)
    return AgentState(
        position=np.array([x + shift.real, y + shift.imag, ground + sample.height]),
        yaw=yaw + motion.turn,
        roll=sample.roll,
        pitch=sample.pitch,
        velocity=np.array([velocity.real, velocity.imag, sample.velocity[2]]),
        yaw_rate=sample.yaw_rate - anchor.yaw_bias,
        covariance=predicted_covariance(node, shift, motion),
    )


def odometry_leg(anchor: Anchor, end: float, track: OdometryTrack) -> Leg:
    """Return the motion from the newest pose to `end`, s, by odometry."""
    begin = anchor.node.time
    motion = track.between(begin, end, scale=anchor.scale, yaw_bias=anchor.yaw_bias)
    first, last = track.at(begin), track.at(end)
    before = gtsam.Pose3(
        gtsam.Rot3.Ypr(0.0, first.pitch, first.roll), np.array([0.0, 0.0, first.height])
    )
    after = gtsam.Pose3(
        gtsam.Rot3.Ypr(motion.turn, last.pitch, last.roll),
        np.array([motion.shift.real, motion.shift.imag, last.height]),
    )
    return Leg(before.between(after), _deviations(motion))


def predicted_covariance(node: Node, shift: complex, motion: Motion) -> Array:
    """Return the (4, 4) covariance of x, y, z and yaw after a motion by `shift` in the map."""
    rotation = node.pose.rotation().matrix()
    by_tangent = np.zeros((4, 6))
    by_tangent[:3, 3:] = rotation
    by_tangent[3, :3] = rotation[2]
    by_tangent[0] -= shift.imag * by_tangent[3]
    by_tangent[1] += shift.real * by_tangent[3]
    covariance: Array = by_tangent @ node.covariance @ by_tangent.T
    turn, aside, rise = _deviations(motion)[[2, 3, 5]]
    across = np.array([-shift.imag, shift.real, 0.0]) / math.sqrt(3)  # the turn grows on the way
    covariance[:3, :3] += np.diag([aside**2, aside**2, rise**2]) + turn**2 * np.outer(
        across, across
    )
    covariance[3, 3] += turn**2
    return covariance


def _deviations(motion: Motion) -> Array:
    """Return (6,) standard deviations of turn and shift, over a motion."""
    root = math.sqrt(motion.duration)
    tilt = TILT_PER_TIME * root + MIN_TILT_STD
    yaw = max(YAW_PER_TIME * root, MIN_YAW_STD)
    variance = PER_LENGTH**2 * motion.blind_length + PER_TIME**2 * motion.blind_duration
    variance += SEEN_PER_LENGTH**2 * (motion.length - motion.blind_length)
    variance += SEEN_PER_TIME**2 * (motion.duration - motion.blind_duration)
    aside = math.sqrt(max(variance, 0.0)) + MIN_STD
    return np.array([tilt, tilt, yaw, aside, aside, HEIGHT_PER_TIME * root + MIN_STD])
