"""Rejects estimated positions that an agent cannot have reached by flying."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.state import Estimate
from star_core.messages.transforms import Transform

MARGIN: Final = 1.5
"""How far positions may move beyond that, m: localizers are sometimes surer than they should be.
In 30 flights with `method: batch`, the worst localizer here, it was 1.0 m at most."""

FORGETTING_TIME: Final = 5.0
"""Time constant with which movement is forgotten that the speed did not explain, s."""

SIGMAS: Final = 4.0
"""Standard deviations by which a position may be corrected. The covariance of a correction is that
of the estimate before less that of the estimate after it (Kalman)."""

SPEED_RATIO: Final = 2.0
"""Greatest plausible speed over the mission's limit: overshoot, gusts, descents."""

LEAST_SPEED: Final = 3.0
"""Speed that is plausible whatever the mission's limit is, m/s: on-board trajectories, falls."""


@dataclass(frozen=True, slots=True)
class Jump:
    """A position that was rejected, when the one before had been accepted.

    Attributes:
        row: Of the agent.
        distance: From the last position that was accepted, m.
        seconds: Time since then, s.
        plausible: Greatest distance that would have been accepted, m.
    """

    row: int
    distance: float
    seconds: float
    plausible: float


class EstimateGate:
    """Compares each estimated position with the last one that was accepted.

    In the time between the two an agent can have flown some distance, and a localizer can have
    corrected it by as much as the covariance shrank. Movement beyond that adds up over ticks, and
    is forgotten in `FORGETTING_TIME`; many small jumps are a large one. A position with which it
    exceeds `MARGIN` is rejected: the row stays where it was, at rest and not valid, so that the
    agent brakes. It is compared again in the next tick. On the ground everything is accepted.

    Args:
        n: Number of agents.
        speed: The mission's speed limit, m/s.
    """

    def __init__(self, n: int, speed: float) -> None:
        self._speed = max(SPEED_RATIO * speed, LEAST_SPEED)
        self._time = np.zeros(n)  # s, of the last position that was accepted
        self._position = np.full((n, 3), np.nan)
        self._covariance = np.zeros((n, 3, 3))
        self._frames = Transform(np.zeros(n), np.zeros((n, 3)))
        self._unexplained = np.zeros(n)  # m, of late
        self._rejected = np.zeros(n, np.bool_)

    def check(self, estimate: Estimate, airborne: Mask) -> tuple[Estimate, Sequence[Jump]]:
        """Return the estimate without the positions that are rejected, and the new jumps.

        Args:
            estimate: A localizer's, with map_from_odom finite everywhere.
            airborne: (N,) which agents are in the air.
        """
        seconds = estimate.time - self._time
        before, now = (
            np.trace(c, axis1=1, axis2=2) for c in (self._covariance, estimate.covariance)
        )
        moved = np.linalg.norm(estimate.position - self._position, axis=1)
        explained = self._speed * seconds + SIGMAS * np.sqrt(np.fmax(before - now, 0.0))
        carried = self._unexplained * np.exp(-seconds / FORGETTING_TIME)
        unexplained = carried + np.maximum(moved - explained, 0.0)
        rejected = airborne & estimate.valid & (unexplained > MARGIN)  # what is NaN is not
        accepted = estimate.valid & ~rejected
        plausible = explained + MARGIN - carried
        jumps = [
            Jump(row, float(moved[row]), float(seconds[row]), float(plausible[row]))
            for row in np.flatnonzero(rejected & ~self._rejected).tolist()
        ]
        self._rejected = rejected | (self._rejected & ~accepted)
        self._remember(estimate, accepted, np.where(airborne, unexplained, 0.0))
        if not rejected.any():
            return estimate, jumps
        column = rejected[:, None]
        return replace(
            estimate,
            position=np.where(column, self._position, estimate.position),
            velocity=np.where(column, 0.0, estimate.velocity),
            covariance=np.where(column[..., None], self._covariance, estimate.covariance),
            valid=accepted,
            map_from_odom=Transform(
                np.where(rejected, self._frames.yaw, estimate.map_from_odom.yaw),
                np.where(column, self._frames.translation, estimate.map_from_odom.translation),
            ),
        ), jumps

    def _remember(self, estimate: Estimate, accepted: Mask, unexplained: Array) -> None:
        """Keep the rows that are accepted for the next comparison."""
        column = accepted[:, None]
        frames = estimate.map_from_odom
        self._time = np.where(accepted, estimate.time, self._time)
        self._position = np.where(column, estimate.position, self._position)
        self._covariance = np.where(column[..., None], estimate.covariance, self._covariance)
        self._frames = Transform(
            np.where(accepted, frames.yaw, self._frames.yaw),
            np.where(column, frames.translation, self._frames.translation),
        )
        known = np.where(np.isfinite(unexplained), unexplained, 0.0)
        self._unexplained = np.where(accepted, known, self._unexplained)
