"""Localizer ``apriltag``: odometry, corrected by AprilTags whose places are known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from star_apriltag.agent_estimator import Settings, Sight
from star_apriltag.agent_group import Heard
from star_apriltag.dead_reckoning import Belief, Reckoner
from star_apriltag.feedback import Feedback
from star_apriltag.report_odometry import Reports
from star_apriltag.worker_pool import Beside, suited
from star_core import Estimate, Scene, Sightings, Supervisor, Telemetry, Transform

AHEAD: Final = 0.02  # s, by which an image may be newer than the newest report


class AprilTag:
    """Follows every agent, and says where its odometry frame lies in the map.

    Nothing is sent to the drones unless asked for: each flies in its own odometry frame, and
    `map_from_odom` moves.

    Args:
        scene: Agents with their cameras, the map.
        settings: How to follow them.
        processes: In how many processes beside this one; None for what suits the machine.
        feedback: ``none``, or what the agents' own estimators are corrected with: ``extpose``,
            or ``extpos`` for positions only.
        survey_std: What the map's places are good for, m: no estimate is surer than that.
        max_position_std: Standard deviation of a position, along its worst direction, up to which
            an agent is located, m.
        max_report_age: Age past which an agent's report is not flown on, s.
    """

    def __init__(
        self,
        scene: Scene,
        settings: Settings,
        *,
        processes: int | None,
        feedback: str,
        survey_std: float,
        max_position_std: float,
        max_report_age: float,
    ) -> None:
        self._reckoners = [Reckoner(agent) for agent in scene.agents]
        self._reports = Reports(len(scene.agents))
        self._latency = settings.latency
        self._survey_std = survey_std
        self._max_position_std = max_position_std
        self._max_report_age = max_report_age
        self._frames = Transform(
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents]),
        )
        self._feedback = (
            None if feedback == "none" else Feedback(self._frames, turns=feedback == "extpose")
        )
        self._beside = Beside(scene, settings, suited(scene) if processes is None else processes)

    def close(self) -> None:
        """End the processes."""
        self._beside.close()

    def locate(self, telemetry: Telemetry) -> Estimate:
        odometry = self._reports.complete(telemetry)
        motors = telemetry.state & int(Supervisor.FLYING) != 0
        heard = Heard(telemetry.time, odometry, tuple(sights(telemetry, self._latency)), motors)
        learnt = self._beside.tick(heard)
        for row, known in learnt.known.items():
            self._reckoners[row].known = known
        for row, reckoner in enumerate(self._reckoners):
            rows = np.flatnonzero(odometry.agent == row)
            reckoner.hear(odometry, rows, motors=bool(motors[row]))
        beliefs = [reckoner.at(telemetry.time) for reckoner in self._reckoners]
        estimate = self._estimate(telemetry, beliefs, learnt.sightings)
        if self._feedback is None or not learnt.fixed:
            return estimate
        fixed = learnt.fixed - self._reports.silent  # their velocities would hold the correction
        told = self._feedback.corrections(fixed, beliefs, estimate.map_from_odom, telemetry)
        return replace(estimate, corrections=told)

    def _estimate(
        self, telemetry: Telemetry, beliefs: list[Belief], sightings: Sequence[Sightings]
    ) -> Estimate:
        position = np.array([belief.position for belief in beliefs])
        yaw = np.array([math.remainder(belief.yaw, math.tau) for belief in beliefs])
        covariance = np.array([belief.covariance[:3, :3] for belief in beliefs])
        covariance += np.eye(3) * self._survey_std**2
        reported = np.isfinite(telemetry.position.sum(axis=1) + telemetry.attitude.sum(axis=1))
        lies = yaw - telemetry.heading
        turned = Transform(lies, np.zeros_like(position)).turn(telemetry.position)
        self._frames = Transform(
            np.where(reported, lies, self._frames.yaw),
            np.where(reported[:, None], position - turned, self._frames.translation),
        )
        fit = np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]) <= self._max_position_std
        fit[self._beside.lost] = False
        return Estimate(
            time=telemetry.time,
            position=position,
            velocity=np.array([belief.velocity for belief in beliefs]),
            yaw=yaw,
            covariance=covariance,
            valid=fit & reported & (telemetry.age <= self._max_report_age),
            map_from_odom=self._frames,
            sightings=_joined(sightings),
        )


def sights(telemetry: Telemetry, latency: float) -> Iterator[Sight]:
    """Every image and every batch of tags, in the order in which they were taken.

    One that says that it was taken later than now is left out: its clock is wrong.
    """
    sights = []
    frames, found = telemetry.frames, telemetry.detections
    nothing = (np.zeros(0, np.int64), np.zeros((0, 4, 2)))
    taken = np.where(np.isfinite(frames.taken), frames.taken, frames.arrived - latency)
    for row, time, arrived, image in zip(
        frames.agent.tolist(),
        taken.tolist(),
        frames.arrived.tolist(),
        frames.image,
        strict=True,
    ):
        sights.append(Sight(row, time, image, *nothing, arrived))
    taken = np.where(np.isfinite(found.taken), found.taken, found.arrived - latency)
    for row, time in sorted(set(zip(found.agent.tolist(), taken.tolist(), strict=True))):
        rows = (found.agent == row) & (taken == time)
        arrived = float(found.arrived[rows].max())
        sights.append(Sight(row, time, None, found.tag[rows], found.corners[rows], arrived))
    known = (sight for sight in sights if sight.taken <= telemetry.time + AHEAD)
    yield from sorted(known, key=lambda sight: (sight.taken, sight.row))


def _joined(sightings: Sequence[Sightings]) -> Sightings:
    if not sightings:
        return Sightings.none()
    return Sightings(
        **{
            name: np.concatenate([getattr(one, name) for one in sightings])
            for name in Sightings.__dataclass_fields__
        }
    )
