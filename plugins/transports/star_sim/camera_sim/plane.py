"""Where the rays of pixels meet a plane, as a homography for each row and slice of exposure."""

from __future__ import annotations

from star_sim.compiled import Record, compiled


@compiled
def onto(pose: Record, frame: Record, unit: float, middle: float, map_: Record) -> float:
    """Find the homography from directions of a camera to a plane.

    A ray ``c + depth * R (x, y, 1)`` meets the plane at ``depth = away / w``; there ``s / w``
    grows along the plane's x axis and ``t / w`` against its y axis, where s, t and w are the
    products of (x, y, 1) with the three rows of the homography.

    Args:
        pose: (12,) of the camera.
        frame: (>= 12,) origin, x, y and z axes of the plane in the map, m.
        unit: Length of one step of s and t, m.
        middle: s and t of the origin.
        map_: (9,) filled with the homography.

    Returns:
        The plane's distance before the camera along its own z axis, m: negative in front of it.
    """
    x, y, z = pose[9] - frame[0], pose[10] - frame[1], pose[11] - frame[2]
    along = (x * frame[3] + y * frame[4] + z * frame[5]) / unit
    up = -(x * frame[6] + y * frame[7] + z * frame[8]) / unit
    away = -(x * frame[9] + y * frame[10] + z * frame[11])
    for axis in range(3):
        a, b, c = pose[axis], pose[3 + axis], pose[6 + axis]
        normal = a * frame[9] + b * frame[10] + c * frame[11]
        right = (a * frame[3] + b * frame[4] + c * frame[5]) / unit
        over = -(a * frame[6] + b * frame[7] + c * frame[8]) / unit
        map_[axis] = (along + middle) * normal + away * right
        map_[3 + axis] = (up + middle) * normal + away * over
        map_[6 + axis] = normal
    return float(away)
