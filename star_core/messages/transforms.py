"""Where one frame lies in another, for every agent at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows, freeze_arrays


@dataclass(frozen=True, slots=True)
class Transform:
    """A level rigid motion for each agent: a turn about z, then a shift.

    Attributes:
        yaw: (N,) rad.
        translation: (N, 3) m.
    """

    yaw: Array
    translation: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, {"yaw": (), "translation": (3,)})

    def turn(self, vectors: Array) -> Array:
        """Turn (N, 3) vectors, one per agent, without the shift.

        >>> quarter = Transform(np.array([np.pi / 2]), np.ones((1, 3)))
        >>> quarter.turn(np.array([[1.0, 0.0, 0.5]])).round(9)
        array([[0. , 1. , 0.5]])
        """
        return _turned(self.yaw, vectors)

    def turn_back(self, vectors: Array) -> Array:
        """Turn (N, 3) vectors the other way round, without the shift."""
        return _turned(-self.yaw, vectors)

    def apply(self, points: Array) -> Array:
        """Move (N, 3) points, one per agent."""
        return self.turn(points) + self.translation

    def inverse(self) -> Transform:
        """The motion that undoes this one."""
        return Transform(-self.yaw, -self.turn_back(self.translation))

    def of(self, rows: Rows) -> Transform:
        """Return the motions of some agents, in the order of `rows`."""
        return Transform(self.yaw[rows], self.translation[rows])

    def where(self, mask: Mask, other: Transform) -> Transform:
        """Return the motions of this one where an (N,) mask is True, and `other`'s elsewhere."""
        return Transform(
            np.where(mask, self.yaw, other.yaw),
            np.where(mask[:, None], self.translation, other.translation),
        )

    @property
    def known(self) -> Mask:
        """(N,) agents whose motion is finite."""
        finite: Mask = np.isfinite(self.yaw) & np.isfinite(self.translation).all(axis=1)
        return finite


def _turned(yaw: Array, vectors: Array) -> Array:
    """Turn (N, 3) vectors about z by (N,) angles, rad."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned = vectors.copy()
    x, y = vectors[:, 0], vectors[:, 1]
    turned[:, 0] = cos * x - sin * y
    turned[:, 1] = sin * x + cos * y
    return turned
