"""The planner `visibility`: who flies straight, who on a path, and whose turn it is."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from star_core import Array, Estimate, Goals, Homing, Mask, Plan, Rows, Scene, Setpoint
from star_visibility.carrot import steer
from star_visibility.network import Work
from star_visibility.routes import Routes
from star_visibility.sight import all_see
from star_visibility.trips import Trips

TURNING = 0.5  # of the greatest acceleration, for turns and braking: the rest is as for `Homing`

WORK = 80_000  # in one tick, in the measure of `Work`
SHARE = 4  # of agents between which it is shared at least; if more ask, they take turns


class Job(NamedTuple):
    """A path that is being planned.

    Attributes:
        here: (3,) from where, m.
        goal: (3,) where to, m.
        work: What may be done for it now.
        search: Yields when that is done.
    """

    here: Array
    goal: Array
    work: Work
    search: Generator[None, None, Array | str]


class Visibility:
    """Flies each agent the shortest way to its goal that keeps clear of obstacles.

    An agent that sees its goal flies to it as with the planner `straight`. Any other flies a path
    from the visibility graph, which was built when the planner was made. No more than so many
    paths, and no more than `WORK`, are planned in one tick: agents take turns, and the search for a
    path goes on in the ticks to come. It is counted what is looked at, not how long it takes: so
    flights in lock-step are the same on every machine. Until its path is there an agent keeps the
    one that it is on if its goal moved a little only and the path is in sight; else it holds.

    A goal that cannot be reached is not flown to: the agent holds, and its row of
    `Plan.unreachable` is True. So it is with one outside the heights to fly at.

    Args:
        scene: The mission's scene.
        clearance: Distance to keep beside obstacles, m.
        vertical_clearance: Distance to keep above and below obstacles, m.
        margin: What paths keep beyond the clearances, m.
        look_ahead: How far ahead on its path an agent steers to, m.
        replan_distance: A path is planned anew when its goal has moved so far, m.
        hold_distance: An agent whose goal has moved farther holds until its path is planned, m.
        queries_per_tick: Paths planned in one tick at most.
        gain: Speed towards the goal per metre of distance, 1/s.
        yaw_rate_deg: Greatest yaw rate, degrees/s.
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
        self._homing = Homing(scene, gain=gain, yaw_rate_deg=yaw_rate_deg)
        self._routes = Routes(
            scene, clearance=clearance, vertical_clearance=vertical_clearance, margin=margin
        )
        turning = TURNING * scene.limits.acceleration
        self._trips = Trips(n, look_ahead=look_ahead, acceleration=turning)
        self._look_ahead = float(look_ahead)
        self._replan_distance = replan_distance
        self._hold_distance = hold_distance
        self._most = queries_per_tick
        self._next = 0  # row whose turn it is
        self._jobs: dict[int, Job] = {}
        self._direct = np.zeros(n, np.bool_)
        nowhere, nobody = np.zeros((n, 3)), np.zeros(n, np.bool_)
        self._sees_goal(nowhere, nowhere, nobody)  # compiled, as all else, before anybody flies
        self._steer(nowhere, nobody)

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        active = goals.active & estimate.valid
        here = np.where(active[:, None], estimate.position, 0.0)
        aim = np.where(active[:, None], goals.position, 0.0)
        off = active & self._routes.too_high_or_low(here, aim)
        aim[:, 2] = np.where(off, aim[:, 2], np.clip(aim[:, 2], *self._height))
        direct = self._direct = self._sees_goal(here, aim, active & ~off)
        trips, on = self._trips, active & ~direct
        trips.forget(~on)
        known = on & (trips.count > 0)
        moved = _far(aim, trips.goal)
        trips.aim(known & (moved <= self._replan_distance), aim)
        target, lost = self._steer(here, known)
        fresh = (moved <= self._replan_distance) & np.where(
            known, ~lost, _far(here, trips.start) <= self._replan_distance
        )
        asked = self._ask(here, aim, on & ~fresh)
        again, still_lost = self._steer(here, asked & (trips.count > 0))
        target[asked], lost[asked] = again[asked], still_lost[asked]
        moved = _far(aim, trips.goal)
        on &= (trips.count > 0) & ~lost & (moved <= self._hold_distance)
        stuck = np.zeros(len(active), np.bool_)
        stuck[list(trips.fault)] = True
        return Plan(
            self._setpoint(estimate, goals, direct, on, target),
            trips.paths(here, direct, aim, on),
            unreachable=stuck & (moved <= self._replan_distance),
            reasons=dict(trips.fault),
        )

    def _sees_goal(self, here: Array, aim: Array, active: Mask) -> Mask:
        """Whether nothing stands between agent and goal: (N,).

        Paths are planned with the margin; one that flies straight already may use it up.
        """
        sees = all_see(self._routes.planned, here, aim, np.flatnonzero(active))
        rest = np.flatnonzero(active & ~sees & self._direct)
        answer: Mask = sees | all_see(self._routes.kept, here, aim, rest)
        return answer

    def _steer(self, here: Array, rows: Mask) -> tuple[Array, Mask]:
        trips = self._trips
        return steer(
            self._routes.planned,
            self._routes.kept,
            self._routes.shunned,
            here,
            np.flatnonzero(rows),
            trips.start,
            trips.path,
            trips.count,
            trips.leg,
            self._look_ahead,
        )

    def _ask(self, here: Array, aim: Array, wanting: Mask) -> Mask:
        """Plan the paths of those whose turn it is, and return whose are done: (N,)."""
        self._jobs = {row: job for row, job in self._jobs.items() if wanting[row]}
        rows: Rows = np.flatnonzero(wanting)
        rows = np.roll(rows, -int(np.searchsorted(rows, self._next)))[: self._most]
        done, left = np.zeros(len(wanting), np.bool_), WORK
        for k, row in enumerate(rows.tolist()):
            if left <= 0:
                break
            job = self._jobs.get(row) or self._job(here[row].copy(), aim[row].copy())
            job.work.left = share = max(left // (len(rows) - k), min(left, WORK // SHARE))
            try:
                next(job.search)
                self._jobs[row] = job
            except StopIteration as end:
                self._jobs.pop(row, None)
                self._trips.put(row, job.here, job.goal, end.value)
                done[row] = True
            left -= share - job.work.left
            self._next = (row + 1) % len(wanting)
        return done

    def _job(self, here: Array, goal: Array) -> Job:
        work = Work(0)
        return Job(here, goal, work, self._routes.search(here, goal, work))

    def _setpoint(
        self, estimate: Estimate, goals: Goals, direct: Mask, on: Mask, target: Array
    ) -> Setpoint:
        left, pace = self._trips.left(estimate.position)
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
        return Setpoint(
            velocity=np.where(active[:, None], velocity, 0.0),
            yaw=self._homing.heading(estimate, goals, active),
            active=active,
        )


def _far(one: Array, other: Array) -> Array:
    """(N,) distances, m; infinite from what is not known."""
    distance = np.sqrt(((one - other) ** 2).sum(axis=1))
    return np.where(np.isnan(distance), np.inf, distance)
