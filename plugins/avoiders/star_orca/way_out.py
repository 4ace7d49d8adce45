"""The nearest way out of the velocity obstacle of a disc."""

from __future__ import annotations

import math

from star_core import compiled

NOTHING = 1e-12  # m or m/s: shorter vectors have no direction worth the name


@compiled
def way_out(
    dx: float, dy: float, ux: float, uy: float, apart: float, rate: float, forwards: float
) -> tuple[float, float, float]:
    """Return where the velocity obstacle of a disc ends nearest to a velocity, and how far away.

    That is a unit vector ``(a, b)`` and a length: the least change that brings the velocity out is
    the length times the vector; where it is out already the length is negative. The velocity
    obstacle holds all velocities that lead into the disc within ``1 / rate``: van den Berg, Guy,
    Lin and Manocha, "Reciprocal n-Body Collision Avoidance" (2011). In a disc that one is in
    already, the change is what brings one out in that time.

    Args:
        dx: Centre of the disc from here, along x, m.
        dy: The same along y, m.
        ux: Velocity relative to the disc along x, m/s.
        uy: The same along y, m/s.
        apart: Radius of the disc, m.
        rate: One over the time to look ahead, 1/s.
        forwards: 1 or -1: which way out along x where there is no line to part along.
    """
    squared = dx * dx + dy * dy
    wx, wy = ux - rate * dx, uy - rate * dy  # from the centre of the cut-off disc
    length = wx * wx + wy * wy
    along = wx * dx + wy * dy
    inside = squared <= apart * apart
    if inside or (along < 0.0 and along * along > apart * apart * length):
        length = math.sqrt(length)
        if length > NOTHING:
            a, b = wx / length, wy / length
        elif math.sqrt(squared) > NOTHING:
            a, b = -dx / math.sqrt(squared), -dy / math.sqrt(squared)
        else:
            a, b = forwards, 0.0
        return a, b, apart * rate - length
    leg = math.sqrt(squared - apart * apart)
    if dx * wy - dy * wx > 0.0:
        a, b = -(dx * apart + dy * leg) / squared, (dx * leg - dy * apart) / squared
    else:  # dead ahead belongs to the right leg, as it does in RVO2
        a, b = (dy * leg - dx * apart) / squared, -(dx * leg + dy * apart) / squared
    return a, b, -(a * ux + b * uy)
