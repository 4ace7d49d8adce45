"""Agents whose positions are too uncertain for the room that they have: brake, return, land."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from enum import IntEnum
from typing import Final

import numpy as np

from star_core import Array, Estimate, Goals, Mask, Rows, Scene, Setpoint
from star_core.toolkit import (
    CONTACT_RADIUS,
    Exclude,
    Report,
    SafetyAction,
    TickState,
    Use,
    position_deviation,
    some,
)
from star_core.toolkit import Stage as TickStage
from star_monitors.room import PARTING_SPEED, PairRoom, Room, WallRoom

RELEASE_USE: Final = 0.8  # of its room: an agent that uses less flies on
WAITING_USE: Final = 2 / 3  # of the room to an agent that lands, from which on others wait for it
CORRECTION_RATIO: Final = 0.9  # of the deviation before: below, a landmark corrected the position
LOCATED_RATIO: Final = 0.5  # of the deviation for which an agent returned: below, it is located
WAITING_TIME: Final = 3.0  # s, for a correction, before and after a return
PARTING_TIME: Final = 0.5  # s, in one flight, for two agents to fly apart: then one of them lands
ARRIVAL_DISTANCE: Final = 0.2  # m, at which an agent has returned to where it was located
MAX_RETURNS: Final = 3  # of an agent in one flight: then it lands

NOTHING_NEAR: Final = (np.zeros(0, np.int64), np.zeros((0, 2)))


class Stage(IntEnum):
    """What an agent does about its uncertainty."""

    FLIES = 0
    BRAKES = 1
    RETURNS = 2


class UncertainAgents:
    """Stops agents whose uncertainty leaves no room to obstacles, fence or each other.

    An agent that needs more room than it has, see `Room`, flies no nearer to what is near. If that
    does not help, and no correction makes its position more certain within `WAITING_TIME`, it
    returns to the position at which a correction arrived last; an agent that never had one, does
    not get one there, or has returned `MAX_RETURNS` times, lands. A correction is a sudden decrease
    of the covariance, whatever the localizer.

    Of two agents without room between them, only that makes way which has the most such neighbors,
    or else the later one; the other waits meanwhile. One that never had a correction lands, after
    `PARTING_TIME` without room in all: two that pass each other lack it for a moment.

    Attributes:
        reports: Of this tick.
    """

    after = TickStage.AIMED, TickStage.PLANNED

    def __init__(self, scene: Scene) -> None:
        n = len(scene.agents)
        self._scene = scene
        self.reports: list[Report] = []
        self._room = Room(scene)
        self._std = np.zeros(n)  # m, of the tick before
        self._corrected_at = np.full((n, 2), np.nan)  # m
        self._stage = np.zeros(n, np.int64)
        self._until = np.full(n, np.inf)  # s, end of the stage at the latest
        self._return_goal = np.zeros((n, 3))  # m
        self._return_limit = np.zeros(n)  # m, deviation below which an agent has returned
        self._returns = np.zeros(n, np.int64)
        self._short_time = np.zeros(n)  # s, in which agents that are never corrected had no room
        self._time = 0.0  # s, of the tick
        self._near = NOTHING_NEAR
        self._stopped = np.zeros(n, np.bool_)  # in the last tick

    def check(self, state: TickState) -> Iterator[Report | Use | Exclude]:
        """Yield the goals of agents that return, and the agents that must land.

        Once planned, yield the setpoint without what leads nearer to what there is no room to, and
        the agents that brake or return.
        """
        if state.stage is TickStage.PLANNED:
            stopped = self.stop(state.setpoint)
            if stopped is not state.setpoint:
                yield Use("setpoint", stopped)
            redirected: Mask = (self._stage > 0) | self._stopped  # `Stage.FLIES`
            if some(redirected):
                yield Use("redirected", redirected)
            return
        goals, lands = self.redirect(
            state.estimate, state.steered, state.landing, state.airborne, state.goals
        )
        yield from self.reports
        for row, reason in lands:
            yield Exclude(row, SafetyAction.LAND, reason, fails=True)
        if goals is not state.goals:
            yield Use("goals", goals)

    def redirect(
        self, estimate: Estimate, steered: Mask, landing: Mask, airborne: Mask, goals: Goals
    ) -> tuple[Goals, list[tuple[int, str]]]:
        """Return the goals, changed for agents that return; and which must land, and why.

        Args:
            estimate: Of the agents' positions.
            steered: (N,) agents that setpoints fly and that do not land.
            landing: (N,) agents that land.
            airborne: (N,) agents in the air.
            goals: The tasks'.
        """
        self._near, self.reports = NOTHING_NEAR, []
        if self._scene.limits.uncertainty_margin == 0.0:
            return goals, []
        self._time = estimate.time
        std = self._std = self._updated_std(estimate, steered)
        self._stage *= steered  # the others fly
        min_use = WAITING_USE if some(landing) else 1.0
        enough, walls = self._room.measure(estimate, std, steered, airborne, min_use)
        if enough and not some(self._stage > 0):  # `Stage.FLIES`
            return goals, []
        pairs = self._room.between(estimate, std, airborne, WAITING_USE)
        if walls is None and pairs is None and not some(self._stage > 0):
            return goals, []
        use, pair = np.zeros(len(std)), np.full(len(std), -1)  # the pair is the one to blame
        if walls is not None:
            use = walls.use
        if pairs is not None:
            use, pair = self._greatest(use, pairs, self._yielding(pairs, steered, landing))
        lands = []
        for row in np.flatnonzero(steered & ((use > 1.0) | (self._stage > Stage.FLIES))).tolist():
            reason = f"uncertain by {std[row]:.2f} m"
            if pairs is not None and pair[row] >= 0:
                reason += self._to_agent(row, pairs, int(pair[row]))
            elif walls is not None:
                reason += self._to_wall(row, walls)
            waits = pair[row] < 0 or bool(np.isfinite(self._corrected_at[row]).all())
            if text := self._advance(row, estimate, float(use[row]), reason, waits=waits):
                lands.append((row, text))
        self._near = self._constraints(walls, pairs, steered, landing)
        return self._redirected(goals), lands

    def _updated_std(self, estimate: Estimate, steered: Mask) -> Array:
        """Return the standard deviations in the plane, (N,) m; note which were just corrected."""
        std = position_deviation(estimate.covariance)
        corrected = steered & (std < CORRECTION_RATIO * self._std)
        if some(corrected):
            self._corrected_at[corrected] = estimate.position[corrected, :2]
        return std

    def stop(self, setpoint: Setpoint) -> Setpoint:
        """Return planned setpoints, at rest where they lead nearer to what there is no room to.

        An agent that brakes and flies away does not land meanwhile.
        """
        rows, away = self._near
        self._stopped = np.zeros(len(self._stage), np.bool_)
        if not len(rows):
            return setpoint
        velocity = setpoint.velocity[:, :2]
        self._stopped[rows[np.vecdot(velocity[rows], away) < 0.0]] = True
        leaves = (self._stage == Stage.BRAKES) & ~self._stopped
        leaves &= np.hypot(velocity[:, 0], velocity[:, 1]) > PARTING_SPEED
        self._until[leaves] = self._time + WAITING_TIME
        still = np.where(self._stopped[:, None], 0.0, setpoint.velocity)
        return replace(setpoint, velocity=still)

    def _constraints(
        self, walls: WallRoom | None, pairs: PairRoom | None, steered: Mask, landing: Mask
    ) -> tuple[Rows, Array]:
        """Return the rows of agents without room, and the directions away from what is near."""
        rows, away = [NOTHING_NEAR[0]], [NOTHING_NEAR[1]]
        if walls is not None:
            rows.append(np.flatnonzero((self._stage == Stage.BRAKES) & (walls.use > RELEASE_USE)))
            away.append(walls.away[rows[-1]])
        if pairs is not None:
            short = (pairs.use > 1.0) | landing[pairs.first] | landing[pairs.second]
            for row, outwards in ((pairs.first, pairs.away), (pairs.second, -pairs.away)):
                waits = steered[row] & (short | (self._stage[row] == Stage.BRAKES))
                rows.append(row[waits])
                away.append(outwards[waits])
        return np.concatenate(rows), np.concatenate(away)

    def _yielding(self, pairs: PairRoom, steered: Mask, landing: Mask) -> Mask:
        """Return which agents make way, so that one of every pair without room does: (N,).

        Those that brake or return already do, and those that land need not.
        """
        yields = landing | (steered & (self._stage > Stage.FLIES))
        short = pairs.use > 1.0
        first, second = pairs.first[short], pairs.second[short]
        while True:
            rest = ~(yields[first] | yields[second]) & (steered[first] | steered[second])
            if not rest.any():
                return yields & steered
            rows = np.concatenate([first[rest], second[rest]])
            count = np.where(steered, np.bincount(rows, minlength=len(yields)), 0)
            yields[np.flatnonzero(count == count.max())[-1]] = True

    def _greatest(self, use: Array, pairs: PairRoom, yields: Mask) -> tuple[Array, Rows]:
        """Return the greatest use of room by agents that make way, (N,), and its pair or -1."""
        use, worst = use.copy(), np.full(len(use), -1)
        for rows in (pairs.first, pairs.second):
            for k in np.flatnonzero(yields[rows]).tolist():
                if pairs.use[k] > use[rows[k]]:
                    use[rows[k]], worst[rows[k]] = pairs.use[k], k
        return use, worst

    def _to_agent(self, row: int, pairs: PairRoom, pair: int) -> str:
        first, second = int(pairs.first[pair]), int(pairs.second[pair])
        other = self._scene.agents[second if row == first else first].name
        return f" and {pairs.distance[pair]:.2f} m from {other}"

    def _to_wall(self, row: int, walls: WallRoom) -> str:
        if (obstacle := int(walls.obstacle[row])) < 0:
            return f" and {max(0.0, walls.distance[row]):.2f} m from the fence"
        distance = max(0.0, walls.distance[row] + CONTACT_RADIUS)
        return f" and {distance:.2f} m from obstacle {self._scene.world.obstacles[obstacle].name!r}"

    def _advance(
        self, row: int, estimate: Estimate, use: float, reason: str, *, waits: bool
    ) -> str | None:
        """Change what an agent does; return why it must land, if so.

        Args:
            row: Of the agent.
            estimate: Of the positions.
            use: Room that it needs over the room that it has.
            reason: Why it needs more than it has.
            waits: Whether it waits for a correction at first.
        """
        name, time = self._scene.agents[row].name, estimate.time
        if self._stage[row] == Stage.FLIES:
            if not waits:
                self._short_time[row] += self._scene.period
                return reason if self._short_time[row] > PARTING_TIME else None
            self._stage[row], self._until[row] = Stage.BRAKES, time + WAITING_TIME
            self._report(f"{name} is {reason}: it brakes", name)
            return None
        if self._stage[row] == Stage.BRAKES:
            if use <= RELEASE_USE:
                self._stage[row] = Stage.FLIES
            elif time >= self._until[row]:
                if self._returns[row] >= MAX_RETURNS or np.isnan(self._corrected_at[row]).any():
                    self._stage[row] = Stage.FLIES
                    return reason
                self._begin_return(row, estimate)
                self._report(f"{name} is {reason}: it returns to where it was located last", name)
            return None
        if self._std[row] <= self._return_limit[row]:
            self._stage[row] = Stage.FLIES
            self._report(f"{name} is located again, to {self._std[row]:.2f} m: it flies on", name)
        elif time >= self._until[row]:
            self._stage[row] = Stage.FLIES
            return f"{reason}, and not located again"
        return None

    def _report(self, text: str, agent: str) -> None:
        self.reports.append(Report("safety", text, agent))

    def _begin_return(self, row: int, estimate: Estimate) -> None:
        self._stage[row] = Stage.RETURNS
        self._returns[row] += 1
        self._return_limit[row] = LOCATED_RATIO * self._std[row]
        self._return_goal[row] = *self._corrected_at[row], estimate.position[row, 2]
        way = math.dist(self._corrected_at[row], estimate.position[row, :2])
        duration = 2 * max(0.0, way - ARRIVAL_DISTANCE) / self._scene.limits.speed + WAITING_TIME
        self._until[row] = estimate.time + duration

    def _redirected(self, goals: Goals) -> Goals:
        """Return goals with those of the agents that return."""
        returns = self._stage == Stage.RETURNS
        if not some(returns):
            return goals
        return replace(
            goals,
            position=np.where(returns[:, None], self._return_goal, goals.position),
            velocity=np.where(returns[:, None], 0.0, goals.velocity),
            speed=np.where(returns, self._scene.limits.speed, goals.speed),
            active=goals.active | returns,
        )
