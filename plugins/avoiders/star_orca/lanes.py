"""Lane formation: turns agents right so that oncoming agents pass on their left.

Two groups that meet head on, in a corridor or in the open, mix and stall if each agent gives way
only when another is near. If each agent keeps to the right of all oncoming agents as soon as they
are within sight, lanes have formed before the groups meet.
"""

from __future__ import annotations

import math

from star_core import Array, Rows, subroutine
from star_orca.keep_right import SLOW
from star_orca.neighbours import AVOIDS, RADIUS, REACH, WISH_X, WISH_Y, X, Y, Z

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
        agents: (M, 13) table of `star_orca.neighbours.sort_into_cells`.
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
