"""Monitors the setpoints of planner and avoider: pressed against the fence, or stuck."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.state import Estimate, Goals, Setpoint
from star_core.safety.braking import BRAKING_GAIN, LAG, RETURN_SPEED
from star_core.safety.filter import MIN_CORRECTION
from star_core.scene import Scene

PRESSED_TIME: Final = 0.5
"""Time after which an agent that the fence holds back is drawn in, s."""

SIGMAS: Final = 3.0
"""Standard deviations of its position by which an agent is drawn in."""

MAX_MARGIN: Final = 0.5
"""Greatest distance by which an agent is drawn in, m; it is also at most a quarter of the width of
the fence."""

REPEATED_TIME: Final = 0.5
"""Time after which a repeated setpoint that should have changed is reported, s. Plugins may compute
their output less often than in every tick."""

OUTWARD_TIME: Final = 2.0
"""Time after which one that leads out of the fence is, s. At a constant speed towards the fence the
safety filter brings an agent to within 1 % of its braking distance in that time."""

MIN_CHANGE: Final = 0.2
"""Change of the planner's velocity that an avoider cannot ignore for every agent, m/s."""

ARRIVAL: Final = 0.3
"""Distance from a goal within which a straight flight has passed it, m; between an agent and a goal
beyond a wall is more."""

CHECKS: Final = (
    ("avoider", REPEATED_TIME, "repeats its setpoints, whatever the planner's are"),
    ("planner", REPEATED_TIME, "repeats a setpoint that leads {} past the goal"),
    ("avoider", OUTWARD_TIME, "repeats a setpoint that leads {} out of the fence"),
    ("planner", OUTWARD_TIME, "repeats a setpoint that leads {} out of the fence"),
)
"""Kind of plugin, time after which it is reported in s, and what is reported of which agents."""


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


class RepeatedSetpoints:
    """Finds planners and avoiders that are stuck: their velocities stay the same to the last bit.

    That alone is right in many flights. It is reported of

    - an avoider that repeats the velocities of all agents though the planner's, of an agent that
      does not stand still, is `MIN_CHANGE` from what it was when the repetition began;
    - a planner that repeats the velocity of an agent which has been within `ARRIVAL` of its goal,
      and no longer is; the goal stays where it is;
    - either, if what it repeats leads out of the fence while the estimated position changes, for
      the avoider the planner's velocity too.

    Args:
        scene: Agents and tick.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, n = scene, len(scene.agents)
        self._lasted = np.zeros((len(CHECKS), n))  # s
        self._limit = np.array([[limit] for _, limit, _ in CHECKS])
        # velocities of avoider and planner, position and goal, in the tick before
        self._before = np.full((4, n, 3), np.nan)
        self._begun = np.zeros((n, 3))  # the planner's velocities when the avoider's were new
        self._near = np.zeros(n, np.bool_)  # since the planner's were

    def find(
        self, estimate: Estimate, goals: Goals, avoided: Setpoint, wanted: Setpoint, outward: Mask
    ) -> dict[str, str]:
        """Return what is wrong with avoider or planner, by its kind.

        Args:
            estimate: Of the agents' positions.
            goals: The tasks'.
            avoided: The avoider's setpoint.
            wanted: The planner's.
            outward: (2, N) whether the velocities of avoider and planner lead out of the fence.
        """
        now = np.array([avoided.velocity, wanted.velocity, estimate.position, goals.position])
        same_avoided, same_wanted, same_position, same_goal = (now == self._before).all(axis=2)
        self._before = now
        self._begun = np.where(same_avoided[:, None], self._begun, wanted.velocity)
        ignored = _length(wanted.velocity - self._begun) > MIN_CHANGE
        distance = _length(goals.position - estimate.position)
        at_rest = same_goal & goals.active & ~goals.velocity.any(axis=1)
        self._near = same_wanted & at_rest & (self._near | (distance < ARRIVAL))
        repeats: Mask = np.array(
            [
                ignored & now[0].any(axis=1) & bool(same_avoided[wanted.active].all()),
                self._near & (distance > ARRIVAL),
                same_avoided & ~same_wanted & outward[0] & ~same_position,
                same_wanted & outward[1] & ~same_position,
            ]
        )
        self._lasted = np.where(repeats & wanted.active, self._lasted + self._scene.period, 0.0)
        return {
            kind: text.format(self._scene.named(np.flatnonzero(late)))
            for (kind, _, text), late in zip(CHECKS, self._lasted > self._limit, strict=True)
            if late.any()
        }


def _length(vectors: Array) -> Array:
    length: Array = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return length
