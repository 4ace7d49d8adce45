"""Localizer ``apriltag``: odometry, corrected by AprilTags whose places are known."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import gtsam
import numpy as np

from star_apriltag.relocation import Claim, Relocation
from star_apriltag.smoother import Smoother
from star_apriltag.tracker import Belief, Tracker
from star_apriltag.vision.look import Eye, Look
from star_apriltag.vision.prediction import Prediction
from star_apriltag.vision.rigid import Pose
from star_core import (
    Agent,
    Array,
    Estimate,
    Image,
    Odometry,
    Rows,
    Scene,
    Sightings,
    Tag,
    Telemetry,
    Transform,
)

log = logging.getLogger(__name__)

BEHIND: Final = 0.5  # s, by which the graph trails where nothing is seen: images may still come


class Sight(NamedTuple):
    """An image, or the tags found in one on board."""

    row: int
    taken: float
    image: Image | None
    tags: Rows
    corners: Array


class Follower:
    """One agent: what it saw and where it is.

    Args:
        agent: With its camera, or without: then it has odometry only.
        landmarks: The map.
        targets: Tags to be found; only their numbers and sizes are used.
        camera_deviation: How wrong the camera's rotation may be, rad.
        lag: For how long poses stay in the graph, s.
    """

    def __init__(
        self,
        agent: Agent,
        landmarks: tuple[Tag, ...],
        targets: tuple[Tag, ...],
        *,
        camera_deviation: float,
        lag: float,
    ) -> None:
        self._eye = None
        mounting = Pose(np.eye(3), np.zeros(3))
        if agent.camera is not None:
            self._eye = Eye(
                agent.camera,
                {tag.id: tag for tag in landmarks},
                {tag.id: tag.size for tag in targets},
            )
            mounting = self._eye.lens.mounting
        smoother = Smoother(mounting, camera_deviation=camera_deviation, lag=lag)
        self.tracker = Tracker(agent.start, agent.yaw, smoother)
        self._relocation = Relocation()

    def look(self, sight: Sight) -> tuple[Look, Belief] | None:
        """Take in an image; return what it said and where the agent was believed to be then."""
        tracker = self.tracker
        if self._eye is None or not sight.taken > tracker.node.time:
            return None
        belief = tracker.at(sight.taken)
        prediction = _prediction(belief, tracker.camera_turn)
        if sight.image is None:
            look = self._eye.consider(sight.tags, sight.corners, prediction)
        else:
            try:
                look = self._eye.look(sight.image, prediction)
            except ValueError as error:
                log.warning("an image is passed over: %s", error)
                return None
        accepted = [seen.view for seen in look.accepted if seen.view is not None]
        if accepted:
            self._relocation.forget()
            tracker.see(sight.taken, accepted, prediction.motion)
        elif look.other is not None:
            pose = gtsam.Pose3(gtsam.Rot3(look.other.pose.rotation), look.other.pose.position)
            claim = Claim(sight.taken, pose, look.other.covariance)
            if (agreed := self._relocation.consider(claim, tracker.track)) is not None:
                log.info("an agent is found again elsewhere at %.2f s", sight.taken)
                tracker.restart(agreed.time, agreed.pose, agreed.covariance)
        return look, belief


class AprilTag:
    """Follows every agent, and says where its odometry frame lies in the map.

    Nothing is sent to the drones: each flies in its own odometry frame, and `map_from_odom` moves.

    Args:
        scene: Agents with their cameras, the map.
        tags_per_landmark: Of each landmark so many tags are used.
        latency: From taking an image to its arrival, for images that do not say when, s.
        camera_deviation: How wrong the cameras' rotations may be, rad.
        survey: What the map's places are good for, m: no estimate is surer than that.
        lag: For how long poses stay in the graph, s.
        worst: Deviation of a position, along its worst direction, with which an agent is still fit
            to fly, m.
        stale: Age past which an agent's report is not flown on, s.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        tags_per_landmark: int,
        latency: float,
        camera_deviation: float,
        survey: float,
        lag: float,
        worst: float,
        stale: float,
    ) -> None:
        landmarks = _first_of_each(scene.world.landmarks, tags_per_landmark)
        self._followers = [
            Follower(
                agent, landmarks, scene.world.targets, camera_deviation=camera_deviation, lag=lag
            )
            for agent in scene.agents
        ]
        self._latency = latency
        self._survey = survey
        self._worst = worst
        self._stale = stale
        self._frames = Transform(
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents]),
        )

    def locate(self, telemetry: Telemetry) -> Estimate:
        odometry = _odometry(telemetry)
        for row, follower in enumerate(self._followers):
            follower.tracker.track.add(odometry, np.flatnonzero(odometry.agent == row))
        sightings = []
        for sight in _sights(telemetry, self._latency):
            looked = self._followers[sight.row].look(sight)
            if looked is not None:
                sightings += _sightings(sight, *looked)
        now = telemetry.time
        beliefs = []
        for follower in self._followers:
            follower.tracker.go_on(now - BEHIND)
            beliefs.append(follower.tracker.at(max(now, follower.tracker.node.time)))
        return self._estimate(telemetry, beliefs, sightings)

    def _estimate(
        self, telemetry: Telemetry, beliefs: list[Belief], sightings: list[Sightings]
    ) -> Estimate:
        position = np.array([belief.position for belief in beliefs])
        yaw = np.array([math.remainder(belief.yaw, math.tau) for belief in beliefs])
        covariance = np.array([belief.covariance[:3, :3] for belief in beliefs])
        covariance += np.eye(3) * self._survey**2
        reported = np.isfinite(telemetry.position.sum(axis=1) + telemetry.attitude.sum(axis=1))
        lies = yaw - _heading(telemetry.attitude)
        turned = Transform(lies, np.zeros_like(position)).turn(telemetry.position)
        self._frames = Transform(
            np.where(reported, lies, self._frames.yaw),
            np.where(reported[:, None], position - turned, self._frames.translation),
        )
        fit = np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]) <= self._worst
        return Estimate(
            time=telemetry.time,
            position=position,
            velocity=np.array([belief.velocity for belief in beliefs]),
            yaw=yaw,
            covariance=covariance,
            valid=fit & reported & (telemetry.age <= self._stale),
            map_from_odom=self._frames,
            sightings=_joined(sightings),
        )


