"""Contacts of drones with each other and with obstacles: no torque, no damage, a short bounce.

A drone is an upright cylinder of `FRAME_RADIUS` and `HEIGHT`. Overlapping drones are separated and
keep `BOUNCE` of their closing speed. The propellers reach 1 cm further, so colliding drones are
closer than a propeller span for longer than a tick, and a metric sampled once per tick counts the
collision. Real collisions mostly end on the floor.
"""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Rows, World
from star_core.toolkit import subroutine
from star_sim.airframe import CYCLE, FRAME_RADIUS, HEIGHT
from star_sim.body import GRIP, SETTLE
from star_sim.drone import Record

BOUNCE = 0.2  # of the closing speed, assumed
# Drones are sorted along a direction in which neither a row, a column nor a stack coincides.
SWEEP = (0.7696, 0.5515, 0.3219)  # a unit vector
MARGIN = 0.002  # m, more than a drone can gain on its speed in one cycle


def prisms(world: World) -> tuple[Array, Rows, Array]:
    """Return the obstacles of a world as arrays for the kernel.

    Returns:
        (P, 6) for each upright prism least x and y, greatest x and y, foot and top, m; (P, 2) its
        first edge and one past its last; (E, 4) the edges, x and y of one end and of the other, m.
    """
    boxes: list[tuple[float, ...]] = []
    spans: list[tuple[int, int]] = []
    edges: list[tuple[float, ...]] = []
    for obstacle in world.obstacles:
        for polygon in obstacle.polygons:
            x, y = [corner[0] for corner in polygon], [corner[1] for corner in polygon]
            boxes.append((min(x), min(y), max(x), max(y), *obstacle.height))
            spans.append((len(edges), len(edges) + len(polygon)))
            edges.extend((*a, *b) for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True))
    return (
        np.array(boxes, np.float64).reshape(-1, 6),
        np.array(spans, np.int64).reshape(-1, 2),
        np.array(edges, np.float64).reshape(-1, 4),
    )


@subroutine
def separate(drones: Record, order: Record, keys: Record) -> None:
    """Push apart all drones whose frames touch.

    Sort and sweep: `order` is kept sorted along `SWEEP` from one call to the next, so sorting costs
    little more than N steps, and only neighbours in it are compared.

    Args:
        drones: (N,) records.
        order: (N,) rows, sorted; kept.
        keys: (N,) buffer for the position of each row along `SWEEP`.
    """
    n = len(drones)
    for i in range(n):
        at = drones[i].position
        keys[i] = SWEEP[0] * at[0] + SWEEP[1] * at[1] + SWEEP[2] * at[2]
    for index in range(1, n):
        row = order[index]
        key = keys[row]
        hole = index
        while hole > 0 and keys[order[hole - 1]] > key:
            order[hole] = order[hole - 1]
            hole -= 1
        order[hole] = row
    for index in range(n):
        row = order[index]
        for other in range(index + 1, n):
            if keys[order[other]] - keys[row] > 2 * FRAME_RADIUS:
                break
            _bounce(drones[row], drones[order[other]])


@subroutine
def _bounce(first: Record, second: Record) -> None:
    """Move two drones apart along the line between them, if they overlap."""
    dx = second.position[0] - first.position[0]
    dy = second.position[1] - first.position[1]
    dz = second.position[2] - first.position[2]
    squared = dx * dx + dy * dy + dz * dz
    if squared >= 4 * FRAME_RADIUS * FRAME_RADIUS:
        return
    distance = math.sqrt(squared)
    normal = (1.0, 0.0, 0.0)  # if there is no line between them
    if distance > 1e-9:  # noqa: PLR2004 -- m
        normal = (dx / distance, dy / distance, dz / distance)
    half = FRAME_RADIUS - distance / 2
    closing = 0.0
    for axis in range(3):
        closing += normal[axis] * (first.velocity[axis] - second.velocity[axis])
    shove = max(0.0, closing) * (1 + BOUNCE) / 2  # m/s each: they weigh the same
    for axis in range(3):
        first.position[axis] -= half * normal[axis]
        second.position[axis] += half * normal[axis]
        first.velocity[axis] -= shove * normal[axis]
        second.velocity[axis] += shove * normal[axis]
    first.position[2] = max(0.0, first.position[2])
    second.position[2] = max(0.0, second.position[2])


