"""Where agents may be that are no longer heard."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from star_core.messages.arrays import Array
from star_core.messages.state import Estimate

MAX_REPORT_AGE: Final = 0.5
"""An agent whose newest report is older than this is not heard, s: the firmware's own limit for
setpoints, after which it levels out."""

FLIES_ON_FOR: Final = 2.0
"""How long an agent that hears nothing keeps its velocity, s, before its firmware stops the
motors (the commander's watchdog)."""


class UnheardAgents:
    """Marks the agents that are no longer heard, which may have stopped or may fly on.

    A drone whose reports are lost may have braked, landed or crashed where it was last heard; one
    that hears no setpoints either keeps its last velocity until its watchdog stops the motors. The
    estimate has such an agent at rest where it was last heard, with a
    `star_core.Estimate.possible_travel` of `FLIES_ON_FOR` at its last velocity.

    Args:
        n: Number of agents.
    """

    def __init__(self, n: int) -> None:
        self._velocity: Array = np.zeros((n, 3))  # m/s, when last heard

    def mark(self, estimate: Estimate, age: Array) -> Estimate:
        """Return the estimate with the agents marked that are not heard.

        Args:
            estimate: Of the tick.
            age: (N,) age of each agent's newest report, s.
        """
        heard = (age <= MAX_REPORT_AGE)[:, None]
        known = np.isfinite(estimate.velocity).all(axis=1, keepdims=True)
        self._velocity = np.where(heard & known, estimate.velocity, self._velocity)
        if heard.all():
            return estimate
        return replace(
            estimate,
            velocity=np.where(heard, estimate.velocity, 0.0),
            possible_travel=np.where(heard, 0.0, FLIES_ON_FOR * self._velocity),
        )