def _first_of_each(tags: tuple[Tag, ...], most: int) -> tuple[Tag, ...]:
    """The first few tags of each landmark."""
    used: dict[str, int] = {}
    kept = []
    for tag in tags:
        used[tag.of] = used.get(tag.of, 0) + 1
        if used[tag.of] <= most:
            kept.append(tag)
    return tuple(kept)


def _odometry(telemetry: Telemetry) -> Odometry:
    """The odometry stream; from the state itself for agents that stream none."""
    streamed = telemetry.odometry
    silent = np.setdiff1d(np.arange(len(telemetry.age)), streamed.agent)
    if not len(silent):
        return streamed
    heading = _heading(telemetry.attitude)[silent]
    level = Transform(heading, np.zeros((len(silent), 3))).turn_back(telemetry.velocity[silent])
    x, y, z, w = telemetry.attitude[silent].T
    return Odometry(
        agent=np.concatenate([streamed.agent, silent]),
        time=np.concatenate([streamed.time, np.full(len(silent), telemetry.time)]),
        velocity=np.concatenate([streamed.velocity, level]),
        yaw_rate=np.concatenate([streamed.yaw_rate, np.zeros(len(silent))]),
        roll=np.concatenate(
            [streamed.roll, np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))]
        ),
        pitch=np.concatenate([streamed.pitch, np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))]),
        height=np.concatenate([streamed.height, telemetry.position[silent, 2]]),
    )


def _sights(telemetry: Telemetry, latency: float) -> Iterator[Sight]:
    """Every image and every batch of tags, in the order in which they were taken."""
    sights = []
    frames, found = telemetry.frames, telemetry.detections
    nothing = (np.zeros(0, np.int64), np.zeros((0, 4, 2)))
    taken = np.where(np.isfinite(frames.taken), frames.taken, frames.arrived - latency)
    for row, time, image in zip(frames.agent.tolist(), taken.tolist(), frames.image, strict=True):
        sights.append(Sight(row, time, image, *nothing))
    taken = np.where(np.isfinite(found.taken), found.taken, found.arrived - latency)
    for row, time in sorted(set(zip(found.agent.tolist(), taken.tolist(), strict=True))):
        rows = (found.agent == row) & (taken == time)
        sights.append(Sight(row, time, None, found.tag[rows], found.corners[rows]))
    yield from sorted(sights, key=lambda sight: (sight.taken, sight.row))


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


def _sightings(sight: Sight, look: Look, belief: Belief) -> list[Sightings]:
    """Targets seen in one image, in the map."""
    rotation = gtsam.Rot3.Ypr(belief.yaw, belief.pitch, belief.roll).matrix()
    seen = []
    for target in look.targets:
        away = rotation @ target.pose.position
        turning = np.array([-away[1], away[0], 0.0])
        covariance = rotation @ target.covariance @ rotation.T + belief.covariance[:3, :3]
        cross = np.outer(belief.covariance[:3, 3], turning)
        covariance += cross + cross.T + belief.covariance[3, 3] * np.outer(turning, turning)
        ahead = rotation @ target.pose.rotation[:, 0]
        seen.append(
            Sightings(
                agent=np.array([sight.row]),
                tag=np.array([target.tag]),
                time=np.array([sight.taken]),
                position=(belief.position + away)[None],
                yaw=np.array([math.atan2(ahead[1], ahead[0])]),
                covariance=covariance[None],
            )
        )
    return seen


def _joined(sightings: list[Sightings]) -> Sightings:
    if not sightings:
        return Sightings.none()
    return Sightings(
        **{
            name: np.concatenate([getattr(one, name) for one in sightings])
            for name in Sightings.__dataclass_fields__
        }
    )


def _heading(attitude: Array) -> Array:
    """The yaw of (N, 4) unit quaternions, rad."""
    x, y, z, w = attitude.T
    yaw: Array = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return yaw
