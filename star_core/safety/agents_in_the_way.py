"""Agents that are in the way elsewhere than estimated: not heard, not located, or on the ground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows, every, some
from star_core.messages.state import AgentPhase
from star_core.safety.monitors import Stage, TickState, Use
from star_core.world.scene import Limits

MAX_REPORT_AGE: Final = 0.5
"""An agent whose newest report is older than this is not heard, s: the firmware's own limit for
setpoints, after which it levels out."""

WATCHDOG_TIME: Final = 2.0
"""How long an agent that hears nothing keeps its velocity, s, before its firmware stops the
motors (the commander's watchdog)."""

FALL_TIME: Final = 1.0  # s; from 3 m it is 0.8 s
EMERGENCY, LANDED = int(AgentPhase.EMERGENCY), int(AgentPhase.LANDED)
BRAKING_TIME: Final = 0.6  # s, by which the velocity of an agent that brakes leads it on


class GroundedAgents:
    """Marks the agents that stay on the ground until the end of the flight.

    They fell, or landed and do not return to the mission. Their motors are off, and downwash does
    not disturb them: they are marked so far below the ground that agents above
    keep `Limits.separation` rather than `Limits.vertical_separation`. Agents that may take off
    keep their heights.
    """

    after = Stage.PLANNED

    def __init__(self, n: int, limits: Limits) -> None:
        self._depth = _depth(limits)
        self._fallen_at = np.full(n, np.inf)  # s

    def check(self, state: TickState) -> Iterator[Use]:
        """Yield the estimate by which agents are kept apart."""
        estimate, phase = state.estimate, state.health.phase
        fallen = phase == EMERGENCY
        since = np.fmin(self._fallen_at, estimate.time)
        self._fallen_at = np.where(fallen, since, np.inf)
        down = (phase == LANDED) & state.gone
        down |= estimate.time - self._fallen_at >= FALL_TIME
        if some(down):
            position, travel = estimate.position.copy(), estimate.possible_travel.copy()
            position[down, 2], travel[down, 2] = -self._depth, 0.0
            estimate = replace(estimate, position=position, possible_travel=travel)
        yield Use("visible", estimate)


def _depth(limits: Limits) -> float:
    """Return how far below the ground agents are marked above which others may fly lower, m."""
    spare = limits.vertical_separation - limits.separation
    return max(0.0, spare) if limits.separation > 0 else 0.0


class UnheardAgents:
    """Marks the agents that are not heard, which may fly on, and those that are not located.

    A drone whose reports are lost may have braked, landed or crashed where it was last heard; one
    that hears no setpoints either keeps its last velocity until its watchdog stops the motors. The
    estimate has such an agent at rest where it was last heard, with a
    `star_core.Estimate.possible_travel` of `WATCHDOG_TIME` at its last velocity. Once it has fallen
    or landed in any case, all of this is on the ground. Its motors are off then, and downwash does
    not disturb it: it is marked so far below the ground that agents above keep `Limits.separation`
    rather than `Limits.vertical_separation`.

    An agent whose last command is flown on board ends that without a link. After its planned end,
    in a climb from the beginning, it is marked at the end of that flight, from which it either
    hovers or, if `star_core.Telemetry.lands_by` is finite, descends: then its possible positions
    are the whole column down to the ground, and from that time on it is on the ground.

    An agent that is heard but no longer located in flight brakes, by `BRAKING_TIME` at its last
    velocity. It stays at all of these positions, also on the ground, until it is located. If it
    lands, it passes all heights below: others leave its way.
    """

    after = Stage.LOCATED

    def __init__(self, n: int, limits: Limits) -> None:
        self._depth = _depth(limits)
        self._astray = np.zeros(n, np.bool_)  # heard, but not located since they were in the air
        self._velocity: Array = np.zeros((n, 3))  # m/s, when last heard and located
        self._down_by = np.full(n, np.inf)  # s, mission time
        self._on_board = np.zeros(n, np.bool_)  # whether it may fly what follows
        self._end = np.full((n, 3), np.nan)  # m, where that ends; x and y of a climb are NaN
        self._ends_at = np.full(n, np.inf)  # s, planned
        self._lands = np.zeros(n, np.bool_)  # whether they were last commanded to land or to stop

    def check(self, state: TickState) -> Iterator[Use]:
        """Yield the estimate with the agents marked that are not heard or not located."""
        estimate, airborne, lands_by = state.estimate, state.airborne, state.telemetry.lands_by
        self._on_board &= ~state.taken_over
        heard = state.telemetry.age <= MAX_REPORT_AGE
        finite = np.isfinite(estimate.velocity)
        if every(heard) and every(estimate.valid) and every(finite):
            self._velocity, self._astray = estimate.velocity, ~heard
            return
        usable = heard & estimate.valid & finite.all(axis=1)
        self._velocity = np.where(usable[:, None], estimate.velocity, self._velocity)
        self._astray = heard & ~estimate.valid & (airborne | self._astray)
        if every(heard) and not some(self._astray):
            return
        position = estimate.position.copy()
        flies_on = np.where(self._astray, BRAKING_TIME, np.where(heard, 0.0, WATCHDOG_TIME))
        travel = flies_on[:, None] * self._velocity
        down_by = self._down_by
        if (on_board := ~heard & self._on_board).any():
            # one that was announced before the command is not of it
            later = np.full(len(heard), np.inf) if lands_by is None else lands_by
            later = np.where(later >= self._ends_at, later, np.inf)
            down_by = np.where(on_board, np.maximum(down_by, later), down_by)
            self._add_columns(position, travel, on_board, estimate.time, np.isfinite(later))
        down = ~heard & (estimate.time >= down_by)
        descends = self._astray & self._lands & airborne & np.isfinite(position[:, 2])
        travel[descends, 2] = -np.maximum(position[descends, 2], 0.0)
        position[down, 2], travel[down, 2] = -self._depth, 0.0
        marked = replace(
            estimate,
            position=position,
            velocity=np.where(heard[:, None], estimate.velocity, 0.0),
            possible_travel=travel,
        )
        yield Use("estimate", marked)

    def steered(self, time: float, rows: Mask | Rows) -> None:
        """Note that setpoints were sent to agents: without another one their motors stop."""
        self._down_by[rows] = time + WATCHDOG_TIME + FALL_TIME
        self._lands[rows] = False

    def descend(self, rows: Mask) -> None:
        """Note that setpoints lead agents down to the ground: (N,)."""
        self._lands |= rows

    def flies_on_board(self, rows: Rows, end: Array, until: Array) -> None:
        """Note that agents fly a command, after which they hover or land.

        Args:
            rows: (K,) the agents.
            end: (K, 3) where it ends, m; x and y are NaN if it is a climb.
            until: (K,) when it ends, s.
        """
        self._down_by[rows] = -np.inf
        self._on_board[rows], self._end[rows], self._ends_at[rows] = True, end, until
        self._lands[rows] = False

    def lands(self, rows: Rows, until: Array, heard: Mask) -> None:
        """Note that agents were commanded to land or to stop.

        Args:
            rows: (K,) the agents.
            until: (K,) mission times at which they are down, s, if they receive the command.
            heard: (K,) which of them certainly do. The others stop for want of setpoints, if
                these flew them.
        """
        self._down_by[rows] = np.where(heard, until, np.maximum(until, self._down_by[rows]))
        self._on_board[rows] &= ~heard
        self._lands[rows] = True

    def _add_columns(
        self, position: Array, travel: Array, on_board: Mask, time: float, descends: Mask
    ) -> None:
        """Change positions and travel, (N, 3) m, of agents that fly on board to where that ends."""
        climbs = on_board & np.isnan(self._end[:, 0])
        arrived = on_board & ~climbs & (time >= self._ends_at)
        lowest = np.where(descends, 0.0, position[:, 2])
        position[climbs, 2] = np.fmax(position[climbs, 2], self._end[climbs, 2])
        position[arrived] = self._end[arrived]
        lowest[arrived & ~descends] = self._end[arrived & ~descends, 2]
        column = climbs | arrived
        travel[column] = 0.0
        travel[column, 2] = np.fmin(lowest - position[:, 2], 0.0)[column]
