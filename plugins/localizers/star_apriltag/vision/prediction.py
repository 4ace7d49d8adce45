"""What is believed of an agent when one of its images is looked at."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from star_apriltag.vision.body_pose import Level, Motion
from star_core import Array, Pose


@dataclass(frozen=True, slots=True)
class Prediction:
    """What is believed of an agent at the time an image was taken, before it is looked at.

    Attributes:
        pose: Of the body in the map.
        covariance: (3, 3) of x, y and yaw, m and rad.
        roll: As the on-board estimator has it, rad.
        pitch: rad, nose down positive.
        height: z in the map, m.
        velocity: (3,) in the body frame, m/s.
        rates: (3,) in the body frame, rad/s.
        camera_turn: (3, 3) by which the camera is turned against its mounting, in its own frame.
    """

    pose: Pose
    covariance: Array
    roll: float
    pitch: float
    height: float
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    rates: Array = field(default_factory=lambda: np.zeros(3))
    camera_turn: Array = field(default_factory=lambda: np.eye(3))

    def camera(self, mounting: Pose) -> Pose:
        """Return where a camera of that mounting is believed to lie in the body."""
        return Pose(mounting.rotation @ self.camera_turn.T, mounting.position)

    @property
    def level(self) -> Level:
        """Tilt and height."""
        return Level.of(self.roll, self.pitch, self.height)

    @property
    def motion(self) -> Motion:
        """Velocity and turn rates."""
        return Motion(self.velocity, self.rates)
