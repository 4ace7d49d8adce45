"""The velocities that avoid each neighbour: one half-plane per neighbour."""

from __future__ import annotations

from star_core import Array, Rows, subroutine
from star_orca.neighbours import AVOIDS, RADIUS, ROW, VX, VY, X, Y, Z
from star_orca.velocity_obstacle import way_out

COLUMN = 1.0  # s, in which two agents one above the other must be apart horizontally


@subroutine
def half_planes(
    agents: Array,
    me: int,
    neighbours: Rows,
    count: int,
    horizon: float,
    period: float,
    planes: Array,
    hard: int,
) -> None:
    """Fill `planes` with the half-plane of permitted velocities of each neighbour.

    Row ``(a, b, c)`` permits a velocity ``(x, y)`` with ``a x + b y >= c``, where ``(a, b)`` is a
    unit vector. It is the half-plane of van den Berg, Guy, Lin and Manocha, "Reciprocal n-Body
    Collision Avoidance" (2011): the agent makes its share of the least change that brings the
    relative velocity out of the velocity obstacle: half of it for a neighbour that avoids too, and
    all of it for one that does not. Two agents that already overlap must be apart after one period,
    or after `COLUMN` if one is above the other.

    Two agents at the same point with the same velocity have no direction to separate along: they
    separate along x, the earlier row forwards.

    Args:
        agents: (M, 13) table of `sort_into_cells`.
        me: Row in it of the avoiding agent.
        neighbours: (K,) rows in it of its neighbours.
        count: Number of these to use.
        horizon: Time for which the agents shall not collide, s.
        period: Time in which two overlapping agents shall separate, s.
        planes: (K, 3) output: half-planes in the order of the neighbours, m/s.
        hard: Row of the first in it.
    """
    px, py, vx, vy = agents[me, X], agents[me, Y], agents[me, VX], agents[me, VY]
    for k in range(count):
        other = neighbours[k]
        dx, dy = agents[other, X] - px, agents[other, Y] - py  # from me to the other
        ux, uy = vx - agents[other, VX], vy - agents[other, VY]  # how I close in on it
        apart = agents[me, RADIUS] + agents[other, RADIUS]
        share = 0.5 if agents[other, AVOIDS] > 0.0 else 1.0
        dz = agents[other, Z] - agents[me, Z]
        squared = dx * dx + dy * dy
        rate = 1.0 / horizon
        if squared + dz * dz <= apart * apart:
            rate = 1.0 / period
        elif squared <= apart * apart:
            rate = max(rate, 1.0 / COLUMN)
        forwards = 1.0 if agents[me, ROW] < agents[other, ROW] else -1.0
        a, b, outwards = way_out(dx, dy, ux, uy, apart, rate, forwards)
        planes[hard + k, 0], planes[hard + k, 1] = a, b
        planes[hard + k, 2] = a * vx + b * vy + share * outwards
