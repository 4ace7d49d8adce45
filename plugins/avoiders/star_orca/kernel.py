"""ORCA for a whole swarm in one call: neighbours, half-planes, velocities."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Rows
from star_core.toolkit import YIELD_TIME, compiled, subroutine
from star_orca.fence_planes import SIDES, fence_planes
from star_orca.half_planes import half_planes
from star_orca.keep_right import BLOCKED, QUARTER, lane_turn, side_to_take, turned_right
from star_orca.linear_program import solve
from star_orca.neighbours import (
    AVOIDS,
    CLIMB,
    MARGIN,
    RADIUS,
    ROW,
    SPEED,
    WISH_X,
    WISH_Y,
    WISH_Z,
    X,
    Y,
    Z,
    nearest,
    sort_into_cells,
)
from star_orca.obstacle_planes import add_obstacles

# Time constant with which wide margins yield, s, in place of `YIELD_TIME`: agents that drift would
# use up their margins before they have turned around each other. Not among obstacles, where there
# is less room for a turn, and not in a crowd, which would block itself.
WIDE_YIELD_TIME = 60.0
CROWD = 6  # neighbours

MAX_EDGES = 32  # nearest edges of obstacles considered; RVO2 considers all within reach


@compiled
def orca(  # noqa: C901, PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    position: Array,
    velocity: Array,
    wish: Array,
    radius: Array,
    margin: Array,
    speed: Array,
    avoids: Mask,
    goal: Array,
    hard_margin: Array,
    fence: Array,
    edges: Array | None,
    first: Rows,
    height: Array,
    obstacle_horizon: float,
    clearance: float,
    virtual: bool,  # noqa: FBT001 -- numba takes no keywords cheaply
    horizon: float,
    communication_radius: float,
    most: int,
    vertical: float,
    period: float,
    turn: float,
) -> Array:
    """Return collision-free velocities, each as near as possible to the agent's preferred one.

    This is optimal reciprocal collision avoidance (van den Berg, Guy, Lin and Manocha, "Reciprocal
    n-Body Collision Avoidance", 2011) in the horizontal plane, plus a limit on vertical velocity
    towards agents above and below. In one plane, with `turn` 0 and every agent
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
        margin: (N,) by which the radius is enlarged for an uncertain position, m.
        speed: (N,) speed limit, m/s.
        avoids: (N,) False where the agent does not give way, so that the others avoid it alone.
        goal: (N, 2) where it flies, m; NaN if it stays: agents keep their wide margins only from
            those that fly on to goals that are farther apart.
        hard_margin: (N,) likewise, by which distances to obstacles and fence are enlarged, m.
        fence: (4,) least x and y of the geofence, then greatest, m; may be infinite.
        edges: Of `star_orca.outlines.Outlines`, as are `first` and `height`; None where there are
            no obstacles, for which nothing is compiled then.
        first: (L + 1,)
        height: (L - 1,)
        obstacle_horizon: Time in which no agent shall hit an obstacle or leave the fence, s.
        clearance: Distance to keep to obstacles, m.
        virtual: Whether obstacles are virtual agents instead of RVO2's half-planes.
        horizon: Time for which no two agents shall collide, s.
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
        position, velocity, wish, radius, margin, speed, avoids, goal, communication_radius
    )
    limits = (communication_radius, vertical, horizon)
    neighbours, distance = np.empty(most, np.int64), np.empty(most)
    rows = SIDES + most
    if edges is not None:
        most_edges = min(len(edges), MAX_EDGES)
        edge_buffers = (np.empty(most_edges, np.int64), np.empty(most_edges))
        rows += most_edges
    in_the_open = YIELD_TIME  # s
    if edges is None:
        in_the_open = WIDE_YIELD_TIME
    planes, scratch = np.empty((rows, 3)), np.empty((rows, 3))
    answer = wish.copy()
    for me in range(len(agents)):
        if agents[me, AVOIDS] == 0.0:
            continue
        fastest = agents[me, SPEED]
        count = nearest(agents, me, cell[me], start, columns, limits, neighbours, distance)
        i = int(agents[me, ROW])
        east, north, wide = position[i, 0], position[i, 1], hard_margin[i]
        hard = fence_planes(east, north, speed[i], wide, fence, obstacle_horizon, planes)
        if edges is not None:
            hard = add_obstacles(
                *(i, position, velocity, speed, hard_margin, edges, first, height),
                *(obstacle_horizon, clearance, virtual, edge_buffers, planes, hard),
            )
        yield_time = in_the_open if count < CROWD else YIELD_TIME
        half_planes(
            *(agents, me, neighbours, count, horizon, period, vertical, yield_time, planes, hard)
        )
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
        answer[i, 0], answer[i, 1], answer[i, 2] = to_x, to_y, z
    return answer


# Share of the sum of the radii within which one agent counts as above or below another. Less than
# 1, so that two that have separated to their radii in order to pass each other are free to do so.
WITHIN = 0.75


@subroutine
def climb(
    agents: Array, me: int, neighbours: Rows, count: int, wish: float, vertical: float, rate: float
) -> float:
    """Return the vertical velocity nearest to the preferred one that keeps the vertical distance.

    Towards a neighbour straight above or below, each of two agents that avoid may use half of
    ``rate`` times the distance beyond `vertical`; towards a neighbour that does not avoid, the
    agent may use all of it less the neighbour's own approach. Nearer than `vertical` none is left.
    Agents are never made to climb or sink: altitude is kept.

    Args:
        agents: (M, 16) table of `star_orca.neighbours.sort_into_cells`.
        me: Row in it of the avoiding agent.
        neighbours: (K,) rows in it of its neighbours.
        count: Number of these to use.
        wish: Preferred vertical velocity, m/s.
        vertical: Vertical distance to keep, m.
        rate: Share of the remaining distance that may be used in a second, 1/s.
    """
    up, down = math.inf, math.inf
    for k in range(count):
        other = neighbours[k]
        dx, dy = agents[other, X] - agents[me, X], agents[other, Y] - agents[me, Y]
        margin = agents[me, MARGIN] + agents[other, MARGIN]  # which yields: not part of the column
        column = WITHIN * (agents[me, RADIUS] + agents[other, RADIUS] - margin)
        if dx * dx + dy * dy >= column * column:
            continue
        dz = agents[other, Z] - agents[me, Z]
        above = dz > 0.0 or (dz == 0.0 and agents[me, ROW] < agents[other, ROW])
        left = rate * max(abs(dz) - vertical, 0.0)
        if agents[other, AVOIDS] > 0.0:
            left *= 0.5
        else:
            left -= max(-agents[other, CLIMB] if above else agents[other, CLIMB], 0.0)
        if above:
            up = min(up, max(left, 0.0))
        else:
            down = min(down, max(left, 0.0))
    return min(max(wish, -down), up)
