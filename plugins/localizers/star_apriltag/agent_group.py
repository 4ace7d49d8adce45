"""Estimates the states of several agents, tick by tick."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from star_apriltag.agent_estimator import CameraReport, FilterEstimator, Settings
from star_apriltag.dead_reckoning import AgentState, Anchor
from star_apriltag.vision.image_analysis import ImageAnalysis
from star_core import Mask, Odometry, Scene, Tag

if TYPE_CHECKING:
    from star_apriltag.batch import BatchEstimator

log = logging.getLogger(__name__)


class TickInput(NamedTuple):
    """Reports of some agents in one tick."""

    time: float  # of the tick, s
    odometry: Odometry  # since the last tick
    images: tuple[CameraReport, ...]  # in the order of their exposures
    motors: Mask  # (N,) which agents' motors may run

    def of(self, rows: Sequence[int]) -> TickInput:
        """Return the reports of the agents in `rows`."""
        return self._replace(
            odometry=self.odometry.of(np.isin(self.odometry.agent, rows)),
            images=tuple(image for image in self.images if image.row in rows),
        )


class TickOutput(NamedTuple):
    """Results of some ticks."""

    # of the agents with a new one, by their rows
    anchors: dict[int, Anchor] = {}  # noqa: RUF012 -- never changed
    fixed: frozenset[int] = frozenset()  # rows of the agents with an accepted landmark
    # targets seen, each as the columns of `star_core.Sightings`
    sightings: tuple[tuple[Any, ...], ...] = ()
    # tags detected in images, each as the columns of `star_core.Detections`
    detections: tuple[tuple[Any, ...], ...] = ()


def merged(outputs: Iterable[TickOutput]) -> TickOutput:
    """Return the results of several ticks, earlier ones first, or of several groups."""
    result = TickOutput()
    for output in outputs:
        result = TickOutput(
            result.anchors | output.anchors,
            result.fixed | output.fixed,
            result.sightings + output.sightings,
            result.detections + output.detections,
        )
    return result


class AgentGroup:
    """The estimators of the agents in some rows."""

    def __init__(self, scene: Scene, rows: Iterable[int], settings: Settings) -> None:
        landmarks = _first_of_each(scene.world.landmarks, settings.max_tags_per_landmark)
        self._scene = scene
        self._estimators = {row: _estimator(scene, row, landmarks, settings) for row in rows}

    def update(self, reports: TickInput) -> TickOutput:
        """Process the reports of one tick."""
        before = {row: estimator.anchor for row, estimator in self._estimators.items()}
        for row, estimator in self._estimators.items():
            rows = np.flatnonzero(reports.odometry.agent == row)
            estimator.add_odometry(reports.odometry, rows, motors=bool(reports.motors[row]))
        fixed: set[int] = set()
        sightings: list[tuple[Any, ...]] = []
        detections: list[tuple[Any, ...]] = []
        for image in reports.images:
            try:
                result = self._estimators[image.row].add_image(image)
            except ValueError as error:
                name = self._scene.agents[image.row].name
                log.warning("an image of %s is ignored: %s", name, error)
                continue
            if result is not None:
                analysis, state = result
                if state is not None:
                    sightings += _sightings(image, analysis, state)
                fixed |= {image.row} if analysis.views else set()
                if image.image is not None:
                    detections += _detections(image, analysis)
        for estimator in self._estimators.values():
            estimator.advance(reports.time)
        anchors = {row: estimator.anchor for row, estimator in self._estimators.items()}
        new = {row: anchor for row, anchor in anchors.items() if anchor is not before[row]}
        return TickOutput(new, frozenset(fixed), tuple(sightings), tuple(detections))


def _estimator(
    scene: Scene, row: int, landmarks: tuple[Tag, ...], settings: Settings
) -> FilterEstimator | BatchEstimator:
    if settings.method == "batch":
        from star_apriltag.batch import BatchEstimator  # imports gtsam

        return BatchEstimator(scene.agents[row], landmarks)
    return FilterEstimator(scene.agents[row], landmarks, scene.world.targets, settings)


def _first_of_each(tags: tuple[Tag, ...], count: int) -> tuple[Tag, ...]:
    """Return the first few tags of each landmark."""
    used: dict[str, int] = {}
    kept = []
    for tag in tags:
        used[tag.of] = used.get(tag.of, 0) + 1
        if used[tag.of] <= count:
            kept.append(tag)
    return tuple(kept)


def _sightings(
    image: CameraReport, analysis: ImageAnalysis, state: AgentState
) -> Iterator[tuple[Any, ...]]:
    """Yield the targets of one image, in the map: the columns of `star_core.Sightings`."""
    rotation = state.rotation
    for target in analysis.targets:
        away = rotation @ target.pose.position
        across = np.array([-away[1], away[0], 0.0])
        covariance = rotation @ target.covariance @ rotation.T + state.covariance[:3, :3]
        cross = np.outer(state.covariance[:3, 3], across)
        covariance += cross + cross.T + state.covariance[3, 3] * np.outer(across, across)
        ahead = rotation @ target.pose.rotation[:, 0]
        yaw = math.atan2(ahead[1], ahead[0])
        yield image.row, target.tag, image.taken, state.position + away, yaw, covariance


def _detections(image: CameraReport, analysis: ImageAnalysis) -> Iterator[tuple[Any, ...]]:
    """Yield the tags detected in one image: the columns of `star_core.Detections`."""
    taken = image.taken if image.stamped else math.nan
    for tag, corners, rejected in analysis.detected:
        yield image.row, tag, corners, taken, image.arrived, rejected
