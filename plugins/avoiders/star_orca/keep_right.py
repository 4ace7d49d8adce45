"""The rule of the road that gets two agents past each other when neither side is the shorter."""

from __future__ import annotations

import math

from star_core import Array, Rows
from star_orca.compiled import compiled
from star_orca.neighbours import X, Y


@compiled
def keep_right(
    agents: Array, me: int, neighbours: Rows, count: int, x: float, y: float, turn: float
) -> tuple[float, float]:
    """Return the wish ``(x, y)``, turned right by `turn` if any neighbour is ahead of it.

    ORCA alone answers a symmetric meeting symmetrically: agents that change places across a circle
    stop in a ring, and one whose way leads through the middle of a parked one stops before it.
    Noise would free them some day. A turn to the right by all of them frees them at once, and the
    same way in every run.

    It has to come early. Once agents stand in a ring, shoulder to shoulder, the half-planes of the
    two beside it stop an agent that turns by less than the angle between it and them; so the turn
    begins when anybody is ahead, not when somebody is in the way. With nobody ahead the wish is
    the agent's own, to the bit.

    Args:
        agents: (M, 8) table of `star_orca.neighbours.sort_into_cells`.
        me: Row in it of the agent whose wish it is.
        neighbours: (K,) rows in it of its neighbours.
        count: How many of these to look at.
        x: Wanted velocity along x, m/s.
        y: Wanted velocity along y, m/s.
        turn: How far to turn right, rad.
    """
    for k in range(count):
        dx = agents[neighbours[k], X] - agents[me, X]
        dy = agents[neighbours[k], Y] - agents[me, Y]
        if x * dx + y * dy > 0.0:
            cos, sin = math.cos(turn), math.sin(turn)
            return cos * x + sin * y, cos * y - sin * x
    return x, y
