"""Localizer ``apriltag``: odometry, corrected by AprilTags whose places are known."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import gtsam
import numpy as np

from star_apriltag.batch import Batched
from star_apriltag.feedback import Feedback
from star_apriltag.follower import Follower, Sight, Smoothed
from star_apriltag.reports import Reports, heading
from star_apriltag.tracker import Belief
from star_apriltag.vision.look import Look
from star_core import Estimate, Scene, Sightings, Tag, Telemetry, Transform

log = logging.getLogger(__name__)

AHEAD: Final = 0.02  # s, by which an image may be newer than the newest report


class AprilTag:
    """Follows every agent, and says where its odometry frame lies in the map.

    Nothing is sent to the drones unless asked for: each flies in its own odometry frame, and
    `map_from_odom` moves.

    Args:
        scene: Agents with their cameras, the map.
        method: ``smoother``, or ``batch`` as the original STAR has it.
        tags_per_landmark: Of each landmark so many tags are used.
        feedback: ``none``, or ``extpose`` to correct the agents' own estimators.
        latency: From taking an image to its arrival, for images that do not say when, s.
        camera_deviation: How wrong the cameras' rotations may be, rad.
        survey: What the map's places are good for, m: no estimate is surer than that.
        lag: For how long poses stay in the graph, s.
        worst: Deviation of a position, along its worst direction, with which an agent is still fit
            to fly, m.
        stale: Age past which an agent's report is not flown on, s.
    """

    def __init__(  # noqa: PLR0913 -- a mission's own options
        self,
        scene: Scene,
        *,
        method: str,
        tags_per_landmark: int,
        feedback: str,
        latency: float,
        camera_deviation: float,
        survey: float,
        lag: float,
        worst: float,
        stale: float,
    ) -> None:
        landmarks = _first_of_each(scene.world.landmarks, tags_per_landmark)
        self._followers: list[Follower] = [
            Batched(agent, landmarks)
            if method == "batch"
            else Smoothed(
                agent,
                landmarks,
                scene.world.targets,
                camera_deviation=camera_deviation,
                lag=lag,
                latency=latency,
            )
            for agent in scene.agents
        ]
        self._reports = Reports(len(scene.agents))
        self._latency = latency
        self._survey = survey
        self._worst = worst
        self._stale = stale
        self._frames = Transform(
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents]),
        )
        self._feedback = Feedback(self._frames) if feedback == "extpose" else None

    def locate(self, telemetry: Telemetry) -> Estimate:
        odometry = self._reports.complete(telemetry)
        for row, follower in enumerate(self._followers):
            follower.hear(odometry, np.flatnonzero(odometry.agent == row))
        sightings = []
        fixed = set()
        for sight in _sights(telemetry, self._latency):
            try:
                looked = self._followers[sight.row].look(sight)
            except ValueError as error:
                log.warning("an image of agent %d is passed over: %s", sight.row, error)
                continue
            if looked is not None:
                sightings += _sightings(sight, *looked)
                fixed |= {sight.row} if looked[0].accepted else set()
        beliefs = [follower.at(telemetry.time) for follower in self._followers]
        estimate = self._estimate(telemetry, beliefs, sightings)
        if self._feedback is None or not fixed:
            return estimate
        fixed -= self._reports.silent  # their velocities would hold the correction
        told = self._feedback.corrections(fixed, beliefs, estimate.map_from_odom, telemetry)
        return replace(estimate, corrections=told)

    def _estimate(
        self, telemetry: Telemetry, beliefs: list[Belief], sightings: list[Sightings]
    ) -> Estimate:
        position = np.array([belief.position for belief in beliefs])
        yaw = np.array([math.remainder(belief.yaw, math.tau) for belief in beliefs])
        covariance = np.array([belief.covariance[:3, :3] for belief in beliefs])
        covariance += np.eye(3) * self._survey**2
        reported = np.isfinite(telemetry.position.sum(axis=1) + telemetry.attitude.sum(axis=1))
        lies = yaw - heading(telemetry.attitude)
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


def _sights(telemetry: Telemetry, latency: float) -> Iterator[Sight]:
    """Every image and every batch of tags, in the order in which they were taken.

    One that says that it was taken later than now is left out: its clock is wrong.
    """
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
    known = (sight for sight in sights if sight.taken <= telemetry.time + AHEAD)
    yield from sorted(known, key=lambda sight: (sight.taken, sight.row))


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
