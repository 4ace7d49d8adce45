"""The velocity obstacles of discs, and the half-planes of velocities that avoid each neighbour."""

from __future__ import annotations

import math

from star_core import Array, Rows
from star_core.toolkit import MAX_MARGIN_RATIO, YIELD_TIME, subroutine
from star_orca.neighbours import (
    AVOIDS,
    CLIMB,
    GOAL_X,
    GOAL_Y,
    MARGIN,
    RADIUS,
    ROW,
    VX,
    VY,
    X,
    Y,
    Z,
)

WIDE = 0.2  # m, of two agents: a wider margin grows with the drift while they approach
COLUMN = 1.0  # s, in which two agents one above the other must be apart horizontally


@subroutine
def half_planes(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    agents: Array,
    me: int,
    neighbours: Rows,
    count: int,
    horizon: float,
    period: float,
    vertical: float,
    wide_yield_time: float,
    planes: Array,
    hard: int,
) -> None:
    """Fill `planes` with the half-plane of permitted velocities of each neighbour.

    Row ``(a, b, c)`` permits a velocity ``(x, y)`` with ``a x + b y >= c``, where ``(a, b)`` is a
    unit vector. It is the half-plane of van den Berg, Guy, Lin and Manocha, "Reciprocal n-Body
    Collision Avoidance" (2011): the agent makes its share of the least change that brings the
    relative velocity out of the velocity obstacle: half of it for a neighbour that avoids too, and
    all of it for one that does not. The velocity obstacle is that of the section of an ellipsoid,
    `vertical` high, at the least difference in height within the horizon. Two agents that already
    overlap must be apart after one period, or after `COLUMN` if one is above the other. The margins
    for uncertain positions yield: see `star_core.toolkit.yielding_margin`. `WIDE` ones yield with
    another time constant where both agents fly to goals farther apart than the widest margins.

    Two agents at the same point with the same velocity have no direction to separate along: they
    separate along x, the earlier row forwards.

    Args:
        agents: (M, 16) table of `sort_into_cells`.
        me: Row in it of the avoiding agent.
        neighbours: (K,) rows in it of its neighbours.
        count: Number of these to use.
        horizon: Time for which the agents shall not collide, s.
        period: Time in which two overlapping agents shall separate, s.
        vertical: Difference in height at which agents need no distance, m.
        wide_yield_time: Time constant with which wide margins yield, s.
        planes: (K, 3) output: half-planes in the order of the neighbours, m/s.
        hard: Row of the first in it.
    """
    px, py, vx, vy = agents[me, X], agents[me, Y], agents[me, VX], agents[me, VY]
    soft = max(1.0 - horizon / YIELD_TIME, 0.0)
    firm = max(1.0 - horizon / wide_yield_time, 0.0)
    for k in range(count):
        other = neighbours[k]
        dx, dy = agents[other, X] - px, agents[other, Y] - py  # from me to the other
        ux, uy = vx - agents[other, VX], vy - agents[other, VY]  # how I close in on it
        share = 0.5 if agents[other, AVOIDS] > 0.0 else 1.0
        dz = agents[other, Z] - agents[me, Z]
        then = dz + horizon * (agents[other, CLIMB] - agents[me, CLIMB])
        margin = agents[me, MARGIN] + agents[other, MARGIN]
        widest = apart = agents[me, RADIUS] + agents[other, RADIUS] - margin
        if dz * then > 0.0:
            least = min(abs(dz), abs(then)) / vertical
            section = math.sqrt(max(1.0 - least * least, 0.0))
            apart *= section
            margin *= section
        squared = dx * dx + dy * dy
        if margin > 0.0:
            gx = agents[other, GOAL_X] - agents[me, GOAL_X]
            gy = agents[other, GOAL_Y] - agents[me, GOAL_Y]
            at_goals = (1.0 + MAX_MARGIN_RATIO) * widest
            keeps = margin > WIDE and gx * gx + gy * gy > at_goals * at_goals
            kept = firm if keeps else soft
            apart += min(margin, kept * max(math.sqrt(squared) - apart, 0.0))
        rate = 1.0 / horizon
        if squared <= apart * apart:
            near = squared + dz * dz <= widest * widest
            rate = 1.0 / period if near else max(rate, 1.0 / COLUMN)
        forwards = 1.0 if agents[me, ROW] < agents[other, ROW] else -1.0
        a, b, outwards = way_out(dx, dy, ux, uy, apart, rate, forwards)
        planes[hard + k, 0], planes[hard + k, 1] = a, b
        planes[hard + k, 2] = a * vx + b * vy + share * outwards


NOTHING = 1e-12  # m or m/s: shorter vectors have no meaningful direction


@subroutine
def way_out(
    dx: float, dy: float, ux: float, uy: float, apart: float, rate: float, forwards: float
) -> tuple[float, float, float]:
    """Return the normal of a velocity obstacle at the point nearest to a velocity, and a length.

    The least change that brings the velocity out of the velocity obstacle is the length times the
    normal, a unit vector ``(a, b)``; the length is negative if the velocity is outside already. The
    velocity obstacle contains all velocities that lead into the disc within ``1 / rate``: van den
    Berg, Guy, Lin and Manocha, "Reciprocal n-Body Collision Avoidance" (2011). Inside the disc,
    the change leads out of it in that time.

    Args:
        dx: Center of the disc relative to the agent, along x, m.
        dy: The same along y, m.
        ux: Velocity relative to the disc along x, m/s.
        uy: The same along y, m/s.
        apart: Radius of the disc, m.
        rate: One over the time horizon, 1/s.
        forwards: 1 or -1: direction along x to separate in where the geometry defines none.
    """
    squared = dx * dx + dy * dy
    wx, wy = ux - rate * dx, uy - rate * dy  # from the centre of the cut-off disc
    length = wx * wx + wy * wy
    along = wx * dx + wy * dy
    inside = squared <= apart * apart
    if inside or (along < 0.0 and along * along > apart * apart * length):
        length = math.sqrt(length)
        if length > NOTHING:
            a, b = wx / length, wy / length
        elif math.sqrt(squared) > NOTHING:
            a, b = -dx / math.sqrt(squared), -dy / math.sqrt(squared)
        else:
            a, b = forwards, 0.0
        return a, b, apart * rate - length
    leg = math.sqrt(squared - apart * apart)
    if dx * wy - dy * wx > 0.0:
        a, b = -(dx * apart + dy * leg) / squared, (dx * leg - dy * apart) / squared
    else:  # dead ahead belongs to the right leg, as it does in RVO2
        a, b = (dy * leg - dx * apart) / squared, -(dx * leg + dy * apart) / squared
    return a, b, -(a * ux + b * uy)
