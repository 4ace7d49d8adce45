"""Velocities from which agents can brake inside the fence and before each other: the inner loop."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows
from star_core.toolkit.jit import compiled, subroutine

LAG: Final = 0.4
"""Time constant with which a drone stops, s. A simulated Crazyflie follows a step of its velocity
setpoint to 63 % in 0.3 s, and receives it up to a tick late."""

BRAKING_GAIN: Final = 2.5
"""Speed permitted per metre of remaining distance, 1/s: 1 / `LAG` is critical damping."""

RETURN_SPEED: Final = 0.2
"""Greatest speed of agents at rest that move back inside the fence or away from others, m/s."""

MAX_ITERATIONS: Final = 30
"""Corrections of agents that approach each other, before those that still do so stop."""

TOLERANCE: Final = 1e-3
"""Excess of the closing speed that is not corrected, m/s."""


@compiled
def limit_velocities(  # noqa: C901, PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    inside: Array,
    apart: Array,
    position: Array,
    flown: Array,
    active: Mask,
    first: Rows,
    second: Rows,
    fence: Array,
    speed: float,
    brakes: float,
    separation: float,
    period: float,
) -> None:
    """Correct velocities so that agents can brake before the fence and before each other.

    The excess of a closing speed is shared equally by the two agents. Corrections are repeated,
    since each can bring an agent too close to another; agents that still violate a constraint then
    stop.

    Args:
        inside: (N, 3) velocities no faster than `speed`, m/s; active rows are changed to such that
            agents can brake before the fence.
        apart: (N, 3) output: those from which they can brake before each other as well, m/s; rows
            that are not active are undefined.
        position: (N, 3) m.
        flown: (N, 3) current velocities, m/s.
        active: (N,) agents that are steered; the others keep their velocity.
        first: (P,) one of every two agents that are near each other.
        second: (P,) the other.
        fence: (2, 3) its lowest and its highest corner, m.
        speed: Greatest speed, m/s.
        brakes: Greatest deceleration, m/s².
        separation: Least distance between two agents, m.
        period: Of the ticks, s.
    """
    for row in range(len(active)):
        if active[row]:
            bound(inside, position, flown, row, fence, brakes, period)
        for axis in range(3):
            apart[row, axis] = inside[row, axis] if active[row] else flown[row, axis]
    if len(first) == 0:
        return
    direction, allowed = np.empty((len(first), 3)), np.empty(len(first))
    for pair in range(len(first)):
        one, two = first[pair], second[pair]
        steered = int(active[one]) + int(active[two])
        distance, approach = direct(direction, pair, one, two, position, flown)
        most = approach_speed(distance - separation, approach, brakes * max(1, steered), period)
        allowed[pair] = most if steered > 0 else math.inf
    change, times = np.empty((len(apart), 3)), np.empty(len(apart))
    for iteration in range(MAX_ITERATIONS + 1):
        if not corrections(change, times, apart, active, first, second, direction, allowed):
            return
        for row in range(len(active)):
            if times[row] > 0.0 and active[row]:
                add_correction(apart, change, times, row, speed)
                bound(apart, position, flown, row, fence, brakes, period)
                if iteration == MAX_ITERATIONS:
                    for axis in range(3):
                        apart[row, axis] = 0.0


@subroutine
def corrections(
    change: Array,
    times: Array,
    velocity: Array,
    active: Mask,
    first: Rows,
    second: Rows,
    direction: Array,
    allowed: Array,
) -> bool:
    """Fill in the sum of each agent's corrections and their number; return whether there are any.

    Args:
        change: (N, 3) output: sum of the corrections, m/s.
        times: (N,) output: number of corrections.
        velocity: (N, 3) m/s.
        active: (N,) agents that are steered.
        first: (P,) one of every two agents that are near each other.
        second: (P,) the other.
        direction: (P, 3) unit vector from the second to the first.
        allowed: (P,) greatest closing speed, m/s.
    """
    for row in range(len(times)):
        times[row] = 0.0
        for axis in range(3):
            change[row, axis] = 0.0
    found = False
    for pair in range(len(first)):
        one, two = first[pair], second[pair]
        approach = 0.0
        for axis in range(3):
            approach += direction[pair, axis] * (velocity[two, axis] - velocity[one, axis])
        excess = approach - allowed[pair]
        if excess > TOLERANCE:
            found = True
            times[one] += 1.0
            times[two] += 1.0
            share = excess / (int(active[one]) + int(active[two]))
            for axis in range(3):
                change[one, axis] += share * direction[pair, axis]
                change[two, axis] -= share * direction[pair, axis]
    return found


@subroutine
def add_correction(velocity: Array, change: Array, times: Array, row: int, speed: float) -> None:
    """Add the mean of one agent's corrections to its velocity, within the greatest speed."""
    squared = 0.0
    for axis in range(3):
        velocity[row, axis] += change[row, axis] / times[row]
        squared += velocity[row, axis] * velocity[row, axis]
    if squared > speed * speed:
        for axis in range(3):
            velocity[row, axis] *= speed / math.sqrt(squared)


@subroutine
def direct(
    direction: Array, pair: int, one: int, two: int, position: Array, flown: Array
) -> tuple[float, float]:
    """Fill in the unit vector from agent `two` to `one`; return their distance and closing speed.

    Two at the same position are taken to be side by side along x.
    """
    squared, approach = 0.0, 0.0
    for axis in range(3):
        direction[pair, axis] = position[one, axis] - position[two, axis]
        squared += direction[pair, axis] * direction[pair, axis]
    distance = math.sqrt(squared)
    if distance == 0.0:
        direction[pair, 0] = 1.0
    for axis in range(3):
        direction[pair, axis] /= distance if distance > 0.0 else 1.0
        approach += direction[pair, axis] * (flown[two, axis] - flown[one, axis])
    return distance, approach


@subroutine
def bound(
    velocity: Array,
    position: Array,
    flown: Array,
    row: int,
    fence: Array,
    brakes: float,
    period: float,
) -> None:
    """Change one velocity to one from which the agent can brake before the fence."""
    for axis in range(3):
        here, fast = position[row, axis], flown[row, axis]
        up = approach_speed(fence[1, axis] - here, fast, brakes, period)
        down = approach_speed(here - fence[0, axis], -fast, brakes, period)
        velocity[row, axis] = min(max(velocity[row, axis], min(-down, up)), max(up, -down))


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
