"""Where the body is, from tags whose places are known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Pose, perspective, skew

LEVEL_DEVIATION: Final = math.radians(2.0)
"""What the on-board estimator's roll and pitch are good for, rad; loose, for its errors last."""

HEIGHT_DEVIATION: Final = 0.02
"""What its height is good for, m."""

MOST_STEPS: Final = 10
SETTLED: Final = 1e-4  # rad and m: after a step that small, the next is below 1e-6
NEAREST: Final = 0.02  # m, ahead of the camera: nearer than any lens focuses


class View(NamedTuple):
    """What was seen of the map in one place of one image: a tag's four corners, or one point.

    Attributes:
        points: (K, 3) in the map, m.
        rays: (K, 2) where they were seen: undistorted, over the depth.
        deviation: Of each number in `rays`.
        delay: (K,) when each point was read, from the image's middle row on, s.
    """

    points: Array
    rays: Array
    deviation: float
    delay: Array


@dataclass(frozen=True, slots=True)
class Level:
    """What the on-board estimator says beside the tags.

    Attributes:
        up: (3,) the map's z axis in the body frame.
        height: z of the body in the map, m.
    """

    up: Array
    height: float

    @classmethod
    def of(cls, roll: float, pitch: float, height: float) -> Level:
        """Return it for a body rolled and pitched (nose down positive), rad."""
        up = [
            -math.sin(pitch),
            math.cos(pitch) * math.sin(roll),
            math.cos(pitch) * math.cos(roll),
        ]
        return cls(np.array(up), height)


class Motion(NamedTuple):
    """How the body moves while the rows of an image are read, in its own frame.

    Attributes:
        velocity: (3,) m/s.
        rates: (3,) rad/s.
    """

    velocity: Array
    rates: Array


AT_REST: Final = Motion(np.zeros(3), np.zeros(3))


@dataclass(frozen=True, slots=True)
class Fix:
    """A pose that was found, and how sure it is.

    Attributes:
        pose: Of the body in the map.
        covariance: (6, 6), of a turn and then a shift in the body's own frame, rad and m: the
            tangent of gtsam's `Pose3`. It holds what tilt and height were taken to be good for.
        misfit: Root mean square of the points' residuals, in deviations.
    """

    pose: Pose
    covariance: Array
    misfit: float


def refine(
    pose: Pose,
    views: Sequence[View],
    mounting: Pose,
    level: Level | None = None,
    motion: Motion = AT_REST,
) -> Fix | None:
    """Return the body pose at which the map looks most as it was seen, or None.

    All six degrees of freedom are sought, by Gauss-Newton; tilt and height are held by `level`
    as far as it is good for.

    Args:
        pose: Of the body in the map, to begin from.
        views: At least one.
        mounting: Camera in the body.
        level: None to use the tags alone.
        motion: Of the body.
    """
    sight = View(
        np.concatenate([view.points for view in views]),
        np.concatenate([view.rays for view in views]),
        1.0,
        np.concatenate([view.delay for view in views]),
    )
    weight = np.concatenate([np.full(view.rays.size, 1 / view.deviation) for view in views])
    for _ in range(MOST_STEPS):
        camera, residual, by_pose, _ = reproject(pose, sight, motion, mounting)
        if not camera[:, 2].min() > NEAREST:
            return None
        residual *= weight
        jacobian = by_pose * weight[:, None]
        information = jacobian.T @ jacobian
        slope = -jacobian.T @ residual
        if level is not None:
            more, pull = _held(pose, level)
            information += more
            slope += pull
        try:
            covariance = np.linalg.inv(information)
        except np.linalg.LinAlgError:
            return None
        step = covariance @ slope
        pose = pose.moved(step)
        if np.abs(step).max() < SETTLED:
            break
    else:
        return None
    if not np.isfinite(covariance).all():
        return None
    return Fix(pose, covariance, float(np.sqrt(residual @ residual / len(residual))))


def reproject(
    pose: Pose, view: View, motion: Motion, mounting: Pose
) -> tuple[Array, Array, Array, Array]:
    """Return how a view is seen from a body pose, and the derivatives.

    With the body's rotation R and position t, a point P is at ``b = R'(P - t)`` in the body when
    the middle row is read, and at ``b + d (cross(b, w) - v)`` when its own row is, d later; then at
    ``C'(b - l)`` in the camera, where `mounting` is C and l.

    Args:
        pose: Of the body in the map.
        view: K points.
        motion: Of the body.
        mounting: Camera in the body.

    Returns:
        The (K, 3) points in the camera, m, the (2 K,) residuals of their rays, their (2 K, 6)
        derivatives by a rotation and a shift of the body in its own frame, gtsam's tangent of
        `Pose3`, and their (K, 2, 3) derivatives by the points in the camera.
    """
    body = (view.points - pose.position) @ pose.rotation
    delay, spin = view.delay[:, None], skew(motion.rates)
    seen = body + delay * (body @ spin - motion.velocity)
    camera = (seen - mounting.position) @ mounting.rotation
    rays, by_camera = perspective(np.maximum(camera, _IN_FRONT))
    by_body = by_camera @ mounting.rotation.T
    by_body -= delay[:, :, None] * (by_body @ spin)
    by_pose = np.concatenate([by_body @ skew(body), -by_body], axis=2)
    return camera, (rays - view.rays).ravel(), by_pose.reshape(-1, 6), by_camera


def _held(pose: Pose, level: Level) -> tuple[Array, Array]:
    """Return the (6, 6) information and the (6,) slope that tilt and height add."""
    up = pose.rotation[2]
    x, y, z = (up / LEVEL_DEVIATION).tolist()
    jacobian = np.zeros((3, 6))
    jacobian[0, 1:3] = -z, y
    jacobian[1, 0:3:2] = z, -x
    jacobian[2, 3:] = up / HEIGHT_DEVIATION
    off = (level.up - up) / LEVEL_DEVIATION
    off[2] = (level.height - pose.position[2]) / HEIGHT_DEVIATION
    return jacobian.T @ jacobian, off @ jacobian


_IN_FRONT = np.array([-np.inf, -np.inf, NEAREST])  # behind a camera is no image: it stays finite
