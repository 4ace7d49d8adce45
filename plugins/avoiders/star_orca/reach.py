"""No velocity that a drone cannot come to: ORCA's answer within the limit of acceleration."""

from __future__ import annotations

import math

from star_core import Array, Mask, compiled


@compiled
def within_reach(answer: Array, flown: Array, avoids: Mask, change: float, speed: Array) -> None:
    """Bring horizontal velocities within `change` of the ones flown now, in place.

    A drone that follows a velocity as a lag of first order does accelerates by the difference over
    its time constant. With `change` the greatest acceleration times that constant none is asked
    for more. Who flies faster than its greatest speed is still asked for no more than that.

    Args:
        answer: (N, 3) velocities, m/s.
        flown: (N, 3) velocities now, m/s; none is kept near one that is not finite.
        avoids: (N,) who is asked at all; the rows of others stay as they are.
        change: Greatest difference, m/s.
        speed: (N,) greatest speed, m/s.
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
