"""The planner `visibility`: direct flights, flights along paths, and the scheduling of searches."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from star_core import Array, Estimate, Goals, Mask, Plan, Rows, Scene, Setpoint
from star_core.toolkit import PositionController
from star_visibility.clearances import Clearances, WidePath
from star_visibility.line_of_sight import all_see
from star_visibility.network import Work
from star_visibility.routes import ARRIVAL_DISTANCE
from star_visibility.tracked_paths import TrackedPaths, steer

TURNING = 0.5  # share of the acceleration limit for turns and braking, as `PositionController`

WORK = 80_000  # budget of one tick, in the unit of `Work`
SHARE = 4  # least number of agents that share it; if more need paths, they take turns


class Job(NamedTuple):
    """A path that is being planned.

    Attributes:
        start: (3,) start position, m.
        goal: (3,) goal position, m.
        work: Budget available to it now.
        search: Yields when that is used up.
    """

    start: Array
    goal: Array
    work: Work
    search: Generator[None, None, WidePath]


class Visibility:
    """Flies each agent along the shortest path to its goal that keeps clear of obstacles.

    An agent with a line of sight to its goal flies to it as with the planner `straight`. Any other
    agent flies a path from the visibility graph, which is built when the planner is created. The
    number of paths and the work (`WORK`) per tick are limited: agents take turns, and the search
    for a path continues in the next ticks. Work is counted in points examined, not in time, so that
    simulated flights are the same on every machine. Until its path is found, an agent follows its
    previous path if its goal moved only a little and the path is in sight; otherwise it hovers.

    The clearance to obstacles grows by the margin for an agent's uncertain position, where there is
    room for that: see `star_visibility.clearances`.

    A goal that cannot be reached, is nearer to an obstacle than the clearances, or is outside the
    flight heights is refused: the agent hovers, and its row of `Plan.unreachable` is True. An agent
    sent to its current position may stay there, however near it is to an obstacle.

    The arguments beside the scene are the options of the schema.
    """

    def __init__(  # noqa: PLR0913 -- one for each option
        self,
        scene: Scene,
        *,
        clearance: float,
        vertical_clearance: float,
        margin: float,
        look_ahead: float,
        replan_distance: float,
        hold_distance: float,
        queries_per_tick: int,
        gain: float,
        yaw_rate_deg: float,
    ) -> None:
        n = len(scene.agents)
        self._height = scene.limits.height
        self._homing = PositionController(scene, gain=gain, yaw_rate_deg=yaw_rate_deg)
        self._clearances = Clearances(
            scene, clearance=clearance, vertical_clearance=vertical_clearance, margin=margin
        )
        self._routes = self._clearances.routes[0]
        turning = TURNING * scene.limits.acceleration
        self._tracked = TrackedPaths(n, look_ahead=look_ahead, acceleration=turning)
        self._look_ahead = float(look_ahead)
        self._replan_distance = replan_distance
        self._hold_distance = hold_distance
        self._most = queries_per_tick
        self._next = 0  # row whose path is planned next
        self._jobs: dict[int, Job] = {}
        self._direct = np.zeros(n, np.bool_)
        self._goal = np.full((n, 3), np.nan)  # m, of the last tick
        nowhere, no_row = np.zeros((n, 3)), np.zeros(n, np.bool_)
        self._sees_goal(nowhere, nowhere, no_row)  # compiles the rest before take-off
        self._steer(nowhere, no_row)

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        active = goals.active & estimate.valid
        position = np.where(active[:, None], estimate.position, 0.0)
        aim = np.where(active[:, None], goals.position, 0.0)
        self._clearances.choose(estimate)
        off = active & self._routes.too_high_or_low(position, aim)
        aim[:, 2] = np.where(off, aim[:, 2], np.clip(aim[:, 2], *self._height))
        changed = active & ~off & (goals.position != self._goal).any(axis=1)
        self._goal = np.where(goals.active[:, None], goals.position, np.nan)
        self._allow_staying(position, aim, changed & ~goals.velocity.any(axis=1))
        direct = self._direct = self._sees_goal(position, aim, active & ~off)
        tracked, on = self._tracked, active & ~direct
        tracked.forget(~on)
        has_path = on & (tracked.count > 0)
        moved = _far(aim, tracked.goal)
        tracked.aim(has_path & (moved <= self._replan_distance), aim)
        target, lost = self._steer(position, has_path)
        fresh = (moved <= self._replan_distance) & np.where(
            has_path, ~lost, _far(position, tracked.start) <= self._replan_distance
        )
        fresh &= ~self._doubtful(aim, on & changed) & ~self._clearances.outdated(estimate.time)
        asked = self._ask(position, aim, on & ~fresh, estimate.time)
        again, still_lost = self._steer(position, asked & (tracked.count > 0))
        target[asked], lost[asked] = again[asked], still_lost[asked]
        moved = _far(aim, tracked.goal)
        on &= (tracked.count > 0) & ~lost & (moved <= self._hold_distance)
        stuck = np.zeros(len(active), np.bool_)
        stuck[list(tracked.fault)] = True
        return Plan(
            self._setpoint(estimate, goals, direct, on, target),
            tracked.paths(position, direct, aim, on),
            unreachable=stuck & (moved <= self._replan_distance),
            reasons=dict(tracked.fault),
        )

    def _allow_staying(self, position: Array, aim: Array, rows: Mask) -> None:
        """Accept new goals of agents that are already there, within the clearances."""
        away = np.sqrt(((aim - position)[:, :2] ** 2).sum(axis=1))
        for row in np.flatnonzero(rows & (away <= ARRIVAL_DISTANCE)).tolist():
            self._routes.allow_staying(position[row], aim[row])

    def _doubtful(self, aim: Array, rows: Mask) -> Mask:
        """Whether goals that moved, however little, may now be refused, or accepted: (N,)."""
        doubtful = np.zeros(len(rows), np.bool_)
        for row in np.flatnonzero(rows).tolist():
            stuck = row in self._tracked.fault
            doubtful[row] = stuck or self._routes.refusal(aim[row]) is not None
        return doubtful

    def _sees_goal(self, position: Array, aim: Array, active: Mask) -> Mask:
        """Whether there is a line of sight between agent and goal: (N,).

        Paths are planned with the margin; an agent that already flies straight may use it up.
        """
        answer = np.zeros(len(active), np.bool_)
        for routes, rows in self._clearances.by_target_level(active):
            sees = all_see(routes.planned, position, aim, np.flatnonzero(rows))
            rest = np.flatnonzero(rows & ~sees & self._direct)
            answer |= sees | all_see(routes.kept, position, aim, rest)
        return answer

    def _steer(self, position: Array, rows: Mask) -> tuple[Array, Mask]:
        tracked = self._tracked
        target, lost = np.zeros(position.shape), np.zeros(len(position), np.bool_)
        for routes, some in self._clearances.by_flown_level(rows):
            points, hidden = steer(
                routes.planned,
                routes.kept,
                routes.shunned,
                routes.solid,
                position,
                np.flatnonzero(some),
                tracked.start,
                tracked.path,
                tracked.count,
                tracked.leg,
                self._look_ahead,
            )
            target[some], lost[some] = points[some], hidden[some]
        return target, lost

    def _ask(self, position: Array, aim: Array, wanting: Mask, time: float) -> Mask:
        """Plan paths of agents in turn, and return which are done: (N,)."""
        self._jobs = {row: job for row, job in self._jobs.items() if wanting[row]}
        rows: Rows = np.flatnonzero(wanting)
        rows = np.roll(rows, -int(np.searchsorted(rows, self._next)))[: self._most]
        done, left = np.zeros(len(wanting), np.bool_), WORK
        for k, row in enumerate(rows.tolist()):
            if left <= 0:
                break
            job = self._jobs.get(row) or self._job(row, position[row].copy(), aim[row].copy())
            job.work.left = share = max(left // (len(rows) - k), min(left, WORK // SHARE))
            try:
                next(job.search)
                self._jobs[row] = job
            except StopIteration as end:
                self._jobs.pop(row, None)
                way, level = end.value
                self._tracked.put(row, job.start, job.goal, way)
                self._clearances.fly(row, level, time)
                done[row] = True
            left -= share - job.work.left
            self._next = (row + 1) % len(wanting)
        return done

    def _job(self, row: int, start: Array, goal: Array) -> Job:
        work = Work(0)
        return Job(start, goal, work, self._clearances.search(row, start, goal, work))

    def _setpoint(
        self, estimate: Estimate, goals: Goals, direct: Mask, on: Mask, target: Array
    ) -> Setpoint:
        left, pace = self._tracked.left(estimate.position)
        point = np.where(on[:, None], target, estimate.position)
        beyond = left - np.sqrt(((point - estimate.position) ** 2).sum(axis=1))
        now = replace(
            goals,
            position=np.where(direct[:, None], goals.position, point),
            velocity=np.where(direct[:, None], goals.velocity, 0.0),
            speed=np.where(direct, goals.speed, np.where(on, np.minimum(goals.speed, pace), 0.0)),
        )
        velocity = self._homing.velocity(estimate, now, np.where(on, np.maximum(beyond, 0.0), 0.0))
        active = goals.active & estimate.valid
        velocity = np.where(active[:, None], velocity, 0.0)
        yaw = self._homing.heading(estimate, goals, active)
        straight = replace(goals, active=active & direct)
        return self._homing.setpoint(velocity, yaw, active, estimate, straight)


def _far(position: Array, other: Array) -> Array:
    """(N,) distances, m; infinite where a position is not known."""
    distance = np.sqrt(((position - other) ** 2).sum(axis=1))
    return np.where(np.isnan(distance), np.inf, distance)
