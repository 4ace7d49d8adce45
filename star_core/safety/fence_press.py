"""Agents that setpoints press against the geofence, where their estimates drift out of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from star_core.messages.arrays import Mask
from star_core.messages.state import Estimate, Setpoint
from star_core.safety.filter import BRAKING_GAIN, LAG, MIN_CORRECTION, RETURN_SPEED
from star_core.scene import Scene

PRESSED_TIME: Final = 0.5
"""Time after which an agent that the fence holds back is drawn in, s."""

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
    setpoint presses.

    Args:
        scene: Fence and tick.
    """

    def __init__(self, scene: Scene) -> None:
        self._fence = np.array([scene.world.fence.low, scene.world.fence.high])
        self._period = scene.period
        n = len(scene.agents)
        self._pressed = np.zeros(n)  # s

    def draw_in(
        self, estimate: Estimate, avoided: Setpoint, wanted: Setpoint
    ) -> tuple[Setpoint, Mask]:
        """Return the setpoint, with agents that press against the fence led away from it.

        Args:
            estimate: Of the agents' positions.
            avoided: The avoider's setpoint.
            wanted: The planner's.

        Returns:
            The setpoint, and whether the velocities of avoider and planner lead out of the fence:
            (2, N).
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
        velocity = np.array([avoided.velocity, wanted.velocity])
        outward = (velocity > most) | (velocity < least)
        beyond = np.maximum(most, MIN_CORRECTION), np.minimum(least, -MIN_CORRECTION)
        leads_out: Mask = ((velocity > beyond[0]) | (velocity < beyond[1])).any(axis=2)
        presses = outward.any(axis=(0, 2)) & wanted.active
        self._pressed = np.where(presses, self._pressed + self._period, 0.0)
        drawn &= presses
        if not drawn.any():
            return avoided, leads_out
        kept = np.clip(avoided.velocity, down, up)
        velocity = np.where(drawn[:, None], kept, avoided.velocity)
        return replace(avoided, velocity=velocity), leads_out
