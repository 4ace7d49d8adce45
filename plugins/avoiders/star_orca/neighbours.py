"""Neighbour search: agents sorted into square cells, and the nearest few of each."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Rows
from star_core.toolkit import subroutine

# Columns of the table of `sort_into_cells`: one row per agent, in the order of the cells.
X, Y, Z, VX, VY, RADIUS, AVOIDS, ROW, CLIMB, WISH_X, WISH_Y, WISH_Z = range(12)
SPEED, MARGIN, GOAL_X, GOAL_Y = range(12, 16)
COLUMNS = 16

REACH = 2  # cells, half the neighbour distance wide, searched to either side
FEW = 48  # agents: up to this number, searching all of them is faster than sorting


@subroutine
def sort_into_cells(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    position: Array,
    velocity: Array,
    wish: Array,
    radius: Array,
    margin: Array,
    speed: Array,
    avoids: Mask,
    goal: Array,
    reach: float,
) -> tuple[Array, Rows, Rows, int]:
    """Return the agents in the order of their cells, and the row at which each cell begins.

    All data of an agent is stored together: when the neighbours of agents are searched in this
    order, most of them are in the processor's cache.

    Agents without a finite position are omitted; those without a finite velocity are treated as
    stationary. Cells are counted along x first; up to `FEW` agents are all in one cell.

    Args:
        position: (N, 3) m.
        velocity: (N, 3) m/s.
        wish: (N, 3) preferred velocity, m/s: the expected vertical velocity of an agent that
            avoids. One that does not is expected to keep its current vertical velocity.
        radius: (N,) m.
        margin: (N,) by which it is enlarged, m; the table has the sum as the radius.
        speed: (N,) speed limit, m/s.
        avoids: (N,) whether the agent gives way.
        goal: (N, 2) where it flies, m; NaN if it stays.
        reach: Search radius, m.

    Returns:
        (M, 16) table with the columns named above, (M,) cell of each of its rows, (C + 1,) row at
        which each cell begins, and the number of cells along x.
    """
    where, columns, rows = cells(position, reach)
    start = np.zeros(columns * rows + 1, np.int64)
    for i in range(len(where)):
        if where[i] >= 0:
            start[where[i] + 1] += 1
    for c in range(columns * rows):
        start[c + 1] += start[c]

    agents = np.empty((start[-1], COLUMNS))
    cell = np.empty(start[-1], np.int64)
    filled = start.copy()
    for i in range(len(where)):
        c = where[i]
        if c < 0:
            continue
        k = filled[c]
        filled[c] += 1
        cell[k] = c
        moves = math.isfinite(velocity[i, 0] + velocity[i, 1])
        agents[k, X], agents[k, Y], agents[k, Z] = position[i, 0], position[i, 1], position[i, 2]
        agents[k, VX] = velocity[i, 0] if moves else 0.0
        agents[k, VY] = velocity[i, 1] if moves else 0.0
        agents[k, RADIUS], agents[k, MARGIN] = radius[i] + margin[i], margin[i]
        agents[k, AVOIDS] = 1.0 if avoids[i] else 0.0
        agents[k, ROW] = i
        climb = wish[i, 2] if avoids[i] else velocity[i, 2]
        agents[k, CLIMB] = climb if math.isfinite(climb) else 0.0
        agents[k, WISH_X], agents[k, WISH_Y], agents[k, WISH_Z] = wish[i, 0], wish[i, 1], wish[i, 2]
        agents[k, SPEED] = speed[i]
        agents[k, GOAL_X], agents[k, GOAL_Y] = goal[i, 0], goal[i, 1]
    return agents, cell, start, columns


@subroutine
def cells(position: Array, reach: float) -> tuple[Rows, int, int]:
    """Return the cell of each agent, -1 for none, and the number of cells along x and along y.

    Args:
        position: (N, 3) m.
        reach: Search radius, m.
    """
    left, right, low, high, m = math.inf, -math.inf, math.inf, -math.inf, 0
    where = np.empty(len(position), np.int64)
    for i in range(len(position)):
        x, y = position[i, 0], position[i, 1]
        where[i] = -1
        if math.isfinite(x + y + position[i, 2]):
            left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
            where[i] = 0
            m += 1
    columns, rows = 1, 1
    if m > FEW:
        side = max(reach / REACH, (right - left) / m, (high - low) / m)
        while ((right - left) / side + 1) * ((high - low) / side + 1) > 4 * m:
            side *= 2  # a few cells per agent are enough, however far apart the agents are
        columns, rows = int((right - left) / side) + 1, int((high - low) / side) + 1
        for i in range(len(position)):
            if where[i] == 0:
                row, column = (
                    int((position[i, 1] - low) / side),
                    int((position[i, 0] - left) / side),
                )
                where[i] = row * columns + column
    return where, columns, rows


@subroutine
def nearest(
    agents: Array,
    me: int,
    cell: int,
    start: Rows,
    columns: int,
    limits: tuple[float, float, float],
    neighbours: Rows,
    distance: Array,
) -> int:
    """Fill `neighbours` with the nearest agents, nearest first, and return their number.

    Agents that are out of range in height, and stay so as both climb or sink, are skipped.

    Args:
        agents: (M, 16) table of `sort_into_cells`.
        me: Row in it of the agent whose neighbours are searched.
        cell: The cell it is in.
        start: (C + 1,) row at which each cell begins.
        columns: Number of cells along x.
        limits: Greatest horizontal and vertical distance of a neighbour, m, and the time for which
            an agent must stay beyond the vertical distance to be skipped, s.
        neighbours: (K,) output: rows of the neighbours; at most K are searched.
        distance: (K,) output: their squared horizontal distances, m².
    """
    x, y, z, climb = agents[me, X], agents[me, Y], agents[me, Z], agents[me, CLIMB]
    reach, vertical, soon = limits[0] ** 2, limits[1], limits[2]
    most, count = len(neighbours), 0
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
            index = count if count < most else most - 1
            while index > 0 and squared < distance[index - 1]:
                distance[index], neighbours[index] = distance[index - 1], neighbours[index - 1]
                index -= 1
            distance[index], neighbours[index] = squared, other
            if count < most:
                count += 1
            if count == most:
                reach = distance[most - 1]
    return count
