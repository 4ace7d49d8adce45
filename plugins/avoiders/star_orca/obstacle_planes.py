"""Half-planes that keep velocities from leading into obstacles."""

from __future__ import annotations

import math

from star_core import Array, Rows
from star_core.toolkit import YIELD_TIME, subroutine
from star_orca.half_planes import NOTHING, way_out
from star_orca.outlines import (
    A_JUTS,
    AFTER_X,
    AFTER_Y,
    AX,
    AY,
    B_JUTS,
    BEFORE_X,
    BEFORE_Y,
    LENGTH,
    UX,
    UY,
    layer_at,
    nearest_edges,
    nearest_on,
)


@subroutine
def add_obstacles(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    i: int,
    position: Array,
    velocity: Array,
    speed: Array,
    margin: Array,
    edges: Array,
    first: Rows,
    height: Array,
    horizon: float,
    clearance: float,
    virtual: bool,  # noqa: FBT001 -- numba takes no keywords cheaply
    edge_buffers: tuple[Rows, Array],
    planes: Array,
    count: int,
) -> int:
    """Add the half-planes of obstacles for an agent, and return the new number of half-planes.

    The margin of an agent that is near to an obstacle yields: see `yielding_margin`.

    Args:
        i: Row of the agent; its position is finite.
        position: (N, 3) m.
        velocity: (N, 3) m/s; agents without a finite velocity are treated as stationary.
        speed: (N,) speed limit, m/s.
        margin: (N,) by which the clearance is enlarged for an uncertain position, m.
        edges: Of `star_orca.outlines.Outlines`, as are `first` and `height`.
        first: (L + 1,)
        height: (L - 1,)
        horizon: Time in which no agent shall hit an obstacle, s.
        clearance: Distance to keep to obstacles, m.
        virtual: Whether obstacles are virtual agents instead of RVO2's half-planes.
        edge_buffers: Room for the rows of the nearest edges, and for their squared distances.
        planes: (H, 3) half-planes.
        count: Their number.
    """
    x, y = position[i, 0], position[i, 1]
    layer = layer_at(position[i, 2], height)
    span = (first[layer], first[layer + 1])
    if span[0] == span[1]:
        return count
    vx, vy = velocity[i, 0], velocity[i, 1]
    if not math.isfinite(vx + vy):
        vx, vy = 0.0, 0.0
    flight = (x, y, vx, vy)
    rate = 1.0 / horizon
    kept, reach = clearance, horizon * speed[i] + clearance + margin[i]
    near = nearest_edges(edges, span, x, y, reach, edge_buffers)
    if margin[i] > 0.0 and near > 0:
        room_left = math.sqrt(edge_buffers[1][0]) - clearance
        firm = max(1.0 - horizon / YIELD_TIME, 0.0)
        kept += min(margin[i], firm * max(room_left, 0.0))
    for k in range(near):
        if virtual:
            count = virtual_agent(edges, edge_buffers[0][k], flight, kept, rate, planes, count)
        else:
            count = obstacle_plane(edges, edge_buffers[0][k], flight, kept, rate, planes, count)
    return count


COVERED = 1e-5  # m/s: a velocity obstacle that extends less beyond another edge's is ignored


