"""Limits the change of velocity to what the acceleration limit permits."""

from __future__ import annotations

import math

from star_core import Array, Mask, compiled


@compiled
def within_reach(answer: Array, flown: Array, avoids: Mask, change: float, speed: Array) -> None:
    """Bring horizontal velocities within `change` of the current ones, in place.

    A drone that follows a velocity as a first-order lag accelerates by the difference over its time
    constant. If `change` is the acceleration limit times that constant, no setpoint exceeds the
    limit. Agents above their speed limit are still not commanded a higher speed than it.

    Args:
        answer: (N, 3) velocities, m/s.
        flown: (N, 3) current velocities, m/s; rows that are not finite impose no limit.
        avoids: (N,) agents to process; the rows of others stay unchanged.
        change: Greatest difference, m/s.
        speed: (N,) speed limit, m/s.
    """
    for i in range(len(answer)):
        if not avoids[i]:
            continue
        x, y = answer[i, 0] - flown[i, 0], answer[i, 1] - flown[i, 1]
        far = math.hypot(x, y)
        if far > change:  # never for what is not finite
            x, y = flown[i, 0] + change / far * x, flown[i, 1] + change / far * y
            fast = math.hypot(x, y)
            scale = min(1.0, speed[i] / fast) if fast > 0.0 else 1.0
            answer[i, 0], answer[i, 1] = scale * x, scale * y
