"""Where a camera's carrier is while an image is taken."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from star_core import Array


class Shot(NamedTuple):
    """The body half-way through the exposure of the middle row, and how it moves around then.

    Attributes:
        position: (3,) of the body's frame in the map, m.
        attitude: (4,) unit quaternion x, y, z, w from the body to the map.
        velocity: (3,) in the map, m/s; taken as constant for as long as the image takes.
        rates: (3,) angular velocity in the body, rad/s; likewise.
    """

    position: Array
    attitude: Array
    velocity: Array
    rates: Array

    def packed(self) -> Array:
        """(13,) all of it in a row, for kernels."""
        return np.concatenate([self.position, self.attitude, self.velocity, self.rates])
