"""Half-planes that keep velocities from leading out of the geofence or into obstacles.

They are hard: not violated for the sake of other agents. The core brakes any agent that would cross
the fence. An avoider unaware of the fence would evade across it, and rely on space that the core
does not grant.
"""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Rows, compiled
from star_orca.edges import layer_at, nearest_edges
from star_orca.obstacle_planes import obstacle_plane
from star_orca.outlines import Outlines
from star_orca.virtual_agents import virtual_agent

MAX_EDGES = 32  # nearest edges considered; RVO2 considers all within reach
MAX_RETURN = 0.5  # share of the speed limit: fastest required return of an agent outside the fence
_NORMALS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])  # inwards, of the sides


def hard_planes(  # noqa: PLR0913 -- what the kernel takes
    position: Array,
    velocity: Array,
    speed: Array,
    avoids: Mask,
    outlines: Outlines,
    fence: Array,
    *,
    horizon: float,
    clearance: float,
    virtual: bool = False,
) -> tuple[Array, Rows]:
    """Return each agent's half-planes of the fence and of the obstacles at its height.

    Towards a side of the fence, an agent may fly the speed that reaches it within the horizon;
    beyond a side, it must fly at least the speed that returns it in that time. Sides out of reach
    in that time add no half-plane.

    Args:
        position: (N, 3) m.
        velocity: (N, 3) m/s; agents without a finite velocity are treated as stationary.
        speed: (N,) speed limit, m/s.
        avoids: (N,) agents whose half-planes are needed.
        outlines: Of the obstacles.
        fence: (4,) least x and y of the geofence, then greatest, m; may be infinite.
        horizon: Time in which no agent shall hit an obstacle or leave the fence, s.
        clearance: Distance to keep to obstacles, m.
        virtual: Whether obstacles are virtual agents instead of RVO2's half-planes.

    Returns:
        (N, K, 3) half-planes as in `star_orca.half_planes`, and (N,) their numbers.
    """
    rate = 1.0 / horizon
    here = position[:, :2]
    with np.errstate(invalid="ignore"):  # positions and fence may be infinite
        room = np.concatenate([here - fence[:2], fence[2:] - here], axis=1)
    agent, side = np.nonzero(room < (speed / rate)[:, None])
    count = np.bincount(agent, minlength=len(position))
    planes = np.empty((len(position), len(_NORMALS) + min(len(outlines.edges), MAX_EDGES), 3))
    if len(agent):
        row = np.arange(len(agent)) - np.repeat(np.cumsum(count) - count, count)
        planes[agent, row, :2] = _NORMALS[side]
        returns = np.minimum(-rate * room[agent, side], MAX_RETURN * speed[agent])
        planes[agent, row, 2] = returns
    if len(outlines.edges):
        add_obstacles(
            position, velocity, speed, avoids, *outlines, horizon, clearance, virtual, planes, count
        )
    return planes, count


@compiled
def add_obstacles(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    position: Array,
    velocity: Array,
    speed: Array,
    avoids: Mask,
    edges: Array,
    first: Rows,
    height: Array,
    horizon: float,
    clearance: float,
    virtual: bool,  # noqa: FBT001 -- numba takes no keywords cheaply
    planes: Array,
    counts: Rows,
) -> None:
    """Add the half-planes of obstacles, `edges`, `first` and `height`, as `hard_planes` does."""
    room = planes.shape[1] - 4
    seen = (np.empty(room, np.int64), np.empty(room))
    rate = 1.0 / horizon
    for i in range(len(position)):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        if not avoids[i] or not math.isfinite(x + y + z):
            continue
        layer = layer_at(z, height)
        span = (first[layer], first[layer + 1])
        if span[0] == span[1]:
            continue
        vx, vy = velocity[i, 0], velocity[i, 1]
        if not math.isfinite(vx + vy):
            vx, vy = 0.0, 0.0
        flight = (x, y, vx, vy)
        count = counts[i]
        reach = horizon * speed[i] + clearance
        for k in range(nearest_edges(edges, span, x, y, reach, seen)):
            if virtual:
                count = virtual_agent(edges, seen[0][k], flight, clearance, rate, planes[i], count)
            else:
                count = obstacle_plane(edges, seen[0][k], flight, clearance, rate, planes[i], count)
        counts[i] = count
