"""The last word on what is sent: nobody leaves the fence, is too fast, or cannot brake in time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from star_core.braking import LAG, PULL, keep_apart, keep_inside
from star_core.flight import Corrected
from star_core.frames import Transform
from star_core.near import pairs, warm_up
from star_core.scene import Scene
from star_core.swarm import Estimate, Setpoint
from star_core.table import Array, Mask

COUNTS: Final = 0.05
"""By how much a velocity must be changed to be told as corrected, m/s."""


class SafetyFilter:
    """Corrects setpoints that no avoider should have asked for.

    A velocity is safe if from it the agent can brake inside the fence and at the least separation
    from everybody; two that are both steered share the braking. With the room x that is left and
    the speed c at which it shrinks now, a setpoint may let it shrink by ``PULL (x - LAG c)``: a
    drone that follows setpoints with that lag comes to rest without overshoot. Nor may it be faster
    than what the mission's acceleration stops in x. So who is outside the fence or too near moves
    away. A setpoint is corrected as little as that takes; where the corrections for several
    neighbours do not settle, agents stop.

    Args:
        scene: Fence, limits and tick.
    """

    def __init__(self, scene: Scene) -> None:
        self._fence = np.array([scene.world.fence.low, scene.world.fence.high])
        self._speed = scene.limits.speed
        self._brakes = scene.limits.acceleration
        self._separation = scene.limits.separation
        self._period = scene.period
        closing = 2 * self._speed
        room = closing * (LAG + max(1 / PULL, scene.period + closing / (4 * self._brakes)))
        wide = math.dist(scene.world.fence.low, scene.world.fence.high)
        self._reach = self._separation + min(1.5 * room, wide)  # some close in faster than they may
        self._warm_up()

    def filter(
        self, estimate: Estimate, safe: Setpoint, wanted: Setpoint
    ) -> tuple[Setpoint, Corrected]:
        """Return what to send, and whose setpoint was changed.

        Args:
            estimate: Where the agents are.
            safe: What the avoider answered. A row that it leaves out brakes: a drone that is told
                nothing would fall.
            wanted: Its active rows are sent.
        """
        active = wanted.active
        if not np.isfinite(estimate.velocity).all():  # who does not say how fast it is stands
            known = np.nan_to_num(estimate.velocity, posinf=0.0, neginf=0.0)
            estimate = replace(estimate, velocity=known)
        said = safe.active & active
        asked = np.where(said[:, None], safe.velocity, 0.0)
        slowed = self._slowed(asked)
        now = estimate.position, estimate.velocity, active
        inside = slowed.copy()
        keep_inside(inside, *now, self._fence, self._brakes, self._period)
        apart = self._kept_apart(inside, *now) if self._separation > 0 else inside
        sent = replace(
            safe, velocity=apart, yaw=np.where(said, safe.yaw, wanted.yaw), active=active
        )
        return sent, Corrected(
            fence=_differ(inside, slowed) & active,
            speed=_differ(slowed, asked) & active,
            separation=_differ(apart, inside) & active,
        )

    def _kept_apart(self, velocity: Array, position: Array, flown: Array, active: Mask) -> Array:
        """(N, 3) velocities from which agents can brake before each other."""
        first, second = pairs(position, self._reach)
        if not len(first):
            return velocity
        steered = active[:, None]
        kept = np.where(steered, velocity, flown)
        keep_apart(
            kept,
            position,
            flown,
            active,
            first,
            second,
            self._fence,
            self._speed,
            self._brakes,
            self._separation,
            self._period,
        )
        return np.where(steered, kept, velocity)

    def _warm_up(self) -> None:
        """Compile what is flown with, or fetch it from disk, before anybody flies."""
        two, level, both = np.zeros((2, 3)), np.zeros(2), np.ones(2, np.bool_)
        frames, wanted = Transform(level, two), Setpoint(two, level, both)
        here = Estimate(0.0, two, two, level, np.zeros((2, 3, 3)), both, frames)
        self.filter(here, wanted, wanted)
        warm_up()

    def _slowed(self, velocity: Array) -> Array:
        """(N, 3) velocities, none faster than the limit."""
        square = np.vecdot(velocity, velocity)
        if square.max(initial=0.0) <= self._speed * self._speed:
            return velocity
        slowed: Array = velocity * (self._speed / np.maximum(np.sqrt(square), self._speed))[:, None]
        return slowed


def _differ(one: Array, other: Array) -> Mask:
    """Whose velocities differ by more than counts: (N,)."""
    if one is other:
        return np.zeros(len(one), np.bool_)
    differ: Mask = np.abs(one - other).max(axis=1, initial=0.0) > COUNTS
    return differ
