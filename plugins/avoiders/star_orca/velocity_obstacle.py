"""The velocity obstacle of a disc, and the shortest way out of it."""

from __future__ import annotations

import math

from star_core import subroutine

NOTHING = 1e-12  # m or m/s: shorter vectors have no meaningful direction


@subroutine
def way_out(
    dx: float, dy: float, ux: float, uy: float, apart: float, rate: float, forwards: float
) -> tuple[float, float, float]:
    """Return the normal of a velocity obstacle at the point nearest to a velocity, and a length.

    The least change that brings the velocity out of the velocity obstacle is the length times the
    normal, a unit vector ``(a, b)``; the length is negative if the velocity is outside already. The
    velocity obstacle contains all velocities that lead into the disc within ``1 / rate``: van den
    Berg, Guy, Lin and Manocha, "Reciprocal n-Body Collision Avoidance" (2011). Inside the disc,
    the change leads out of it in that time.

    Args:
        dx: Center of the disc relative to the agent, along x, m.
        dy: The same along y, m.
        ux: Velocity relative to the disc along x, m/s.
        uy: The same along y, m/s.
        apart: Radius of the disc, m.
        rate: One over the time horizon, 1/s.
        forwards: 1 or -1: direction along x to separate in where the geometry defines none.
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
