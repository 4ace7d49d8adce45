"""A fixed-lag smoother over the poses of one agent, on GTSAM."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import gtsam
import numpy as np
from gtsam.symbol_shorthand import E, X

from star_apriltag.tag_factor import factor
from star_apriltag.vision.body_pose import HEIGHT_DEVIATION, LEVEL_DEVIATION, Motion, View
from star_core import Array, Pose

log = logging.getLogger(__name__)

MOUNTING: Final = E(0)
RELINEARIZE: Final = 0.05  # rad and m

NOTHING_KNOWN: Final = 100.0  # m and rad


@dataclass(frozen=True, slots=True)
class Node:
    """A pose in the graph.

    Attributes:
        time: At which the agent was there, s.
        pose: Body in the map.
        covariance: (6, 6) in gtsam's tangent: turn and shift in the body's own frame.
    """

    time: float
    pose: gtsam.Pose3
    covariance: Array


@dataclass(frozen=True, slots=True)
class Leg:
    """What odometry says of the way from one node to the next.

    Attributes:
        delta: The next body frame in the last one.
        deviations: (6,) of turn and shift.
    """

    delta: gtsam.Pose3
    deviations: Array


class Smoother:
    """Optimises the poses of the last few seconds; older ones live on in what they imply.

    gtsam's smoother must not be used again after it has raised, and would give wrong poses if it
    were: it is then begun anew from the last good node.

    Args:
        mounting: Where the camera is believed to sit.
        mounting_std: How wrong its rotation may be, rad.
        lag: For how long poses stay in the graph, s.

    Attributes:
        node: The newest pose.
        restarts: How often it had to be begun anew.
    """

    def __init__(self, mounting: Pose, *, mounting_std: float, lag: float) -> None:
        self._mounting = mounting
        self._extra = gtsam.Rot3()
        self._extra_deviations = np.full(3, mounting_std)
        self._lag = lag
        self._count = 0
        self.node = Node(0.0, gtsam.Pose3(), np.eye(6))
        self.restarts = 0

    def start(self, time: float, pose: gtsam.Pose3, covariance: Array) -> None:
        """Begin anew at a pose with its covariance, in gtsam's tangent."""
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(RELINEARIZE)
        parameters.relinearizeSkip = 1
        parameters.findUnusedFactorSlots = True  # else the list of factors grows without end
        self._isam = gtsam.IncrementalFixedLagSmoother(self._lag, parameters)
        self._count += 1
        key = X(self._count)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        values.insert(key, pose)
        values.insert(MOUNTING, self._extra)
        graph.add(
            gtsam.PriorFactorPose3(key, pose, gtsam.noiseModel.Gaussian.Covariance(covariance))
        )
        graph.add(
            gtsam.PriorFactorRot3(
                MOUNTING,
                self._extra,
                gtsam.noiseModel.Diagonal.Sigmas(self._extra_deviations),
            )
        )
        self._isam.update(graph, values, {key: time, MOUNTING: time})
        self.node = Node(time, pose, covariance)

    def add(
        self,
        time: float,
        leg: Leg,
        level: gtsam.Rot3,
        height: float,
        views: Sequence[View],
        motion: Motion,
    ) -> None:
        """Go on to the pose at `time`, s, and optimise.

        Args:
            time: Later than the newest node's.
            leg: The way there.
            level: Roll and pitch as the on-board estimator has them; its yaw does not matter.
            height: z in the map, m.
            views: The tags seen there.
            motion: Of the body there.
        """
        last = X(self._count)
        key = X(self._count + 1)
        guess = self.node.pose.compose(leg.delta)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        values.insert(key, guess)
        graph.add(
            gtsam.BetweenFactorPose3(
                last, key, leg.delta, gtsam.noiseModel.Diagonal.Sigmas(leg.deviations)
            )
        )
        level = gtsam.Rot3.Ypr(guess.rotation().yaw(), level.pitch(), level.roll())
        at = np.array([*guess.translation()[:2], height])
        graph.add(gtsam.PriorFactorPose3(key, gtsam.Pose3(level, at), _TILT_AND_HEIGHT))
        for view in views:
            graph.add(factor(key, MOUNTING, view, motion, self._mounting))
        try:
            self._isam.update(graph, values, {key: time, MOUNTING: time})
            pose = self._isam.calculateEstimatePose3(key)
            covariance = self._isam.marginalCovariance(key)
            if not (np.isfinite(covariance).all() and np.isfinite(pose.matrix()).all()):
                raise RuntimeError("the optimum is not finite")  # noqa: TRY301 -- met as gtsam's own
        except RuntimeError as error:
            log.warning("the smoother is begun anew: %s", error)
            self.restarts += 1
            self.start(time, guess, _grown(self.node.covariance, leg))
            return
        self._count += 1
        if views:
            self._extra = self._isam.calculateEstimateRot3(MOUNTING)
            spread = np.diag(self._isam.marginalCovariance(MOUNTING))
            self._extra_deviations = np.sqrt(np.maximum(spread, 1e-8))
        self.node = Node(time, pose, covariance)

    @property
    def camera_turn(self) -> Array:
        """(3, 3) by which the camera is turned against its mounting, in its own frame."""
        matrix: Array = self._extra.matrix()
        return matrix


_TILT_AND_HEIGHT = gtsam.noiseModel.Diagonal.Sigmas(
    np.array([LEVEL_DEVIATION, LEVEL_DEVIATION, *[NOTHING_KNOWN] * 3, HEIGHT_DEVIATION])
)


def _grown(covariance: Array, leg: Leg) -> Array:
    """The covariance at the end of a leg."""
    adjoint = leg.delta.inverse().AdjointMap()
    grown: Array = adjoint @ covariance @ adjoint.T + np.diag(leg.deviations**2)
    return grown
