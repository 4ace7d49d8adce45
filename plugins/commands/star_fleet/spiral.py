"""The high-level commander's spiral: an arc whose radius and height change evenly."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array
from star_sim.commander import ending_at_rest
from star_sim.pieces import Piece


def spiral(
    start: Array,
    sideways: bool,  # noqa: FBT001
    clockwise: bool,  # noqa: FBT001
    angle: float,
    first_radius: float,
    last_radius: float,
    rise: float,
    duration: float,
) -> Piece:
    """Return the piece that the firmware's planner makes of a spiral.

    It is one polynomial of order 7 with the position, velocity and acceleration of the spiral at
    both ends, where its third derivatives are 0. The heading turns with the arc: the drone flies
    nose first along it, or `sideways`, facing the center or away from it. Angles beyond a full
    turn are flown as one, negative radii as 0.

    Args:
        start: (4,) x, y, z, m, and yaw, rad, at the start.
        sideways: Whether its side points along the arc.
        clockwise: Seen from above.
        angle: Of the arc, rad.
        first_radius: At the start, m.
        last_radius: At the end, m.
        rise: Of the height, m.
        duration: s.
    """
    angle = min(max(angle, -math.tau), math.tau)
    radii = max(first_radius, 0.0), max(last_radius, 0.0)
    turn = 1.0 if clockwise else -1.0
    rate = -turn * angle / duration
    yaw = float(start[3])
    bearing = yaw + (math.pi * (turn > 0) if sideways else turn * math.pi / 2)  # from the center
    growth = (radii[1] - radii[0]) / duration
    ends = [_end(radii[i], growth, bearing + i * rate * duration, rate) for i in (0, 1)]
    center = start[:2] - ends[0][0]
    states = [
        np.array(
            [
                [*(center + position), start[2] + i * rise, yaw + i * rate * duration],
                [*velocity, rise / duration, rate],
                [*acceleration, 0.0, 0.0],
            ]
        )
        for i, (position, velocity, acceleration) in enumerate(ends)
    ]
    times, nothing = np.full(4, duration), np.zeros(4)
    (pose, speed, curve), (end, end_speed, end_curve) = states
    toward = ending_at_rest(pose, speed, curve, end, times)
    leaving = ending_at_rest(nothing, -end_speed, end_curve, nothing, times)
    return Piece(toward + Piece(leaving, duration).backwards().coefficients, duration)


def _end(radius: float, growth: float, bearing: float, rate: float) -> tuple[Array, Array, Array]:
    """Return position from the center, velocity and acceleration on a spiral: (2,) each."""
    out = np.array([math.cos(bearing), math.sin(bearing)])
    along = np.array([-out[1], out[0]])
    velocity = growth * out + radius * rate * along
    return radius * out, velocity, 2 * growth * rate * along - radius * rate**2 * out
