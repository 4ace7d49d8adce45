"""Tables of vision: one row per image, tag or correction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from star_core.messages.arrays import Array, Rows, freeze_arrays

Image: TypeAlias = NDArray[np.uint8]
"""(height, width) grey values."""


@dataclass(frozen=True, slots=True)
class Frames:
    """Images that arrived since the last tick, in the order of their arrival.

    Attributes:
        agent: (K,) row of the agent whose camera took it.
        taken: (K,) mission time at the middle of the exposure of its middle row, s; NaN if unknown.
        arrived: (K,) mission time of its arrival, s.
        image: K images; each has the size of its camera.
    """

    agent: Rows
    taken: Array
    arrived: Array
    image: tuple[Image, ...]

    def __post_init__(self) -> None:
        images = {"image": len(self.image)}
        numbers: dict[str, tuple[int, ...]] = {"taken": (), "arrived": ()}
        freeze_arrays(self, numbers, integers=("agent",), others=images, per="image")

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without an image."""
        return cls(np.zeros(0, np.int64), np.zeros(0), np.zeros(0), ())


@dataclass(frozen=True, slots=True)
class Detections:
    """Tags detected in images by a camera's own processor.

    Attributes:
        agent: (K,) row of the agent whose camera saw the tag.
        tag: (K,) the tag's number.
        corners: (K, 4, 2) its corners in the distorted image, px: bottom left, bottom right, top
            right and top left of the upright tag.
        taken: (K,) as in `Frames`.
        arrived: (K,) as in `Frames`.
    """

    agent: Rows
    tag: Rows
    corners: Array
    taken: Array
    arrived: Array

    def __post_init__(self) -> None:
        freeze_arrays(
            self,
            {"corners": (4, 2), "taken": (), "arrived": ()},
            integers=("agent", "tag"),
            per="tag",
        )

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without a tag."""
        none = np.zeros(0, np.int64)
        return cls(none, none, np.zeros((0, 4, 2)), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, slots=True)
class Sightings:
    """Tags seen by agents that are not landmarks: targets.

    Attributes:
        agent: (K,) row of the agent that saw the tag.
        tag: (K,) the tag's number.
        time: (K,) mission time of the sighting, s.
        position: (K, 3) center of the tag in the map, m.
        yaw: (K,) direction of the tag's x axis in the map's x-y plane, rad.
        covariance: (K, 3, 3) of the position, including that of the agent's position, m².
    """

    agent: Rows
    tag: Rows
    time: Array
    position: Array
    yaw: Array
    covariance: Array

    def __post_init__(self) -> None:
        numbers = {"time": (), "position": (3,), "yaw": (), "covariance": (3, 3)}
        freeze_arrays(self, numbers, integers=("agent", "tag"), per="tag")

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without a tag."""
        none, empty = np.zeros(0, np.int64), np.zeros(0)
        return cls(none, none, empty, np.zeros((0, 3)), empty, np.zeros((0, 3, 3)))


@dataclass(frozen=True, slots=True)
class Corrections:
    """Poses of agents in their odometry frames, for their on-board estimators.

    Attributes:
        agent: (K,) row of the agent.
        position: (K, 3) m.
        attitude: (K, 4) unit quaternion x, y, z, w from the body to the odometry frame.
        position_deviation: (K,) along each axis, m.
        attitude_deviation: (K,) about each axis, rad; infinite if only the position is corrected.
    """

    agent: Rows
    position: Array
    attitude: Array
    position_deviation: Array
    attitude_deviation: Array

    def __post_init__(self) -> None:
        freeze_arrays(
            self,
            {
                "position": (3,),
                "attitude": (4,),
                "position_deviation": (),
                "attitude_deviation": (),
            },
            integers=("agent",),
            per="correction",
        )

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without a correction."""
        nothing = np.zeros(0)
        return cls(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 4)), nothing, nothing)
