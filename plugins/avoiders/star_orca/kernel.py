"""ORCA for a whole swarm in one call: neighbours, half-planes, velocities."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Rows, compiled
from star_orca.edges import layer_at, nearest_edges
from star_orca.fence import SIDES, inside_fence
from star_orca.half_planes import half_planes
from star_orca.keep_right import BLOCKED, QUARTER, side_to_take, turned_right
from star_orca.lanes import lane_turn
from star_orca.linear_program import solve
from star_orca.neighbours import (
    AVOIDS,
    ROW,
    SPEED,
    VX,
    VY,
    WISH_X,
    WISH_Y,
    WISH_Z,
    X,
    Y,
    Z,
    nearest,
    sort_into_cells,
)
from star_orca.obstacle_planes import obstacle_plane
from star_orca.vertical_limit import climb
from star_orca.virtual_agents import virtual_agent

MOST_EDGES = 32  # nearest edges considered; RVO2 considers all within reach


@compiled
def orca(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    position: Array,
    velocity: Array,
    wish: Array,
    radius: Array,
    speed: Array,
    avoids: Mask,
    edges: Array,
    first: Rows,
    height: Array,
    fence: tuple[float, float, float, float],
    horizon: float,
    obstacle_horizon: float,
    clearance: float,
    virtual: bool,  # noqa: FBT001 -- numba takes no keywords cheaply
    communication_radius: float,
    most: int,
    vertical: float,
    period: float,
    turn: float,
) -> Array:
    """Return collision-free velocities, each as near as possible to the agent's preferred one.

    This is optimal reciprocal collision avoidance (van den Berg, Guy, Lin and Manocha, "Reciprocal
    n-Body Collision Avoidance", 2011) in the horizontal plane, plus a limit on vertical velocity
    towards agents above and below. In one plane, with `turn` 0, `virtual` False and every agent
    avoiding, its results equal those of the authors' RVO2. Preferred velocities are limited to the
    greatest speed first; speed used up by avoiding is not available for climbing.

    Rows of agents that do not avoid, and of those whose position is not finite, are returned
    unchanged; the first must still be avoided by the others, the second are ignored.

    Pass every argument, arrays in C order, and floats as floats: numba compiles again for every
    other combination of types.

    Args:
        position: (N, 3) m.
        velocity: (N, 3) m/s; agents without a finite velocity are treated as stationary.
        wish: (N, 3) preferred velocity, m/s.
        radius: (N,) two agents keep the sum of their radii apart in the plane, m.
        speed: (N,) speed limit, m/s.
        avoids: (N,) False where the agent does not give way, so that the others avoid it alone.
        edges: (E, 13) edges of obstacles: this and the next two are `star_orca.outlines.Outlines`.
        first: (L + 1,) first edge of each layer.
        height: (L - 1,) lower bound of each layer but the lowest, m.
        fence: Least x and y of the geofence, then greatest, m; may be infinite.
        horizon: Time for which no two agents shall collide, s.
        obstacle_horizon: Time in which no agent shall hit an obstacle or leave the fence, s.
        clearance: Distance to keep to obstacles, m.
        virtual: Whether obstacles are virtual agents instead of RVO2's half-planes.
        communication_radius: Horizontal distance within which agents are neighbours, m.
        most: Greatest number of neighbours, the nearest.
        vertical: Agents that are and stay further apart in height than this are not neighbours, m.
        period: Time between calls, in which two overlapping agents shall separate, s.
        turn: Angle by which a preferred velocity is turned right when a neighbour is ahead, rad:
            see `keep_right` and `lanes`; 0 for no rule of the road.

    Returns:
        (N, 3) m/s.
    """
    agents, cell, start, columns = sort_into_cells(
        position, velocity, wish, radius, speed, avoids, communication_radius
    )
    limits = (communication_radius, vertical, horizon)
    neighbours, distance = np.empty(most, np.int64), np.empty(most)
    room = min(len(edges), MOST_EDGES)
    seen = (np.empty(room, np.int64), np.empty(room))
    rows = SIDES + room + most
    planes, scratch = np.empty((rows, 3)), np.empty((rows, 3))
    answer = wish.copy()
    for me in range(len(agents)):
        if agents[me, AVOIDS] == 0.0:
            continue
        fastest = agents[me, SPEED]
        count = nearest(agents, me, cell[me], start, columns, limits, neighbours, distance)
        hard = inside_fence(agents[me], fence, 1.0 / obstacle_horizon, fastest, planes, 0)
        if room:
            look = (obstacle_horizon * fastest + clearance, clearance, 1.0 / obstacle_horizon)
            hard = beside_obstacles(
                agents[me], edges, first, height, look, virtual, seen, planes, hard
            )
        half_planes(agents, me, neighbours, count, horizon, period, planes[hard:])
        x, y, z = agents[me, WISH_X], agents[me, WISH_Y], agents[me, WISH_Z]
        squared = x * x + y * y + z * z
        if squared > fastest * fastest:
            scale = fastest / math.sqrt(squared)
            x, y, z = scale * x, scale * y, scale * z
        side, wish_x, wish_y = 0.0, x, y
        if turn != 0.0 and count > 0:
            side = side_to_take(agents, me, neighbours, count, x, y)
            around = (cell[me], start, columns)
            lane = lane_turn(agents, me, around, (communication_radius, vertical), x, y)
            if lane > turn:
                side = 1.0
            wish_x, wish_y = turned_right(x, y, max(lane, turn) * side)
        to_x, to_y = solve(planes, hard + count, hard, fastest, wish_x, wish_y, scratch)
        least = BLOCKED * (x * x + y * y)
        if side != 0.0 and x * to_x + y * to_y < least:
            alone_x, alone_y = solve(planes, hard, hard, fastest, wish_x, wish_y, scratch)
            if x * alone_x + y * alone_y > least:  # it is the others that block it, no obstacle
                wish_x, wish_y = turned_right(x, y, side * QUARTER)
                to_x, to_y = solve(planes, hard + count, hard, fastest, wish_x, wish_y, scratch)
        if z != 0.0:
            z = climb(agents, me, neighbours, count, z, vertical, 1.0 / horizon)
            left = math.sqrt(max(fastest * fastest - to_x * to_x - to_y * to_y, 0.0))
            z = min(max(z, -left), left)
        i = int(agents[me, ROW])
        answer[i, 0], answer[i, 1], answer[i, 2] = to_x, to_y, z
    return answer


@compiled
def beside_obstacles(  # noqa: PLR0913, PLR0917 -- as above
    agent: Array,
    edges: Array,
    first: Rows,
    height: Array,
    look: tuple[float, float, float],
    virtual: bool,  # noqa: FBT001
    seen: tuple[Rows, Array],
    planes: Array,
    count: int,
) -> int:
    """Add the half-planes of obstacles at an agent's height to `planes`; return their new number.

    Args:
        agent: Its row of the table of `sort_into_cells`.
        edges: As in `orca`, like the next two.
        first: First edge of each layer.
        height: Lower bound of each layer but the lowest, m.
        look: Search radius for edges and distance to keep to them, m, and one over the time
            horizon, 1/s.
        virtual: Whether obstacles are virtual agents.
        seen: (K,) and (K,) buffers for `nearest_edges`.
        planes: (K, 3) output: half-planes.
        count: Number of half-planes in it.
    """
    layer = layer_at(agent[Z], height)
    span = (first[layer], first[layer + 1])
    if span[0] == span[1]:
        return count
    flight = (agent[X], agent[Y], agent[VX], agent[VY])
    for k in range(nearest_edges(edges, span, agent[X], agent[Y], look[0], seen)):
        if virtual:
            count = virtual_agent(edges, seen[0][k], flight, look[1], look[2], planes, count)
        else:
            count = obstacle_plane(edges, seen[0][k], flight, look[1], look[2], planes, count)
    return count
