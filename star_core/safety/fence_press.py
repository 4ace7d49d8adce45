"""Agents that setpoints press against the geofence, where their estimates drift out of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.state import Estimate, Setpoint
from star_core.safety.filter import BRAKING_GAIN, LAG, MIN_CORRECTION, RETURN_SPEED
from star_core.scene import Scene

PRESSED_TIME: Final = 0.5
"""Time after which an agent that the fence holds back is drawn in, s."""

STUCK_TIME: Final = 2.0
"""Time after which a setpoint that presses and never changes is reported, s. At a constant speed
towards the fence the filter brings an agent to within 1 % of its braking distance in that time."""

SIGMAS: Final = 3.0
"""Standard deviations of its position by which an agent is drawn in."""

MAX_MARGIN: Final = 0.5
"""Greatest distance by which an agent is drawn in, m; it is also at most a quarter of the width of
the fence."""


class FencePress:
    """Leads agents away from the fence that setpoints keep pressing against it.

    The fence of the safety filter is that of the estimated positions, so that goals near it can be
    reached. An agent that is held there for long is carried out by the drift of its estimate: as
    when a planner or an avoider repeats its last output. A setpoint presses if it leads nearer to
    the fence than an agent can brake before it, in the filter's terms; after `PRESSED_TIME` the
    fence is moved in for the agent, by `SIGMAS` standard deviations of its position, until no
    setpoint presses. The drift goes on meanwhile, also along the fence: so a setpoint of planner or
    avoider that presses and stays the same to the last bit for `STUCK_TIME`, while the estimated
    position changes in every tick, is reported.

    Args:
        scene: Fence and tick.
    """

    def __init__(self, scene: Scene) -> None:
        self._fence = np.array([scene.world.fence.low, scene.world.fence.high])
        self._period = scene.period
        n = len(scene.agents)
        self._pressed = np.zeros(n)  # s
        self._same = np.zeros((2, n))  # s, that avoider and planner press with the same velocity
        self._seen = np.full((3, n, 3), np.nan)  # their velocities and the positions

    def draw_in(self, estimate: Estimate, safe: Setpoint, wanted: Setpoint) -> Setpoint:
        """Return the setpoint, with agents that press against the fence led away from it.

        Args:
            estimate: Of the agents' positions.
            safe: The avoider's setpoint.
            wanted: The planner's.
        """
        drawn = self._pressed > PRESSED_TIME
        low, high = self._fence
        ahead = estimate.position + LAG * np.nan_to_num(estimate.velocity)
        if drawn.any():
            std = np.sqrt(np.nan_to_num(np.diagonal(estimate.covariance, axis1=1, axis2=2)))
            margin = np.minimum(SIGMAS * std, np.minimum(MAX_MARGIN, (high - low) / 4))
            margin *= drawn[:, None]
            low, high = low + margin, high - margin
        up = np.maximum(BRAKING_GAIN * (high - ahead), -RETURN_SPEED)
        down = np.minimum(BRAKING_GAIN * (low - ahead), RETURN_SPEED)
        most, least = up + MIN_CORRECTION, down - MIN_CORRECTION
        velocity = np.array([safe.velocity, wanted.velocity])
        outward = (velocity > most) | (velocity < least)
        beyond = np.maximum(most, MIN_CORRECTION), np.minimum(least, -MIN_CORRECTION)
        leads_out = ((velocity > beyond[0]) | (velocity < beyond[1])).any(axis=2)
        self._compare(estimate, velocity, leads_out & wanted.active)
        presses = outward.any(axis=(0, 2)) & wanted.active
        self._pressed = np.where(presses, self._pressed + self._period, 0.0)
        drawn &= presses
        if not drawn.any():
            return safe
        kept = np.clip(safe.velocity, down, up)
        return replace(safe, velocity=np.where(drawn[:, None], kept, safe.velocity))

    def stuck(self) -> dict[int, str]:
        """Return why agents that such setpoints press cannot reach their goals, by row."""
        return {
            row: f"the {kind} repeats a setpoint that leads out of the fence"
            for kind, same in zip(("avoider", "planner"), self._same, strict=True)
            for row in np.flatnonzero(same > STUCK_TIME).tolist()
        }

    def _compare(self, estimate: Estimate, velocity: Array, presses: Mask) -> None:
        """Measure for how long avoider and planner, (2, N), press with the same velocity."""
        seen = np.concatenate([velocity, estimate.position[None]])
        same: Mask = (seen == self._seen).all(axis=2)
        self._seen = seen
        stays = presses & same[:2] & ~same[2]
        self._same = np.where(stays, self._same + self._period, 0.0)
