"""Lanes: how far an agent turns right so that who comes the other way passes on its left.

Two groups that meet head on, in a corridor or in the open, mix if each agent first gives way when
another is near, and stand. If each keeps to the right of all that it sees coming, from as far as it
sees them, lanes have formed before the groups meet.
"""

from __future__ import annotations

import math

from star_core import Array, Rows, compiled
from star_orca.keep_right import SLOW
from star_orca.neighbours import AVOIDS, RADIUS, REACH, WISH_X, WISH_Y, X, Y, Z

OPPOSITE = math.cos(math.radians(45.0))  # of two wishes: within so much of head on

# Radii, both together: who passes farther away than this on the right is left there. A corridor of
# 8 radii has its outermost lanes 6 apart; so all that come through it are kept on the left.
BAND = 3.0

STEEPEST = math.radians(35.0)  # a turn costs 1 - cos of it in speed: 18 %


@compiled
def lane_turn(
    agents: Array,
    me: int,
    cells: tuple[int, Rows, int],
    limits: tuple[float, float],
    x: float,
    y: float,
) -> float:
    """Return by how much an agent turns right for those that come the other way, rad.

    Each of the two has half of the way to the other in which to move aside by half of what is
    missing until they pass left of each other at the sum of their radii: the turn is what the worst
    of them takes, `STEEPEST` at most. Who is nearer than the sum of the radii is past that.

    Args:
        agents: (M, 13) table of `star_orca.neighbours.sort_into_cells`.
        me: Row in it of the agent.
        cells: The cell it is in, (C + 1,) row at which each cell begins, and their number along x.
        limits: How far ahead and how far apart in height others count, m.
        x: Wanted velocity along x, m/s: where ahead is.
        y: Wanted velocity along y, m/s.
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