@subroutine
def obstacle_plane(
    edges: Array,
    row: int,
    agent: tuple[float, float, float, float],
    clearance: float,
    rate: float,
    planes: Array,
    count: int,
) -> int:
    """Add the half-plane of an edge to `planes`, and return the new number of half-planes.

    The velocity obstacle of an edge contains all velocities that lead to within the clearance of it
    in ``1 / rate``: a truncated cone. The half-plane touches it where it is nearest to the agent's
    velocity, since obstacles do not give way: van den Berg et al. (2011) on static obstacles. As in
    RVO2, a side of the cone that leads along the solid's next edge is handled by that edge, and an
    edge whose velocity obstacle another half-plane forbids adds none. Within the clearance RVO2
    only forbids to come nearer; here, the agent must move out as quickly as it may approach from
    outside.

    Computed along the edge (s) and out of the solid (o), with the agent at the origin and all
    lengths divided by the time horizon, so that they are velocities.

    Args:
        edges: (E, 13) table of `star_orca.outlines.Outlines`.
        row: Row of the edge; the agent is on its outer side.
        agent: x, y, m, and velocity along x and y, m/s.
        clearance: Distance to keep, m.
        rate: One over the time horizon, 1/s.
        planes: (K, 3) half-planes as in `star_orca.half_planes`.
        count: Number of half-planes in it.
    """
    ux, uy = edges[row, UX], edges[row, UY]
    dx, dy = edges[row, AX] - agent[0], edges[row, AY] - agent[1]
    begin = rate * (dx * ux + dy * uy)
    end = begin + rate * edges[row, LENGTH]
    off = rate * (dy * ux - dx * uy)  # how far the agent is from the edge's line
    size = rate * clearance
    if _covered(planes, count, (ux, uy), (begin, end, off), size):
        return count
    juts_a, juts_b = edges[row, A_JUTS] > 0.0, edges[row, B_JUTS] > 0.0
    hollow = (begin > 0.0 and not juts_a) or (end < 0.0 and not juts_b)
    if hollow and off <= size:
        return count  # nothing of it is nearer than the edges beside it
    s, o, c = 0.0, 0.0, 0.0
    nearest = min(max(begin, 0.0), end) if end > 0.0 else end
    distance = math.sqrt(nearest * nearest + off * off)
    if distance <= size:
        s, o = (-nearest / distance, off / distance) if distance > NOTHING else (0.0, 1.0)
        c = size - distance
    else:
        before = edges[row, BEFORE_X] * ux + edges[row, BEFORE_Y] * uy
        before_out = edges[row, BEFORE_Y] * ux - edges[row, BEFORE_X] * uy
        after = edges[row, AFTER_X] * ux + edges[row, AFTER_Y] * uy
        after_out = edges[row, AFTER_X] * uy - edges[row, AFTER_Y] * ux
        if off <= size and begin > 0.0:  # seen from its end: no more than a corner
            end, juts_b, after, after_out = begin, juts_a, 1.0, 0.0
        elif off <= size and end < 0.0:
            begin, juts_a, before, before_out = end, juts_b, 1.0, 0.0
        vs, vo = agent[2] * ux + agent[3] * uy, agent[2] * uy - agent[3] * ux
        leg_a = _leg(-begin, off, size, juts_a, before, before_out)
        leg_b = _leg(end, off, size, juts_b, after, after_out)
        s, o, c = _touch((vs, vo + off), (begin, end), leg_a, leg_b)
        if s == 0.0 and o == 0.0:
            return count
        c += size - o * off
    planes[count, 0], planes[count, 1] = s * ux + o * uy, s * uy - o * ux
    planes[count, 2] = c
    return count + 1


@subroutine
def _covered(
    planes: Array,
    count: int,
    along: tuple[float, float],
    edge: tuple[float, float, float],
    size: float,
) -> bool:
    """Whether one of the half-planes forbids every velocity that leads to an edge."""
    begin, end, off = edge
    for k in range(count):
        s = planes[k, 0] * along[0] + planes[k, 1] * along[1]
        o = planes[k, 0] * along[1] - planes[k, 1] * along[0]
        if max(s * begin, s * end) - o * off + size <= planes[k, 2] + COVERED:
            return True
    return False