@subroutine
def keep_out(drone: Record, boxes: Record, spans: Record, edges: Record) -> None:
    """Push one drone out of every prism it touches.

    The distance to the nearest prism is stored, and the prisms are not checked again before the
    drone can have flown that far.
    """
    speed = math.sqrt(drone.velocity[0] ** 2 + drone.velocity[1] ** 2 + drone.velocity[2] ** 2)
    drone.clearance -= speed * CYCLE + MARGIN
    if drone.clearance > 0.0:
        return
    drone.clearance = math.inf
    for piece in range(len(boxes)):
        box = boxes[piece]
        x, y, z = drone.position[0], drone.position[1], drone.position[2]
        aside = max(box[0] - x, x - box[2], box[1] - y, y - box[3]) - FRAME_RADIUS
        above = max(z - box[5], box[4] - z - HEIGHT)
        gap = max(aside, above)
        drone.clearance = min(drone.clearance, gap)
        if gap < 0.0:
            _push_out(drone, box, edges[spans[piece, 0] : spans[piece, 1]])


@subroutine
def surface_below(drone: Record, boxes: Record, spans: Record, edges: Record) -> None:
    """Store the height of the floor or the highest obstacle below the center of one drone, m."""
    x, y, z = drone.position[0], drone.position[1], drone.position[2]
    drone.surface = 0.0
    for piece in range(len(boxes)):
        box = boxes[piece]
        inside = box[0] <= x <= box[2] and box[1] <= y <= box[3]
        if inside and drone.surface < box[5] <= z + MARGIN:
            distance, _, _ = _way_out(x, y, edges[spans[piece, 0] : spans[piece, 1]])
            if distance <= 0.0:
                drone.surface = box[5]


@subroutine
def _push_out(drone: Record, box: Record, edges: Record) -> None:
    """Push one drone out of a prism by the shortest way: sideways, up, or down."""
    distance, nx, ny = _way_out(drone.position[0], drone.position[1], edges)
    sideways = FRAME_RADIUS - distance
    if sideways <= 0.0:
        return
    up, down = box[5] - drone.position[2], drone.position[2] + HEIGHT - box[4]
    if box[4] <= HEIGHT:
        down = math.inf  # there is no room below
    if sideways <= min(up, down):
        drone.position[0] += sideways * nx
        drone.position[1] += sideways * ny
        closing = -(nx * drone.velocity[0] + ny * drone.velocity[1])
        if closing > 0.0:
            drone.velocity[0] += (1 + BOUNCE) * closing * nx
            drone.velocity[1] += (1 + BOUNCE) * closing * ny
    elif up <= down:
        _stand(drone, box[5])
    else:
        drone.position[2] = box[4] - HEIGHT
        drone.velocity[2] = min(0.0, drone.velocity[2])


@subroutine
def _stand(drone: Record, top: float) -> None:
    """Hold one drone on top of a prism, and level it if it is upright, like the floor."""
    drone.position[2] = top
    drone.velocity[2] = max(0.0, drone.velocity[2])
    drone.velocity[0] *= GRIP
    drone.velocity[1] *= GRIP
    for axis in range(3):
        drone.rates[axis] *= GRIP
    qx, qy, qz, qw = drone.attitude[0], drone.attitude[1], drone.attitude[2], drone.attitude[3]
    if qx * qx + qy * qy < 0.5:  # noqa: PLR2004 -- less than 90° of tilt
        qx, qy = SETTLE * qx, SETTLE * qy
        unit = 1.0 / math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
        drone.attitude[0], drone.attitude[1] = unit * qx, unit * qy
        drone.attitude[2], drone.attitude[3] = unit * qz, unit * qw


@subroutine
def _way_out(x: float, y: float, edges: Record) -> tuple[float, float, float]:
    """Return how far a point is from a polygon, less than 0 inside, and the unit vector out of it.

    Args:
        x: Of the point, m.
        y: Of the point, m.
        edges: (E, 4) of the polygon, x and y of one end and of the other, m.
    """
    inside = False
    nearest = math.inf
    nx, ny = 1.0, 0.0
    for k in range(len(edges)):
        ax, ay, bx, by = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
        ux, uy = bx - ax, by - ay
        along = ((x - ax) * ux + (y - ay) * uy) / max(1e-12, ux * ux + uy * uy)
        along = min(max(along, 0.0), 1.0)
        px, py = x - ax - along * ux, y - ay - along * uy
        distance = math.sqrt(px * px + py * py)
        if distance < nearest:
            nearest = distance
            if distance > 1e-9:  # noqa: PLR2004 -- else it is on the edge: straight across that
                nx, ny = px / distance, py / distance
            else:
                length = max(1e-9, math.sqrt(ux * ux + uy * uy))
                nx, ny = uy / length, -ux / length
    return (-nearest, -nx, -ny) if inside else (nearest, nx, ny)
