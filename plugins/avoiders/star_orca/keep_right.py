"""The rule of the road that gets two agents past each other when neither side is the shorter.

ORCA alone answers a symmetric meeting symmetrically: agents that change places across a circle stop
in a ring, and one whose way leads through the middle of a parked one stops before it. Noise would
free them some day. A turn to the right by all of them frees them sooner, and the same way in every
run.

It has to come early. Once agents stand in a ring, shoulder to shoulder, the half-planes of the two
beside it stop an agent that turns by less than the angle between it and them; so a small turn
begins when anybody is ahead, not when somebody is in the way. Where that was not enough and an
agent gets nowhere for the others, it wants to go to the side altogether: the ring goes round until
its ways open.

One that is parked does not turn with the others. It is passed on the side that it leaves, else an
agent would walk all round a ring of parked ones to keep them on its left.
"""

from __future__ import annotations

import math

from star_core import Array, Rows, compiled
from star_orca.neighbours import AVOIDS, ROW, VX, VY, X, Y

BLOCKED = 0.05  # of its wish: an agent that gets no more of it gets nowhere
QUARTER = math.radians(90.0)
PARKED = 0.1  # m/s: one that neither goes nor wants to go any faster is parked


@compiled
def side_to_take(
    agents: Array, me: int, neighbours: Rows, count: int, x: float, y: float, wish: Array
) -> float:
    """Return 1 if an agent is to turn right for those ahead of it, -1 if left, 0 if nobody is.

    The nearest one ahead decides.

    Args:
        agents: (M, 9) table of `star_orca.neighbours.sort_into_cells`.
        me: Row in it of the agent.
        neighbours: (K,) rows in it of its neighbours.
        count: How many of these to look at.
        x: Wanted velocity along x, m/s: where ahead is.
        y: Wanted velocity along y, m/s.
        wish: (N, 3) wanted velocity of everybody, m/s.
    """
    side, least = 0.0, math.inf
    for k in range(count):
        other = neighbours[k]
        dx = agents[other, X] - agents[me, X]
        dy = agents[other, Y] - agents[me, Y]
        squared = dx * dx + dy * dy
        if x * dx + y * dy <= 0.0 or squared >= least:
            continue
        least = squared
        i = int(agents[other, ROW])
        if agents[other, AVOIDS] > 0.0:
            wx, wy = wish[i, 0], wish[i, 1]
        else:
            wx, wy = agents[other, VX], agents[other, VY]
        to_the_right = x * dy - y * dx < 0.0
        side = -1.0 if to_the_right and wx * wx + wy * wy < PARKED * PARKED else 1.0
    return side


@compiled
def turned_right(x: float, y: float, turn: float) -> tuple[float, float]:
    """Return the vector ``(x, y)`` turned clockwise by `turn`, rad."""
    cos, sin = math.cos(turn), math.sin(turn)
    return cos * x + sin * y, cos * y - sin * x
