"""Where agents saw targets: tags that their cameras found on board, put into the map."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from star_core import (
    Array,
    CameraModel,
    Pose,
    Scene,
    Sightings,
    Telemetry,
    Transform,
    rotation_from_quaternion,
    rotation_from_vector,
)
from star_flow.drift import heading_variance
from star_flow.way import Way

if TYPE_CHECKING:
    from star_flow.square import LastKnownTransform

CORNER: Final = 0.3  # px, deviation of a corner in u and in v
DIRECTION: Final = math.radians(1.0)  # rad, left by a camera's mounting and an agent's attitude

log = logging.getLogger(__name__)


class Seen(NamedTuple):
    """A target in one image; the attributes are those of `Sightings`."""

    agent: int
    tag: int
    time: float
    position: Array
    yaw: float
    covariance: Array


class Lookout:
    """Keeps where agents were, and says where they saw targets.

    A target is as far off as the agent that saw it is from where it believes to be: nothing that
    is known of the world corrects it. No image is looked at. All of one counts as taken at once;
    that its rows are exposed one after the other moves a target by some millimetres.

    Args:
        scene: Agents with their cameras. Of the world's targets the numbers and sizes of the tags
            are used, not the places.
        latency: From taking an image to its arrival, for tags that do not say when, s.
    """

    def __init__(self, scene: Scene, *, latency: float) -> None:
        self._scene = scene
        self._sizes = {tag.id: tag.size for tag in scene.world.targets}
        self._latency = latency
        self._way = Way()
        self._told = False
        self.idle = not self._sizes or not any(agent.camera for agent in scene.agents)

    def see(
        self, telemetry: Telemetry, map_from_odom: Transform, position: Array, covariance: Array
    ) -> Sightings:
        """Return the targets that were seen in what arrived.

        Args:
            telemetry: Of the tick.
            map_from_odom: Where the agents' odometry frames lie in the map.
            position: (N, 3) where the agents are now, map frame, m.
            covariance: (N, 3, 3) of that, m².
        """
        if self.idle:
            return Sightings.none()
        self._way.go_on(telemetry, position, covariance)
        if len(telemetry.frames.agent) and not self._told:
            self._told = True
            log.warning(
                "flow: no image is looked at, so no target is seen; use localizer apriltag, or a "
                "camera that finds tags on board: transport {use: sim, camera: {mode: geometric}}"
            )
        found = telemetry.detections
        taken = np.where(np.isfinite(found.taken), found.taken, found.arrived - self._latency)
        seen = []
        for k in np.flatnonzero(np.isin(found.tag, list(self._sizes))).tolist():
            row, tag = int(found.agent[k]), int(found.tag[k])
            one = self._seen(row, tag, float(taken[k]), found.corners[k], map_from_odom.yaw[row])
            seen += [] if one is None else [one]
        return _table(seen)

    def _seen(self, row: int, tag: int, taken: float, corners: Array, turned: float) -> Seen | None:
        """Return one target, or None where the agent's place is not known or no square fits."""
        camera, was = self._scene.agents[row].camera, self._way.at(row, taken)
        if camera is None or was is None:
            return None
        position, attitude, covariance = was
        level = rotation_from_vector(np.array([0.0, 0.0, turned]))
        body = Pose(level @ rotation_from_quaternion(attitude), position)
        model = CameraModel(camera)
        eye = body @ model.mounting
        square = _square(model, corners, self._sizes[tag], eye.rotation[2])
        if square is None:
            return None
        target = eye @ square.pose
        away = target.position - position
        aside = np.array([-away[1], away[0], 0.0])
        spread = eye.rotation @ square.covariance @ eye.rotation.T + covariance
        spread += heading_variance(taken) * np.outer(aside, aside)
        spread += DIRECTION**2 * (away @ away * np.eye(3) - np.outer(away, away))
        return Seen(row, tag, taken, target.position, target.yaw, spread)


def _square(
    model: CameraModel, corners: Array, size: float, up: Array
) -> LastKnownTransform | None:
    from star_flow.square import lying  # OpenCV, which a flight without targets does not need

    rays = model.undistort(corners)
    return lying(rays, size, up, CORNER / min(model.camera.matrix[:2]))


def _table(seen: list[Seen]) -> Sightings:
    if not seen:
        return Sightings.none()
    agent, tag, time, position, yaw, covariance = zip(*seen, strict=True)
    return Sightings(
        agent=np.array(agent),
        tag=np.array(tag),
        time=np.array(time),
        position=np.array(position),
        yaw=np.array(yaw),
        covariance=np.array(covariance),
    )
