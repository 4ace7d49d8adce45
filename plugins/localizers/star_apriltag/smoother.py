"""A fixed-lag smoother over the poses of one agent, on GTSAM."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import E, X

from star_apriltag.vision.body_pose import HEIGHT_STD, LEVEL_STD, Motion, View, reproject
from star_core import Array, Pose, skew

log = logging.getLogger(__name__)

MOUNTING: Final = E(0)
RELINEARIZE: Final = 0.05  # rad and m
UNKNOWN_STD: Final = 100.0  # m and rad
HUBER: Final = 1.5  # residual of a whole view, in standard deviations, above which it weighs less


class Node(NamedTuple):
    """A pose in the graph."""

    time: float  # s
    pose: gtsam.Pose3  # body in the map
    covariance: Array  # (6, 6) in gtsam's tangent: turn and shift in the body's own frame


class Leg(NamedTuple):
    """Odometry from one node to the next."""

    delta: gtsam.Pose3  # the next body frame in the last one
    deviations: Array  # (6,) standard deviations of turn and shift


class Smoother:
    """Optimizes the poses of the last few seconds; older ones are marginalized.

    gtsam's smoother must not be used again after it has raised, since its poses would be wrong: it
    is then restarted from the last good node.

    Args:
        mounting: Assumed pose of the camera in the body.
        mounting_std: Standard deviation of its rotation, rad.
        lag: Time for which poses stay in the graph, s.

    Attributes:
        node: The newest pose.
        restarts: Number of restarts after errors.
    """

    def __init__(self, mounting: Pose, *, mounting_std: float, lag: float) -> None:
        self._mounting = mounting
        self._turn = gtsam.Rot3()
        self._turn_std = np.full(3, mounting_std)
        self._lag = lag
        self._count = 0
        self.node = Node(0.0, gtsam.Pose3(), np.eye(6))
        self.restarts = 0

    def start(self, time: float, pose: gtsam.Pose3, covariance: Array) -> None:
        """Restart from a pose with its covariance, in gtsam's tangent."""
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(RELINEARIZE)
        parameters.relinearizeSkip = 1
        parameters.findUnusedFactorSlots = True  # else the list of factors grows without end
        self._isam = gtsam.IncrementalFixedLagSmoother(self._lag, parameters)
        self._count += 1
        key = X(self._count)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        values.insert(key, pose)
        values.insert(MOUNTING, self._turn)
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        graph.add(gtsam.PriorFactorPose3(key, pose, noise))
        noise = gtsam.noiseModel.Diagonal.Sigmas(self._turn_std)
        graph.add(gtsam.PriorFactorRot3(MOUNTING, self._turn, noise))
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
        """Add the pose at `time`, s, and optimize.

        Args:
            time: Later than the newest node's.
            leg: Odometry from the newest node.
            level: Roll and pitch of the on-board estimator; its yaw is ignored.
            height: z in the map, m.
            views: The tags seen.
            motion: Of the body.
        """
        last = X(self._count)
        key = X(self._count + 1)
        guess = self.node.pose.compose(leg.delta)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        values.insert(key, guess)
        noise = gtsam.noiseModel.Diagonal.Sigmas(leg.deviations)
        graph.add(gtsam.BetweenFactorPose3(last, key, leg.delta, noise))
        level = gtsam.Rot3.Ypr(guess.rotation().yaw(), level.pitch(), level.roll())
        at = np.array([*guess.translation()[:2], height])
        graph.add(gtsam.PriorFactorPose3(key, gtsam.Pose3(level, at), _TILT_AND_HEIGHT))
        for view in views:
            graph.add(tag_factor(key, MOUNTING, view, motion, self._mounting))
        try:
            self._isam.update(graph, values, {key: time, MOUNTING: time})
            pose = self._isam.calculateEstimatePose3(key)
            covariance = self._isam.marginalCovariance(key)
            if not (np.isfinite(covariance).all() and np.isfinite(pose.matrix()).all()):
                raise RuntimeError("the optimum is not finite")  # noqa: TRY301 -- as gtsam's own
        except RuntimeError as error:
            log.warning("the smoother is restarted: %s", error)
            self.restarts += 1
            adjoint = leg.delta.inverse().AdjointMap()
            covariance = adjoint @ self.node.covariance @ adjoint.T + np.diag(leg.deviations**2)
            self.start(time, guess, covariance)
            return
        self._count += 1
        if views:
            self._turn = self._isam.calculateEstimateRot3(MOUNTING)
            spread = np.diag(self._isam.marginalCovariance(MOUNTING))
            self._turn_std = np.sqrt(np.maximum(spread, 1e-8))
        self.node = Node(time, pose, covariance)

    @property
    def camera_turn(self) -> Array:
        """(3, 3) estimated rotation of the camera against its mounting, in its own frame."""
        matrix: Array = self._turn.matrix()
        return matrix


def tag_factor(
    pose_key: int, mounting_key: int, view: View, motion: Motion, mounting: Pose
) -> gtsam.CustomFactor:
    """Return the reprojection of a tag's corners, or of one point, as one robust factor.

    Its variables are the body's `gtsam.Pose3` in the map and a small `gtsam.Rot3`, the rotation of
    the camera against `mounting` in its own frame.
    """

    def error(_factor: object, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        pose = values.atPose3(pose_key)
        turn = values.atRot3(mounting_key).matrix()
        body = Pose(pose.rotation().matrix(), pose.translation())
        camera = Pose(mounting.rotation @ turn.T, mounting.position)
        seen, residual, by_pose, by_camera = reproject(body, view, motion, camera)
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(by_pose)
            jacobians[1] = np.asfortranarray(_by_mounting(seen, by_camera, turn))
        return residual

    noise: Any = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Huber.Create(HUBER),
        gtsam.noiseModel.Isotropic.Sigma(view.rays.size, view.deviation),
    )
    return gtsam.CustomFactor(noise, [pose_key, mounting_key], error)


def _by_mounting(seen: Array, by_camera: Array, turn: Array) -> Array:
    """Return the (2 K, 3) derivatives by a rotation of the camera in its own frame."""
    turned: Array = -(by_camera @ skew(seen) @ turn).reshape(-1, 3)
    return turned


_TILT_AND_HEIGHT = gtsam.noiseModel.Diagonal.Sigmas(
    np.array([LEVEL_STD, LEVEL_STD, *[UNKNOWN_STD] * 3, HEIGHT_STD])
)
