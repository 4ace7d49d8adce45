"""Goals of a swarm, and planners with their options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import star_straight
import star_visibility
from star_core import Array, Goals, Scene
from star_core.toolkit import fill_defaults

(STRAIGHT,) = star_straight.star_planners()
(VISIBILITY,) = star_visibility.star_planners()


def goals(position: Sequence[Sequence[float]] | Array, *, speed: Any = 0.5, **more: Any) -> Goals:
    """Return goals of all agents, at rest unless `more` changes that."""
    n = len(position)
    whole = Goals(
        position=np.array(position, np.float64),
        velocity=np.zeros((n, 3)),
        yaw=np.zeros(n),
        speed=np.broadcast_to(speed, n),
        active=np.ones(n, np.bool_),
    )
    return replace(whole, **more)


def visibility(room: Scene, **options: float) -> Any:
    """Return the planner `visibility` with some options."""
    return VISIBILITY.make(room, **fill_defaults(options, VISIBILITY.options))


def straight(room: Scene, **options: float) -> Any:
    """Return the planner `straight` with some options."""
    return STRAIGHT.make(room, **fill_defaults(options, STRAIGHT.options))