@subroutine
def _leg(
    end: float,
    off: float,
    size: float,
    juts: bool,  # noqa: FBT001 -- numba takes no keywords cheaply
    onwards: float,
    onwards_out: float,
) -> tuple[float, float, bool]:
    """Return the direction of one side of the cone, and whether the next edge handles it.

    Args:
        end: End of the edge, measured outwards along it.
        off: Distance of the agent from its line.
        size: Radius of the disc around the end.
        juts: Whether the corner is convex; a side that ends in a concave one follows the edge.
        onwards: Direction of the next edge, outwards along this one.
        onwards_out: The same, out of the solid.
    """
    if not juts:
        return 1.0, 0.0, False
    squared = end * end + off * off
    tangent = math.sqrt(max(squared - size * size, 0.0))
    s = (end * tangent + off * size) / squared
    o = (end * size - off * tangent) / squared
    if s * onwards_out - o * onwards >= 0.0:
        return onwards, onwards_out, True
    return s, o, False


@subroutine
def _touch(
    velocity: tuple[float, float],
    ends: tuple[float, float],
    leg_a: tuple[float, float, bool],
    leg_b: tuple[float, float, bool],
) -> tuple[float, float, float]:
    """Return the normal of the tangent half-plane nearest to a velocity, and its offset.

    The normal is 0 where another edge handles the touching side.

    Args:
        velocity: Along the edge, and out from its line.
        ends: Begin and end of the edge; equal where only a corner is visible.
        leg_a: Side of the cone at the beginning, as `_leg` returns it.
        leg_b: Side at the end.
    """
    s, o = velocity
    begin, end = ends
    corner = begin == end
    along_a = (begin - s) * leg_a[0] + o * leg_a[1]
    along_b = (s - end) * leg_b[0] + o * leg_b[1]
    at_a = (s < begin and along_a < 0.0 and not corner) or (
        corner and along_a < 0.0 and along_b < 0.0
    )
    at_b = s > end and along_b < 0.0 and not corner
    if at_a or at_b:
        end_along = begin if at_a else end
        length = math.sqrt((s - end_along) ** 2 + o * o)
        if length <= NOTHING:
            return 0.0, 1.0, 0.0
        return (s - end_along) / length, o / length, (s - end_along) / length * end_along
    front = o * o if begin <= s <= end and not corner else math.inf
    side_a = (begin - s) ** 2 + o * o - along_a**2 if along_a >= 0.0 else math.inf
    side_b = (s - end) ** 2 + o * o - along_b**2 if along_b >= 0.0 else math.inf
    if front <= side_a and front <= side_b:
        return 0.0, 1.0, 0.0
    if leg_a[2] if side_a <= side_b else leg_b[2]:
        return 0.0, 0.0, 0.0
    if side_a <= side_b:
        return leg_a[1], leg_a[0], leg_a[1] * begin
    return -leg_b[1], leg_b[0], -leg_b[1] * end


@subroutine
def virtual_agent(
    edges: Array,
    row: int,
    agent: tuple[float, float, float, float],
    clearance: float,
    rate: float,
    planes: Array,
    count: int,
) -> int:
    """Add the half-plane of an edge's virtual agent to `planes`, and return their new number.

    The virtual agent has no size, does not give way, and is kept at the clearance. Replacing a
    large obstacle by such points is the idea of the original STAR, which placed them at fixed
    steps, with gaps between them. Here the point moves along with the agent, so there are no gaps.
    Within the clearance the agent must move out as quickly as it may approach from outside.

    Args:
        edges: (E, 13) table of `star_orca.outlines.Outlines`.
        row: Row of the edge.
        agent: x, y, m, and velocity along x and y, m/s.
        clearance: Distance to keep, m.
        rate: One over the time horizon, 1/s.
        planes: (K, 3) half-planes as in `star_orca.half_planes`.
        count: Number of half-planes in it.
    """
    x, y, vx, vy = agent
    dx, dy = nearest_on(edges, row, x, y)
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > clearance:
        a, b, outwards = way_out(dx, dy, vx, vy, clearance, rate, 1.0)
        c = a * vx + b * vy + outwards
    else:
        a, b = edges[row, UY], -edges[row, UX]
        if distance > NOTHING:
            a, b = -dx / distance, -dy / distance
        c = rate * (clearance - distance)
    planes[count, 0], planes[count, 1], planes[count, 2] = a, b, c
    return count + 1
