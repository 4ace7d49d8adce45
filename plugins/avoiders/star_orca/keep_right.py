"""The rule of the road that gets two agents past each other when neither side is the shorter.

ORCA alone answers a symmetric meeting symmetrically: agents that change places across a circle stop
in a ring, and one whose way leads through the middle of a parked one stops before it. Noise would
free them some day. A turn to the right by all of them frees them sooner, and the same way in every
run.

It has to come early. Once agents stand in a ring, shoulder to shoulder, the half-planes of the two
beside it stop an agent that turns by less than the angle between it and them; so a small turn
begins when anybody is ahead, not when somebody is in the way. Where that was not enough and an
agent gets nowhere for the others, it wants to go to the right altogether: the ring goes round until
its ways open.
"""

from __future__ import annotations

import math

from star_core import Array, Rows, compiled
from star_orca.neighbours import X, Y

BLOCKED = 0.05  # of its wish: an agent that gets no more of it gets nowhere
QUARTER = math.radians(90.0)


@compiled
def anybody_ahead(agents: Array, me: int, neighbours: Rows, count: int, x: float, y: float) -> bool:
    """Return whether any neighbour is ahead of an agent.

    Args:
        agents: (M, 9) table of `star_orca.neighbours.sort_into_cells`.
        me: Row in it of the agent.
        neighbours: (K,) rows in it of its neighbours.
        count: How many of these to look at.
        x: Wanted velocity along x, m/s: where ahead is.
        y: Wanted velocity along y, m/s.
    """
    for k in range(count):
        dx = agents[neighbours[k], X] - agents[me, X]
        dy = agents[neighbours[k], Y] - agents[me, Y]
        if x * dx + y * dy > 0.0:
            return True
    return False


@compiled
def turned_right(x: float, y: float, turn: float) -> tuple[float, float]:
    """Return the vector ``(x, y)`` turned clockwise by `turn`, rad."""
    cos, sin = math.cos(turn), math.sin(turn)
    return cos * x + sin * y, cos * y - sin * x
