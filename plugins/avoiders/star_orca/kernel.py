"""ORCA for a whole swarm in one call: neighbours, half-planes, velocities."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Rows, compiled
from star_orca.column import climb
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
from star_orca.virtual_agents import virtual_agent

MOST_EDGES = 32  # are looked at, the nearest; RVO2 looks at all within reach


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
    """Return the velocity nearest to its wish that keeps each agent apart from its neighbours.

    This is optimal reciprocal collision avoidance: van den Berg, Guy, Lin and Manocha, "Reciprocal
    n-Body Collision Avoidance" (2011), in the horizontal plane, and a limit on what agents climb
    and sink towards each other. In one plane, with `turn` 0, `virtual` False and every agent
    avoiding it answers as the authors' RVO2 does. Wishes are cut to the greatest speed first; what
    avoiding takes of the speed is not left for climbing.

    Agents that do not avoid, and those whose position is not finite, are answered their wish as it
    came; the first are in the way of the others all the same, the second are not.

    Pass every argument, arrays in C order, and floats as floats: numba compiles anew for every
    other combination of types.

    Args:
        position: (N, 3) m.
        velocity: (N, 3) m/s; one that is not finite counts as at rest.
        wish: (N, 3) wanted velocity, m/s.
        radius: (N,) two agents keep the sum of their radii apart in the plane, m.
        speed: (N,) greatest speed, m/s.
        avoids: (N,) False where the agent does not give way, so that the others do it alone.
        edges: (E, 13) edges of obstacles: this and the next two are `star_orca.outlines.Outlines`.
        first: (L + 1,) first edge of each layer.
        height: (L - 1,) where each layer but the lowest begins, m.
        fence: Least x and y that agents may be at, then greatest, m; may be infinite.
        horizon: Time for which no two shall collide, s.
        obstacle_horizon: Time for which none shall collide with an obstacle or leave the fence, s.
        clearance: Distance that each keeps to obstacles, m.
        virtual: Whether obstacles are virtual agents, else they are RVO2's half-planes.
        communication_radius: How far away in the plane neighbours are looked for, m.
        most: No more than so many neighbours are looked at, the nearest.
        vertical: Agents that are and stay further apart in height than this are no neighbours, m.
        period: Time from one call to the next, in which two that overlap shall come apart, s.
        turn: How far a wish is turned right when a neighbour is ahead, rad: see `keep_right` and
            `lanes`; 0 for no rule of the road.

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
    """Add to `planes` what the obstacles at an agent's height leave free; return how many it holds.

    Args:
        agent: Its row of the table of `sort_into_cells`.
        edges: As `orca` has them, like the next two.
        first: First edge of each layer.
        height: Where each layer but the lowest begins, m.
        look: How far away edges are looked for and the distance kept to them, m, and one over the
            time to look ahead, 1/s.
        virtual: Whether obstacles are virtual agents.
        seen: (K,) and (K,) room for `nearest_edges`.
        planes: (K, 3) where the half-planes go.
        count: How many there are.
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
