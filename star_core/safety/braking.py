"""The speed at which agents may use up a distance, and the constants of that law."""

from __future__ import annotations

import math
from typing import Final

from star_core.messages.arrays import Array
from star_core.messages.position_margin import YIELD_TIME
from star_core.toolkit.jit import subroutine

LAG: Final = 0.4
"""Time constant with which a drone stops, s. A simulated Crazyflie follows a step of its velocity
setpoint to 63 % in 0.3 s, and receives it up to a tick late."""

BRAKING_GAIN: Final = 2.5
"""Speed permitted per metre of remaining distance, 1/s: 1 / `LAG` is critical damping."""

RETURN_SPEED: Final = 0.2
"""Greatest speed of agents at rest that move back inside the fence or away from others, m/s."""

ROUNDING: Final = 1e-9
"""Share by which rounding makes the square of a speed exceed that of the greatest one."""

YIELDING: Final = 1 / (BRAKING_GAIN * YIELD_TIME)
"""Share of the room outside of the separations that margins for uncertain positions leave."""


@subroutine
def slow_down(velocity: Array, row: int, speed: float) -> None:
    """Shorten one velocity to the greatest speed, if it is longer."""
    squared = 0.0
    for axis in range(3):
        squared += velocity[row, axis] * velocity[row, axis]
    if squared > speed * speed * (1 + ROUNDING):
        for axis in range(3):
            velocity[row, axis] *= speed / math.sqrt(squared)


@subroutine
def approach_speed(distance: float, approach: float, brakes: float, period: float) -> float:
    """Return the greatest speed at which a setpoint may let a distance shrink, m/s.

    Args:
        distance: Remaining distance, m; negative beyond the limit.
        approach: Speed at which it shrinks now, m/s.
        brakes: Greatest deceleration, m/s².
        period: Of the ticks, s.
    """
    delay = period * brakes
    stopping = math.sqrt(delay * delay + 2 * brakes * max(0.0, distance)) - delay
    damped = BRAKING_GAIN * (distance - LAG * approach)
    return max(min(damped, stopping), -RETURN_SPEED - max(0.0, approach))


@subroutine
def yielding_room(room: float, margin: float) -> float:
    """Return the distance that an agent may use up, less a margin that yields, m.

    Args:
        room: Distance without the margin, m; negative beyond the limit.
        margin: For the agent's uncertain position, m.
    """
    return max(room - margin, YIELDING * room) if room > 0.0 else room
