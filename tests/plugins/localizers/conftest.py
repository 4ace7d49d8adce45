"""Reports and measured poses as localizers receive them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from star_core import PoseFixes, Telemetry
from star_core.toolkit import quaternion_from_euler


def report(position: Any, *, yaw: float = 0.0, **more: Any) -> Telemetry:
    """Return reports of agents at (N, 3) positions in their odometry frames, m, at rest."""
    n = len(position)
    whole = Telemetry(
        time=0.0,
        position=np.array(position, np.float64),
        velocity=np.zeros((n, 3)),
        attitude=np.tile([0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)], (n, 1)),
        battery=np.full(n, 4.0),
        state=np.zeros(n, np.int64),
        age=np.zeros(n),
    )
    return replace(whole, **more)


def fixes(
    time: float,
    position: Sequence[Sequence[float]],
    *,
    agent: Sequence[int] = (0,),
    yaw: float = np.nan,
    std: float = 0.01,
) -> PoseFixes:
    """Return measurements of some agents at (K, 3) positions, m, that arrive at once."""
    column = np.ones(len(agent))
    return PoseFixes(
        agent=np.array(agent),
        taken=time * column,
        arrived=time * column,
        position=np.array(position),
        attitude=quaternion_from_euler(0 * column, 0 * column, yaw * column),
        position_std=std * column,
        attitude_std=std * column,
        correlation_time=0 * column,
    )
