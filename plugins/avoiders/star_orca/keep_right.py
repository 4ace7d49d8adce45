"""Rule of the road: resolves symmetric encounters by turning right.

ORCA alone resolves a symmetric encounter symmetrically: agents that swap positions across a circle
stop in a ring, and one whose path leads through the center of a parked agent stops before it.
Noise would break the symmetry some day. If all of them turn right, it breaks sooner, and the same
way in every run.

The turn has to start early. Once agents stand in a ring, side by side, the half-planes of its two
neighbours stop an agent that turns by less than the angle between it and them. So a small turn
starts when any agent is ahead, not only when one is in the way. If that was not enough and the
other agents block an agent, its preferred velocity is turned fully sideways: the ring rotates until
its paths open.

Where one side is clearly the shorter, both agents take it: an agent that turned right there would
stay in front of the other and be pushed along by it. A parked agent does not turn with the others.
It is passed on the side that has room; otherwise an agent would fly around a whole ring of parked
agents to keep them on its left.

Two groups that meet head on, in a corridor or in the open, mix and stall if each agent gives way
only when another is near. If each agent keeps to the right of all oncoming agents as soon as they
are within sight, lanes have formed before the groups meet.
"""

from __future__ import annotations

import math

from star_core import Array, Rows
from star_core.toolkit import subroutine
from star_orca.neighbours import AVOIDS, RADIUS, REACH, VX, VY, WISH_X, WISH_Y, X, Y, Z

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
        agents: (M, 16) table of `star_orca.neighbours.sort_into_cells`.
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


OPPOSITE = math.cos(math.radians(45.0))  # preferred velocities within this angle of head on

# Sums of two radii: oncoming agents that pass farther away than this on the right stay there. A
# corridor 8 radii wide has its outermost lanes 6 radii apart; so all that come through it are kept
# on the left.
BAND = 3.0

STEEPEST = math.radians(35.0)  # a turn costs 1 - cos of it in speed: 18 %


@subroutine
def lane_turn(
    agents: Array,
    me: int,
    cells: tuple[int, Rows, int],
    limits: tuple[float, float],
    x: float,
    y: float,
) -> float:
    """Return the angle by which an agent turns right for oncoming agents, rad.

    Each of the two moves aside, over half of the distance between them, by half of what is missing
    until they pass left of each other at the sum of their radii. The turn is the largest that any
    oncoming agent requires, at most `STEEPEST`. Agents nearer than the sum of the radii are
    ignored.

    Args:
        agents: (M, 16) table of `star_orca.neighbours.sort_into_cells`.
        me: Row in it of the agent.
        cells: The cell it is in, (C + 1,) row at which each cell begins, and their number along x.
        limits: Greatest distance ahead and greatest difference in height considered, m.
        x: Preferred velocity along x, m/s: the direction that counts as ahead.
        y: Preferred velocity along y, m/s.
    """
    pace = math.sqrt(x * x + y * y)
    if pace < SLOW:
        return 0.0
    x, y = x / pace, y / pace
    cell, start, columns = cells
    rows = (len(start) - 1) // columns
    my_row, my_column = cell // columns, cell % columns
    first, last = max(my_column - REACH, 0), min(my_column + REACH, columns - 1)
    steepest = 0.0
    for row in range(max(my_row - REACH, 0), min(my_row + REACH, rows - 1) + 1):
        for other in range(start[row * columns + first], start[row * columns + last + 1]):
            dx, dy = agents[other, X] - agents[me, X], agents[other, Y] - agents[me, Y]
            ahead, left = x * dx + y * dy, x * dy - y * dx
            apart = agents[me, RADIUS] + agents[other, RADIUS]
            if not apart < ahead < limits[0] or left < -BAND * apart:
                continue
            if apart - left <= steepest * ahead or agents[other, AVOIDS] == 0.0:
                continue
            wx, wy = agents[other, WISH_X], agents[other, WISH_Y]
            its_pace = math.sqrt(wx * wx + wy * wy)
            comes = x * wx + y * wy < -OPPOSITE * its_pace and its_pace > SLOW
            if comes and abs(agents[other, Z] - agents[me, Z]) <= limits[1]:
                steepest = (apart - left) / ahead
    return min(math.atan(steepest), STEEPEST)
