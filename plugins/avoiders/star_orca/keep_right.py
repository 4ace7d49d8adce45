"""The rule of the road that gets two agents past each other when neither side is the shorter.

ORCA alone answers a symmetric meeting symmetrically: agents that change places across a circle stop
in a ring, and one whose way leads through the middle of a parked one stops before it. Noise would
free them some day. A turn to the right by all of them frees them sooner, and the same way in every
run.

It has to come early. Once agents stand in a ring, shoulder to shoulder, the half-planes of the two
beside it stop an agent that turns by less than the angle between it and them; so a small turn
begins when anybody is ahead, not when somebody is in the way. Where that was not enough and an
agent gets nowhere for the others, it wants to go to the side altogether: the ring goes round until
its ways open. How far a swarm that comes the other way is kept to the left is `star_orca.lanes`.

Where one side is clearly the shorter it is taken, by both: who turned right there would stay in
front of the other and be pushed along by it. One that is parked does not turn with the others. It
is passed on the side that it leaves, else an agent would walk all round a ring of parked ones to
keep them on its left.
"""

from __future__ import annotations

import math

from star_core import Array, Rows, compiled
from star_orca.neighbours import AVOIDS, RADIUS, VX, VY, WISH_X, WISH_Y, X, Y

BLOCKED = 0.05  # of its wish: an agent that gets no more of it gets nowhere
QUARTER = math.radians(90.0)
SLOW = 0.1  # m/s: who neither goes nor wants to go any faster is parked; two whose wishes differ
# by less do not pass each other

# Share of the radii: two that pass each other's middles on the left by more than that go on so. The
# best of 0.15, 0.3 and 0.6 where 32 change ends of a corridor; without it ten times as many stuck.
CLEARLY = 0.3


@compiled
def side_to_take(agents: Array, me: int, neighbours: Rows, count: int, x: float, y: float) -> float:
    """Return 1 if an agent is to turn right for those ahead of it, -1 if left, 0 if nobody is.

    The nearest one ahead decides.

    Args:
        agents: (M, 13) table of `star_orca.neighbours.sort_into_cells`.
        me: Row in it of the agent.
        neighbours: (K,) rows in it of its neighbours.
        count: How many of these to look at.
        x: Wanted velocity along x, m/s: where ahead is.
        y: Wanted velocity along y, m/s.
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
        if agents[other, AVOIDS] > 0.0:
            wx, wy = agents[other, WISH_X], agents[other, WISH_Y]
        else:
            wx, wy = agents[other, VX], agents[other, VY]
        clearly = CLEARLY * (agents[me, RADIUS] + agents[other, RADIUS])
        if wx * wx + wy * wy < SLOW * SLOW:
            wx, wy, clearly = 0.0, 0.0, 0.0
        closing_x, closing_y = x - wx, y - wy
        closing = math.sqrt(closing_x * closing_x + closing_y * closing_y)
        to_the_left = closing_x * dy - closing_y * dx  # is where it passes, times the closing speed
        differ = clearly == 0.0 or closing > SLOW
        side = -1.0 if differ and to_the_left < -clearly * closing else 1.0
    return side


@compiled
def turned_right(x: float, y: float, turn: float) -> tuple[float, float]:
    """Return the vector ``(x, y)`` turned clockwise by `turn`, rad."""
    cos, sin = math.cos(turn), math.sin(turn)
    return cos * x + sin * y, cos * y - sin * x
