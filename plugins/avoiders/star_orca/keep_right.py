"""Rule of the road: resolves symmetric encounters by turning right.

ORCA alone resolves a symmetric encounter symmetrically: agents that swap positions across a circle
stop in a ring, and one whose path leads through the center of a parked agent stops before it.
Noise would break the symmetry some day. If all of them turn right, it breaks sooner, and the same
way in every run.

The turn has to start early. Once agents stand in a ring, side by side, the half-planes of its two
neighbours stop an agent that turns by less than the angle between it and them. So a small turn
starts when any agent is ahead, not only when one is in the way. If that was not enough and the
other agents block an agent, its preferred velocity is turned fully sideways: the ring rotates until
its paths open. `star_orca.lanes` determines how far an oncoming swarm is kept to the left.

Where one side is clearly the shorter, both agents take it: an agent that turned right there would
stay in front of the other and be pushed along by it. A parked agent does not turn with the others.
It is passed on the side that has room; otherwise an agent would fly around a whole ring of parked
agents to keep them on its left.
"""

from __future__ import annotations

import math

from star_core import Array, Rows, subroutine
from star_orca.neighbours import AVOIDS, RADIUS, VX, VY, WISH_X, WISH_Y, X, Y

BLOCKED = 0.05  # share of the preferred speed: an agent that achieves less is blocked
QUARTER = math.radians(90.0)
SLOW = 0.1  # m/s: an agent whose velocity and preferred velocity are below it is parked; two whose
# preferred velocities differ by less do not pass each other

# Share of the sum of the radii: two agents that pass each other's centers on the left by more than
# that continue on the left. The best of 0.15, 0.3 and 0.6 with 32 agents that swap the ends of a
# corridor; without this rule ten times as many got stuck.
CLEARLY = 0.3


@subroutine
def side_to_take(agents: Array, me: int, neighbours: Rows, count: int, x: float, y: float) -> float:
    """Return 1 to turn right for the agents ahead, -1 to turn left, 0 if there are none.

    The nearest agent ahead decides.

    Args:
        agents: (M, 13) table of `star_orca.neighbours.sort_into_cells`.
        me: Row in it of the agent.
        neighbours: (K,) rows in it of its neighbours.
        count: Number of these to use.
        x: Preferred velocity along x, m/s: the direction that counts as ahead.
        y: Preferred velocity along y, m/s.
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


@subroutine
def turned_right(x: float, y: float, turn: float) -> tuple[float, float]:
    """Return the vector ``(x, y)`` turned clockwise by `turn`, rad."""
    cos, sin = math.cos(turn), math.sin(turn)
    return cos * x + sin * y, cos * y - sin * x
