"""The last check before setpoints are sent: geofence, speed limit and braking distances."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from star_core.geometry.neighbours import Pairs, warm_up
from star_core.messages.arrays import Array, Mask
from star_core.messages.events import Corrected
from star_core.messages.rotations import Transform
from star_core.messages.state import Estimate, Setpoint, with_possible_positions
from star_core.safety.braking_kernels import BRAKING_GAIN, LAG, limit_velocities
from star_core.scene import Scene

MIN_CORRECTION: Final = 0.05
"""Smallest change of a velocity that is reported as a correction, m/s."""


class SafetyFilter:
    """Corrects setpoints from which an agent could not brake in time.

    A velocity is safe if from it the agent can brake inside the geofence and at the minimum
    separation from every other agent; two agents that are both steered share the braking. With the
    remaining distance x and the speed c at which it shrinks now, a setpoint may let it shrink by
    ``BRAKING_GAIN (x - LAG c)``: a drone that follows setpoints with that lag comes to rest without
    overshoot. Nor may it be faster than what the mission's acceleration stops within x. Agents
    outside the fence or too close to another are therefore moved away. Setpoints are corrected by
    as little as possible; if the corrections for several neighbors do not converge, agents stop.

    Args:
        scene: Fence, limits and tick.

    Attributes:
        reach: Distance beyond which agents need not brake for each other, m.
    """

    def __init__(self, scene: Scene) -> None:
        self._fence = np.array([scene.world.fence.low, scene.world.fence.high])
        self._speed = scene.limits.speed
        self._brakes = scene.limits.acceleration
        self._separation = scene.limits.separation
        self._period = scene.period
        closing = 2 * self._speed
        room = closing * (LAG + max(1 / BRAKING_GAIN, scene.period + closing / (4 * self._brakes)))
        wide = math.dist(scene.world.fence.low, scene.world.fence.high)
        self.reach = self._separation + min(1.5 * room, wide)  # some approach faster than allowed
        self._warm_up(len(scene.agents))

    def filter(
        self, estimate: Estimate, safe: Setpoint, wanted: Setpoint, near: Pairs
    ) -> tuple[Setpoint, Corrected]:
        """Return the setpoint to send, and the agents whose setpoints were changed.

        Args:
            estimate: Of the agents' positions.
            safe: The avoider's setpoint. Its inactive rows get zero velocity; without a setpoint
                the drone would fall.
            wanted: Its active rows are sent.
            near: Pairs of agents within `reach`, at least.
        """
        seen, extended = with_possible_positions(estimate, wanted)
        if seen is estimate:
            return self._filter(estimate, safe, wanted, near)
        _, answered = with_possible_positions(estimate, safe)
        near = Pairs.of(seen.position, self.reach)
        sent, changed = self._filter(seen, answered, extended, near)
        n = len(wanted.yaw)
        return (
            Setpoint(sent.velocity[:n], sent.yaw[:n], sent.active[:n]),
            Corrected(changed.fence[:n], changed.speed[:n], changed.separation[:n]),
        )

    def _filter(
        self, estimate: Estimate, safe: Setpoint, wanted: Setpoint, near: Pairs
    ) -> tuple[Setpoint, Corrected]:
        """Filter tables that list every position at which an agent may be."""
        active = wanted.active
        if not np.isfinite(estimate.velocity).all():  # treated as stationary
            known = np.nan_to_num(estimate.velocity, posinf=0.0, neginf=0.0)
            estimate = replace(estimate, velocity=known)
        given = safe.active & active
        asked = np.where(given[:, None], safe.velocity, 0.0)
        slowed = self._slowed(asked)
        inside, apart = self._limited(slowed, estimate, active, near)
        sent = replace(
            safe, velocity=apart, yaw=np.where(given, safe.yaw, wanted.yaw), active=active
        )
        return sent, Corrected(
            fence=_differ(inside, slowed) & active,
            speed=_differ(slowed, asked) & active,
            separation=_differ(apart, inside) & active,
        )

    def _limited(
        self, velocity: Array, estimate: Estimate, active: Mask, near: Pairs
    ) -> tuple[Array, Array]:
        """Return (N, 3) velocities that stay inside the fence, and (N, 3) that keep apart too."""
        near = near.within(self.reach if self._separation > 0 else 0.0)
        inside, apart = velocity.copy(), np.empty_like(velocity)
        limit_velocities(
            inside,
            apart,
            estimate.position,
            estimate.velocity,
            active,
            near.first,
            near.second,
            self._fence,
            self._speed,
            self._brakes,
            self._separation,
            self._period,
        )
        return inside, np.where(active[:, None], apart, inside) if len(near.first) else inside

    def _warm_up(self, agents: int) -> None:
        """Compile the kernels, or load them from disk, before the flight."""
        two, level, both = np.zeros((2, 3)), np.zeros(2), np.ones(2, np.bool_)
        frames, wanted = Transform(level, two), Setpoint(two, level, both)
        here = Estimate(0.0, two, two, level, np.zeros((2, 3, 3)), both, frames)
        self.filter(here, wanted, wanted, Pairs.of(two, self.reach))
        warm_up(agents)

    def _slowed(self, velocity: Array) -> Array:
        """Return (N, 3) velocities, none faster than the limit."""
        square = np.vecdot(velocity, velocity)
        if square.max(initial=0.0) <= self._speed * self._speed:
            return velocity
        slowed: Array = velocity * (self._speed / np.maximum(np.sqrt(square), self._speed))[:, None]
        return slowed


def _differ(one: Array, other: Array) -> Mask:
    """Return which rows differ by more than `MIN_CORRECTION`: (N,)."""
    if one is other:
        return np.zeros(len(one), np.bool_)
    differ: Mask = np.abs(one - other).max(axis=1, initial=0.0) > MIN_CORRECTION
    return differ
