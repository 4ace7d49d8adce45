"""Distances to obstacles, and velocities with which agents can brake before them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from star_core.messages.arrays import Array, Rows
from star_core.safety.braking import approach_speed, slow_down, yielding_room
from star_core.toolkit.jit import subroutine
from star_core.world.world import CONTACT_RADIUS, Obstacle

BESIDE: Final = 0.1  # m: an agent this little above or below an obstacle counts as beside it
REACH: Final = 2.0  # m, farther pieces are not considered: nothing has to brake for them yet
PASSES: Final = 2  # over all pieces, since turning away from one can turn towards another


class Walls(NamedTuple):
    """The sides of all obstacles.

    Attributes:
        edge: (E, 4) x and y of both ends of each side, m.
        first: (P + 1,) first side of each piece, and one past the last.
        box: (P, 6) least x, y and z, and greatest x, y and z of each piece, m.
        obstacle: (P,) index of its obstacle.
    """

    edge: Array
    first: Rows
    box: Array
    obstacle: Rows


def walls(obstacles: Iterable[Obstacle]) -> Walls:
    """Return the sides of obstacles.

    >>> pillar = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))
    >>> walls([pillar]).box
    array([[0., 0., 0., 1., 1., 2.]])
    """
    sides: list[tuple[float, ...]] = []
    first, boxes, index = [0], [], []
    for row, obstacle in enumerate(obstacles):
        foot, top = obstacle.height
        for polygon, (low, high) in zip(obstacle.polygons, obstacle.boxes, strict=True):
            sides += [(*polygon[k - 1], *polygon[k]) for k in range(len(polygon))]
            first.append(len(sides))
            boxes.append((*low, foot, *high, top))
            index.append(row)
    return Walls(
        np.array(sides, np.float64).reshape(-1, 4),
        np.array(first, np.int64),
        np.array(boxes, np.float64).reshape(-1, 6),
        np.array(index, np.int64),
    )


@subroutine
def nearest_wall(position: Array, row: int, wall: Walls) -> tuple[float, int, float, float]:
    """Return the distance of an agent to the nearest piece beside it, and which it is.

    Args:
        position: (N, 3) m.
        row: Of the agent.
        wall: The pieces.

    Returns:
        m, negative inside a piece, infinite if none is within `REACH`; the piece; and the unit
        vector away from it, or out of it.
    """
    nearest, piece, away_x, away_y = math.inf, 0, 0.0, 0.0
    for k in range(len(wall.obstacle)):
        if is_beside(position, row, wall, k):
            distance, x, y = way_out(position[row, 0], position[row, 1], wall, k)
            if distance < nearest:
                nearest, piece, away_x, away_y = distance, k, x, y
    return nearest, piece, away_x, away_y


@subroutine
def brake_for_walls(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    velocity: Array,
    position: Array,
    flown: Array,
    row: int,
    margin: float,
    wall: Walls,
    fence: Array,
    speed: float,
    brakes: float,
    period: float,
) -> None:
    """Change a velocity to one with which the agent can brake before obstacles and fence beside it.

    The law is that of `SafetyFilter`, with the distance to contact, or to a side of the fence, less
    the margin, which yields.

    Args:
        velocity: (N, 3) m/s; a row is changed.
        position: (N, 3) m.
        flown: (N, 3) current velocities, m/s.
        row: Of the agent.
        margin: For its uncertain position, m.
        wall: The pieces of the obstacles.
        fence: (2, 3) its lowest and its highest corner, m.
        speed: Greatest speed, m/s.
        brakes: Greatest deceleration, m/s².
        period: Of the ticks, s.
    """
    changed = False
    for _ in range(PASSES):
        for k in range(len(wall.obstacle)):
            if not is_beside(position, row, wall, k):
                continue
            distance, x, y = way_out(position[row, 0], position[row, 1], wall, k)
            room = yielding_room(distance - CONTACT_RADIUS, margin)
            approach = -(x * flown[row, 0] + y * flown[row, 1])
            most = approach_speed(room, approach, brakes, period)
            excess = -(x * velocity[row, 0] + y * velocity[row, 1]) - most
            if excess > 0.0:
                velocity[row, 0] += excess * x
                velocity[row, 1] += excess * y
                changed = True
    if changed:
        slow_down(velocity, row, speed)
    for axis in range(2):
        coordinate, fast = position[row, axis], flown[row, axis]
        above = yielding_room(fence[1, axis] - coordinate, margin)
        below = yielding_room(coordinate - fence[0, axis], margin)
        up = approach_speed(above, fast, brakes, period)
        down = approach_speed(below, -fast, brakes, period)
        velocity[row, axis] = min(max(velocity[row, axis], min(-down, up)), max(up, -down))


@subroutine
def vertical_limits(
    position: Array, flown: Array, row: int, wall: Walls, brakes: float, period: float
) -> tuple[float, float]:
    """Return the least and the greatest vertical velocity from which obstacles are not reached.

    They hold for agents above or below a piece, or within `CONTACT_RADIUS` of that. The law is that
    of `SafetyFilter`, with the distance to heights that count as beside the piece; agents already
    there are not moved away. The arguments are those of `brake_for_walls`.

    Returns:
        m/s, infinite where nothing is below or above.
    """
    least, most = -math.inf, math.inf
    x, y, z = position[row, 0], position[row, 1], position[row, 2]
    for k in range(len(wall.obstacle)):
        box = wall.box[k]
        over = (
            box[0] - CONTACT_RADIUS <= x <= box[3] + CONTACT_RADIUS
            and box[1] - CONTACT_RADIUS <= y <= box[4] + CONTACT_RADIUS
        )
        if not over or way_out(x, y, wall, k)[0] >= CONTACT_RADIUS:
            continue
        if z < box[2]:
            room = box[2] - BESIDE - z
            most = min(most, max(0.0, approach_speed(room, flown[row, 2], brakes, period)))
        elif z > box[5]:
            room = z - box[5] - BESIDE
            least = max(least, -max(0.0, approach_speed(room, -flown[row, 2], brakes, period)))
    return least, most


@subroutine
def is_beside(position: Array, row: int, wall: Walls, piece: int) -> bool:
    """Return whether an agent is at the height of a piece, and less than `REACH` from its box."""
    x, y, z = position[row, 0], position[row, 1], position[row, 2]
    box = wall.box[piece]
    beside: bool = (
        box[2] - BESIDE <= z <= box[5] + BESIDE
        and box[0] - REACH <= x <= box[3] + REACH
        and box[1] - REACH <= y <= box[4] + REACH
    )
    return beside


@subroutine
def way_out(x: float, y: float, wall: Walls, piece: int) -> tuple[float, float, float]:
    """Return the signed distance to a piece, m, and the unit vector out of it, or away from it."""
    squared, dx, dy = math.inf, 0.0, 0.0
    inside = False
    ux, uy = 1.0, 0.0  # outwards where the agent is on the outline
    for k in range(wall.first[piece], wall.first[piece + 1]):
        ax, ay, bx, by = wall.edge[k, 0], wall.edge[k, 1], wall.edge[k, 2], wall.edge[k, 3]
        sx, sy = bx - ax, by - ay
        length = sx * sx + sy * sy
        share = ((x - ax) * sx + (y - ay) * sy) / length if length > 0.0 else 0.0
        share = min(max(share, 0.0), 1.0)
        ox, oy = x - ax - share * sx, y - ay - share * sy
        if ox * ox + oy * oy < squared:
            squared, dx, dy = ox * ox + oy * oy, ox, oy
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * sx:
            inside = not inside
    distance = math.sqrt(squared)
    if distance > 0.0:
        ux, uy = dx / distance, dy / distance
    if inside:
        return -distance, -ux, -uy
    return distance, ux, uy
