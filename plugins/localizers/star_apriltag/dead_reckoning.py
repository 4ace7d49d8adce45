"""Where an agent is by its odometry, since the newest pose that is known of it."""

from __future__ import annotations

import cmath
import math
from typing import Final, NamedTuple

import gtsam
import numpy as np

from star_apriltag.odometry_track import Motion, Track
from star_apriltag.smoother import Leg, Node
from star_apriltag.vision.body_pose import HEIGHT_DEVIATION
from star_core import Agent, Array, Odometry, Rows

# How an agent is put where the mission says that it starts.
START_DEVIATION: Final = 0.05  # m
START_TILT: Final = 0.05  # rad: a floor is not quite level
START_YAW: Final = math.radians(3.0)  # rad

# What odometry is good for between two nodes.
WAY: Final = 0.038  # m/√m; much, for the floor errs one way for as long as it is alike
SWAY: Final = 0.007  # m/√s
SEEN_WAY: Final = 0.006  # m/√m, where images measured it
SEEN_SWAY: Final = 0.002  # m/√s
LEAST: Final = 0.0005  # m
RISE: Final = 0.01  # m/√s
YAW: Final = math.radians(0.175)  # rad/√s
LEAST_YAW: Final = math.radians(0.01)  # rad
TILT: Final = math.radians(0.3)  # rad/√s
LEAST_TILT: Final = math.radians(0.06)  # rad


class Known(NamedTuple):
    """What is known of an agent, apart from what its odometry says since.

    Attributes:
        node: Its newest pose.
        scale: What velocities of its odometry are to be multiplied by.
        yaw_bias: What is to be taken from its yaw rates, rad/s.
    """

    node: Node
    scale: complex = 1.0
    yaw_bias: float = 0.0


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


class Reckoner:
    """Carries what is known of one agent on to now.

    Args:
        agent: Where it starts.

    Attributes:
        known: To be set when more is known.
    """

    def __init__(self, agent: Agent) -> None:
        self._track = Track()
        self._ground = float(agent.start[2])
        self.known = Known(standing(agent))

    def hear(self, odometry: Odometry, rows: Rows, *, motors: bool) -> None:
        """Take in those samples of the odometry that are this agent's."""
        self._track.add(odometry, rows, motors=motors)

    def at(self, time: float) -> Belief:
        """Return where it is at `time`, s, or at that of the newest pose if that is later."""
        return carry(self.known, max(time, self.known.node.time), self._track, self._ground)


def standing(agent: Agent) -> Node:
    """Return where an agent is before it takes off."""
    turn = [START_TILT, START_TILT, START_YAW]
    deviations = np.array([*turn, START_DEVIATION, START_DEVIATION, HEIGHT_DEVIATION])
    pose = gtsam.Pose3(gtsam.Rot3.Yaw(agent.yaw), np.array(agent.start, float))
    return Node(0.0, pose, np.diag(deviations**2))


def carry(known: Known, time: float, track: Track, ground: float) -> Belief:
    """Return where an agent is at `time` that then followed its odometry.

    Args:
        known: Of the agent.
        time: No earlier than its newest pose's, s.
        track: Its odometry.
        ground: z of its odometry frame in the map, m.
    """
    node = known.node
    motion = track.between(node.time, time, scale=known.scale, yaw_bias=known.yaw_bias)
    stance = track.at(time)
    yaw = node.pose.rotation().yaw()
    way = motion.shift * cmath.rect(1.0, yaw)
    x, y, _ = node.pose.translation()
    ahead = complex(stance.velocity[0], stance.velocity[1]) * known.scale
    ahead *= cmath.rect(1.0, yaw + motion.turn)
    return Belief(
        time=time,
        position=np.array([x + way.real, y + way.imag, ground + stance.height]),
        yaw=yaw + motion.turn,
        roll=stance.roll,
        pitch=stance.pitch,
        velocity=np.array([ahead.real, ahead.imag, stance.velocity[2]]),
        yaw_rate=stance.yaw_rate - known.yaw_bias,
        covariance=carried(node, way, motion),
    )


def travel(known: Known, end: float, track: Track) -> Leg:
    """Return what odometry says of the way from the newest pose to `end`, s."""
    begin = known.node.time
    motion = track.between(begin, end, scale=known.scale, yaw_bias=known.yaw_bias)
    first, last = track.at(begin), track.at(end)
    before = gtsam.Pose3(
        gtsam.Rot3.Ypr(0.0, first.pitch, first.roll), np.array([0.0, 0.0, first.height])
    )
    after = gtsam.Pose3(
        gtsam.Rot3.Ypr(motion.turn, last.pitch, last.roll),
        np.array([motion.shift.real, motion.shift.imag, last.height]),
    )
    return Leg(before.between(after), _deviations(motion))


def carried(node: Node, way: complex, motion: Motion) -> Array:
    """Return the (4, 4) covariance of x, y, z and yaw after a motion by `way` in the map."""
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


def _deviations(motion: Motion) -> Array:
    """(6,) of turn and shift, over a motion."""
    passed = math.sqrt(motion.duration)
    tilt = TILT * passed + LEAST_TILT
    variance = WAY**2 * motion.blind_length + SWAY**2 * motion.blind_duration
    variance += SEEN_WAY**2 * (motion.length - motion.blind_length)
    variance += SEEN_SWAY**2 * (motion.duration - motion.blind_duration)
    aside = math.sqrt(max(variance, 0.0)) + LEAST
    return np.array([tilt, tilt, max(YAW * passed, LEAST_YAW), aside, aside, RISE * passed + LEAST])
