"""The last word on what is sent: nobody leaves the fence, is too fast, or cannot brake in time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from star_core.flight import Corrected
from star_core.near import pairs
from star_core.scene import Scene
from star_core.swarm import Estimate, Setpoint
from star_core.table import Array, Mask, Rows

LAG: Final = 0.4
"""How far a drone that is to stop flies on, as a time by its speed, s. A simulated Crazyflie
follows a step of its velocity setpoint to 63 % in 0.3 s, and hears of it up to a tick late."""

PULL: Final = 2.5
"""How soon a drone is to come to rest before what it must not reach, 1/s: 1 / `LAG` is critical."""

PART: Final = 0.2
"""How fast who is at rest beyond the fence or too near to another is drawn back, m/s at most."""

ROUNDS: Final = 30
"""How often velocities of agents that close in on each other are corrected before they stop."""

ENOUGH: Final = 1e-3
"""By how much agents may close in too fast, m/s: corrections settle no finer."""

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
        self._low = np.array(scene.world.fence.low)
        self._high = np.array(scene.world.fence.high)
        self._speed = scene.limits.speed
        self._brakes = scene.limits.acceleration
        self._separation = scene.limits.separation
        self._period = scene.period
        closing = 2 * self._speed
        room = closing * (LAG + max(1 / PULL, scene.period + closing / (4 * self._brakes)))
        stops = self._speed * scene.period + self._speed * self._speed / (2 * self._brakes)
        self._clear = max(self._speed / PULL, stops)  # m, from which nobody need brake yet
        wide = math.dist(scene.world.fence.low, scene.world.fence.high)
        self._reach = self._separation + min(1.5 * room, wide)  # some close in faster than they may

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
        velocity = self._slowed(asked)
        too_fast = _differ(velocity, asked)
        inside = self._kept_inside(velocity, estimate, active)
        outside = _differ(inside, velocity)
        velocity = self._kept_apart(inside, estimate, active)
        near = _differ(velocity, inside)
        sent = replace(
            safe,
            velocity=velocity,
            yaw=np.where(said, safe.yaw, wanted.yaw),
            active=active,
        )
        return sent, Corrected(outside & active, too_fast & active, near & active)

    def _slowed(self, velocity: Array) -> Array:
        """(N, 3) velocities, none faster than the limit."""
        square = np.einsum("ij,ij->i", velocity, velocity)
        if square.max(initial=0.0) <= self._speed * self._speed:
            return velocity
        slowed: Array = velocity * (self._speed / np.maximum(np.sqrt(square), self._speed))[:, None]
        return slowed

    def _kept_inside(self, velocity: Array, estimate: Estimate, active: Mask) -> Array:
        """(N, 3) velocities from which agents can brake before the fence."""
        room = np.minimum(self._high - estimate.position, estimate.position - self._low)
        fast = np.abs(estimate.velocity).max(initial=0.0)
        if room.min(initial=np.inf) > self._clear + LAG * fast:
            return velocity
        up = self._from(self._high - estimate.position, estimate.velocity, self._brakes)
        down = self._from(estimate.position - self._low, -estimate.velocity, self._brakes)
        kept = np.clip(velocity, np.minimum(-down, up), np.maximum(up, -down))
        return np.where(active[:, None], kept, velocity)

    def _kept_apart(self, velocity: Array, estimate: Estimate, active: Mask) -> Array:
        """(N, 3) velocities from which agents can brake before each other."""
        if self._separation == 0:
            return velocity
        first, second = pairs(estimate.position, self._reach)
        if not len(first):
            return velocity
        moving = np.where(active[:, None], velocity, estimate.velocity)
        offset = estimate.position.take(first, 0) - estimate.position.take(second, 0)
        apart = np.sqrt(np.einsum("ij,ij->i", offset, offset))
        offset[apart == 0] = 1.0, 0.0, 0.0
        towards = offset / np.where(apart == 0, 1.0, apart)[:, None]
        steered = active[first].astype(np.float64) + active[second]
        closes = _along(towards, estimate.velocity, first, second)
        room = apart - self._separation
        allowed = self._from(room, closes, self._brakes * np.maximum(1.0, steered))
        if not ((_along(towards, moving, first, second) > allowed + ENOUGH) & (steered > 0)).any():
            return velocity
        fastest = self._fastest(estimate, active)
        near = np.flatnonzero(
            (fastest[first] + fastest[second] > allowed + ENOUGH) & (steered > 0)
        )  # no correction can bring the others to close in too fast
        first, second, towards = first[near], second[near], towards[near]
        steered, allowed = steered[near], allowed[near]
        for _ in range(ROUNDS):
            closing = _along(towards, moving, first, second)
            bad = np.flatnonzero(closing > allowed + ENOUGH)
            if not len(bad):
                break
            one, two = first[bad], second[bad]
            push = towards[bad] * ((closing - allowed)[bad] / steered[bad])[:, None]
            both = np.concatenate([one, two])
            times = np.bincount(both, minlength=len(moving))
            more = np.stack(
                [np.bincount(both, np.concatenate([axis, -axis]), len(moving)) for axis in push.T],
                axis=1,
            )
            moving = moving + more / np.maximum(times, 1.0)[:, None]
            moving = self._kept_inside(self._slowed(moving), estimate, active)
            moving = np.where(active[:, None], moving, estimate.velocity)
        else:
            stop = np.zeros_like(active)
            stop[first[bad]] = stop[second[bad]] = True
            moving = np.where((stop & active)[:, None], 0.0, moving)
        kept: Array = np.where(active[:, None], moving, velocity)
        return kept

    def _fastest(self, estimate: Estimate, active: Mask) -> Array:
        """(N,) what no agent is faster than while its setpoint is corrected, m/s.

        Who is steered is slowed to the limit; beyond that only the fence makes it faster.
        """
        forced = self._kept_inside(np.zeros_like(estimate.velocity), estimate, active)
        fastest: Array = np.where(
            active,
            self._speed + np.sqrt(np.einsum("ij,ij->i", forced, forced)),
            np.sqrt(np.einsum("ij,ij->i", estimate.velocity, estimate.velocity)),
        )
        return fastest

    def _from(self, room: Array, closes: Array, brakes: Array | float) -> Array:
        """The fastest that a setpoint may let room shrink, m/s, that shrinks by `closes` now."""
        late = self._period * brakes
        stops = np.sqrt(late * late + 2 * brakes * np.maximum(0.0, room)) - late
        fastest = np.minimum(PULL * (room - LAG * closes), stops)
        back: Array = np.maximum(fastest, -PART - np.maximum(0.0, closes))
        return back


def _differ(one: Array, other: Array) -> Mask:
    """Whose velocities differ by more than counts: (N,)."""
    if one is other:
        return np.zeros(len(one), np.bool_)
    differ: Mask = np.abs(one - other).max(axis=1, initial=0.0) > COUNTS
    return differ


def _along(towards: Array, velocity: Array, first: Rows, second: Rows) -> Array:
    """How fast agents `second` fly along (P, 3) unit vectors, less how fast `first` do, m/s."""
    closing: Array = np.einsum(
        "ij,ij->i", towards, velocity.take(second, 0) - velocity.take(first, 0)
    )
    return closing
