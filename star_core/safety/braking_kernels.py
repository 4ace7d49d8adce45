"""Velocities from which agents can brake inside the fence and before each other: the inner loop."""

from __future__ import annotations

import math
from functools import partial
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows
from star_core.toolkit.jit import compiled

LAG: Final = 0.4
"""How far a drone that is to stop flies on, as a time by its speed, s. A simulated Crazyflie
follows a step of its velocity setpoint to 63 % in 0.3 s, and hears of it up to a tick late."""

PULL: Final = 2.5
"""How soon a drone is to come to rest before what it must not reach, 1/s: 1 / `LAG` is critical."""

PART: Final = 0.2
"""Greatest speed of agents at rest that move back inside the fence or away from others, m/s."""

ROUNDS: Final = 30
"""How often velocities of agents that close in on each other are corrected before they stop."""

ENOUGH: Final = 1e-3
"""By how much agents may close in too fast, m/s: corrections settle no finer."""

inner = partial(compiled, on_disk=False)
alone = partial(compiled, alone=True)


@alone
def keep_inside(
    velocity: Array,
    position: Array,
    flown: Array,
    active: Mask,
    fence: Array,
    brakes: float,
    period: float,
) -> None:
    """Change velocities to such that the agents can brake before the fence.

    Args:
        velocity: (N, 3) what the agents are to fly, m/s; changed where an agent is active.
        position: (N, 3) m.
        flown: (N, 3) what they fly now, m/s.
        active: (N,) agents that are steered.
        fence: (2, 3) its lowest and its highest corner, m.
        brakes: How fast an agent can change its velocity, m/s².
        period: Of the ticks, s.
    """
    for row in range(len(active)):
        if active[row]:
            bound(velocity, position, flown, row, fence, brakes, period)


@alone
def keep_apart(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    velocity: Array,
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
    """Change velocities to such that the agents can brake before each other and before the fence.

    Two that close in too fast are corrected by equal shares, again and again, as every correction
    can bring an agent too close to another; agents that still violate a constraint then stop.

    Args:
        velocity: (N, 3) what the agents are to fly, no faster than `speed` and safe within the
            fence, m/s; agents that are not steered keep their velocity.
        position: (N, 3) m.
        flown: (N, 3) what they fly now, m/s.
        active: (N,) agents that are steered.
        first: (P,) one of every two that are near each other,
        second: (P,) and the other.
        fence: (2, 3) its lowest and its highest corner, m.
        speed: Greatest speed, m/s.
        brakes: How fast an agent can change its velocity, m/s².
        separation: How near two may be, m.
        period: Of the ticks, s.
    """
    towards, allowed = np.empty((len(first), 3)), np.empty(len(first))
    weigh(towards, allowed, position, flown, active, first, second, brakes, separation, period)
    more, times = np.zeros_like(velocity), np.zeros(len(velocity))
    for turn in range(ROUNDS + 1):
        if not push(more, times, velocity, active, first, second, towards, allowed):
            return
        for row in range(len(active)):
            if times[row] > 0 and active[row]:
                for axis in range(3):
                    step = more[row, axis] / times[row]
                    velocity[row, axis] = velocity[row, axis] + step if turn < ROUNDS else 0.0
                if turn < ROUNDS:
                    slow(velocity, row, speed)
                    bound(velocity, position, flown, row, fence, brakes, period)


@inner
def weigh(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    towards: Array,
    allowed: Array,
    position: Array,
    flown: Array,
    active: Mask,
    first: Rows,
    second: Rows,
    brakes: float,
    separation: float,
    period: float,
) -> None:
    """Fill in where two agents' first is from the second, and how fast they may close in.

    Two in one place are taken to be side by side along x.
    """
    for pair in range(len(first)):
        one, two = first[pair], second[pair]
        apart = 0.0
        for axis in range(3):
            towards[pair, axis] = position[one, axis] - position[two, axis]
            apart += towards[pair, axis] ** 2
        apart = math.sqrt(apart)
        if apart == 0.0:
            towards[pair, 0] = 1.0
        for axis in range(3):
            towards[pair, axis] /= apart if apart > 0.0 else 1.0
        steered = int(active[one]) + int(active[two])
        closes = closing(flown, one, two, towards, pair)
        allowed[pair] = shrink(apart - separation, closes, brakes * max(1, steered), period)
        if steered == 0:
            allowed[pair] = math.inf


@inner
def push(
    more: Array,
    times: Array,
    velocity: Array,
    active: Mask,
    first: Rows,
    second: Rows,
    towards: Array,
    allowed: Array,
) -> bool:
    """Fill in what each agent is to change for all that it nears too fast; return if anybody is."""
    more[:], times[:] = 0.0, 0.0
    found = False
    for pair in range(len(first)):
        one, two = first[pair], second[pair]
        excess = closing(velocity, one, two, towards, pair) - allowed[pair]
        if excess > ENOUGH:
            found = True
            times[one] += 1.0
            times[two] += 1.0
            share = excess / (int(active[one]) + int(active[two]))
            for axis in range(3):
                more[one, axis] += share * towards[pair, axis]
                more[two, axis] -= share * towards[pair, axis]
    return found


@inner
def closing(velocity: Array, one: int, two: int, towards: Array, pair: int) -> float:
    """Return how fast agent `two` flies along a unit vector, less how fast `one` does, m/s."""
    along = 0.0
    for axis in range(3):
        along += towards[pair, axis] * (velocity[two, axis] - velocity[one, axis])
    return along


@inner
def slow(velocity: Array, row: int, speed: float) -> None:
    """Shorten one velocity to the greatest speed, m/s."""
    square = velocity[row, 0] ** 2 + velocity[row, 1] ** 2 + velocity[row, 2] ** 2
    if square > speed * speed:
        for axis in range(3):
            velocity[row, axis] *= speed / math.sqrt(square)


@inner
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
        up = shrink(fence[1, axis] - here, fast, brakes, period)
        down = shrink(here - fence[0, axis], -fast, brakes, period)
        velocity[row, axis] = min(max(velocity[row, axis], min(-down, up)), max(up, -down))


@inner
def shrink(room: float, closes: float, brakes: float, period: float) -> float:
    """Return the fastest that a setpoint may let a room shrink, m/s.

    Args:
        room: What is left, m; negative beyond it.
        closes: How fast it shrinks now, m/s.
        brakes: How fast that can be changed, m/s².
        period: Of the ticks, s.
    """
    late = period * brakes
    stops = math.sqrt(late * late + 2 * brakes * max(0.0, room)) - late
    return max(min(PULL * (room - LAG * closes), stops), -PART - max(0.0, closes))
