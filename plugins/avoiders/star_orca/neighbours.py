"""Who is near whom: agents sorted into square cells, and the nearest few of each."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Rows, compiled

# Columns of the table that `sort_into_cells` makes: one row per agent, in the order of the cells.
X, Y, Z, VX, VY, RADIUS, AVOIDS, ROW, CLIMB, WISH_X, WISH_Y, WISH_Z, SPEED = range(13)
COLUMNS = 13

REACH = 2  # cells of half the neighbour distance are searched this far to either side
FEW = 48  # up to so many agents looking at all of them is quicker than sorting


@compiled
def sort_into_cells(
    position: Array,
    velocity: Array,
    wish: Array,
    radius: Array,
    speed: Array,
    avoids: Mask,
    reach: float,
) -> tuple[Array, Rows, Rows, int]:
    """Return the agents in the order of the cells they are in, and where each cell begins.

    All that is known of an agent stands together: who looks at an agent's neighbours in this order
    finds most of them in the processor's cache.

    An agent whose position is not finite is nowhere and is left out; one whose velocity is not
    finite counts as at rest.

    Args:
        position: (N, 3) m.
        velocity: (N, 3) m/s.
        wish: (N, 3) wanted velocity, m/s: how an agent that avoids is going to climb. One that does
            not goes on climbing as it does.
        radius: (N,) m.
        speed: (N,) greatest speed, m/s.
        avoids: (N,) whether the agent gives way.
        reach: How far neighbours are looked for, m.

    Returns:
        (M, 13) table with the columns named above, (M,) cell of each of its rows, (C + 1,) row at
        which each cell begins, and the number of cells along x.
    """
    where, columns, rows = cells(position, reach)
    start = np.zeros(columns * rows + 1, np.int64)
    for c in where:
        if c >= 0:
            start[c + 1] += 1
    for c in range(columns * rows):
        start[c + 1] += start[c]

    agents = np.empty((start[-1], COLUMNS))
    cell = np.empty(start[-1], np.int64)
    filled = start.copy()
    for i, c in enumerate(where):
        if c < 0:
            continue
        k = filled[c]
        filled[c] += 1
        cell[k] = c
        moves = math.isfinite(velocity[i, 0] + velocity[i, 1])
        agents[k, X], agents[k, Y], agents[k, Z] = position[i, 0], position[i, 1], position[i, 2]
        agents[k, VX] = velocity[i, 0] if moves else 0.0
        agents[k, VY] = velocity[i, 1] if moves else 0.0
        agents[k, RADIUS] = radius[i]
        agents[k, AVOIDS] = 1.0 if avoids[i] else 0.0
        agents[k, ROW] = i
        climb = wish[i, 2] if avoids[i] else velocity[i, 2]
        agents[k, CLIMB] = climb if math.isfinite(climb) else 0.0
        agents[k, WISH_X], agents[k, WISH_Y], agents[k, WISH_Z] = wish[i, 0], wish[i, 1], wish[i, 2]
        agents[k, SPEED] = speed[i]
    return agents, cell, start, columns


@compiled
def cells(position: Array, communication_radius: float) -> tuple[Rows, int, int]:
    """Return the cell of each agent, and the number of cells along x and along y.

    Cells are counted along x first. The cell of an agent whose position is not finite is -1; where
    agents are `FEW` all of them are in one cell.

    Args:
        position: (N, 3) m.
        communication_radius: How far neighbours are looked for, m.
    """
    left, right, low, high, m = math.inf, -math.inf, math.inf, -math.inf, 0
    where = np.full(len(position), -1)
    for i, (x, y, z) in enumerate(position):
        if math.isfinite(x + y + z):
            left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
            where[i] = 0
            m += 1
    if m <= FEW:
        return where, 1, 1
    side = max(communication_radius / REACH, (right - left) / m, (high - low) / m)
    while ((right - left) / side + 1) * ((high - low) / side + 1) > 4 * m:
        side *= 2  # a few cells per agent are enough, however far apart the agents are
    columns, rows = int((right - left) / side) + 1, int((high - low) / side) + 1
    for i, (x, y, _) in enumerate(position):
        if where[i] == 0:
            where[i] = int((y - low) / side) * columns + int((x - left) / side)
    return where, columns, rows


@compiled
def nearest(
    agents: Array,
    me: int,
    cell: int,
    start: Rows,
    columns: int,
    limits: tuple[float, float, float],
    found: Rows,
    distance: Array,
) -> int:
    """Fill `found` with the nearest agents, nearest first, and return how many there are.

    An agent that is out of reach in height, and stays so as both climb or sink, is none of them.

    Args:
        agents: (M, 13) table of `sort_into_cells`.
        me: Row in it whose neighbours are looked for.
        cell: The cell it is in.
        start: (C + 1,) row at which each cell begins.
        columns: Number of cells along x.
        limits: How far away in the plane and how far apart in height a neighbour may be, m, and
            for how long it must stay farther apart in height to be none, s.
        found: (K,) where the neighbours' rows go; no more than K are looked for.
        distance: (K,) where their squared distances in the plane go, m².
    """
    x, y, z, climb = agents[me, X], agents[me, Y], agents[me, Z], agents[me, CLIMB]
    reach, vertical, soon = limits[0] ** 2, limits[1], limits[2]
    most, count = len(found), 0
    if most == 0:
        return 0
    rows = (len(start) - 1) // columns
    my_row, my_column = cell // columns, cell % columns
    first, last = max(my_column - REACH, 0), min(my_column + REACH, columns - 1)
    for step in range(2 * REACH + 1):
        row = my_row + ((step + 1) // 2 if step % 2 else -(step // 2))  # own row, then outwards
        if row < 0 or row >= rows:
            continue
        for other in range(start[row * columns + first], start[row * columns + last + 1]):
            dx, dy = agents[other, X] - x, agents[other, Y] - y
            squared = dx * dx + dy * dy
            if squared >= reach or other == me:
                continue
            above = agents[other, Z] - z
            then = above + soon * (agents[other, CLIMB] - climb)
            if min(above, then) > vertical or max(above, then) < -vertical:
                continue
            place = count if count < most else most - 1
            while place > 0 and squared < distance[place - 1]:
                distance[place], found[place] = distance[place - 1], found[place - 1]
                place -= 1
            distance[place], found[place] = squared, other
            if count < most:
                count += 1
            if count == most:
                reach = distance[most - 1]
    return count
