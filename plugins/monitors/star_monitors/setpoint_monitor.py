"""Monitors the setpoints of planner and avoider: pressed against the fence, or stuck."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from star_core import Array, Estimate, Goals, Mask, Scene, Setpoint
from star_core.toolkit import (
    BRAKING_GAIN,
    LAG,
    MIN_CORRECTION,
    RETURN_SPEED,
    Stage,
    Strike,
    TickState,
    Use,
    compiled,
    frozen,
    some,
)

PRESSED_TIME: Final = 0.5
"""Time after which an agent that the fence holds back is drawn in, s."""

SIGMAS: Final = 3.0
"""Standard deviations of its position by which an agent is drawn in."""

MAX_DRAW_IN: Final = 0.5
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
beyond a wall is more. So far others must have pushed it aside that passes at a greater one."""

CHECKS: Final = (
    ("avoider", REPEATED_TIME, "repeats its setpoints, whatever the planner's are"),
    ("planner", REPEATED_TIME, "repeats a setpoint that leads {} past the goal"),
    ("avoider", OUTWARD_TIME, "repeats a setpoint that leads {} out of the fence"),
    ("planner", OUTWARD_TIME, "repeats a setpoint that leads {} out of the fence"),
)
"""Kind of plugin, time after which it is reported in s, and what is reported of which agents."""

REPEATED_CHECKS: Final = 2  # of these, the first ones, after `REPEATED_TIME`
MAX_FLOAT: Final = float(np.finfo(np.float64).max)


class SetpointMonitor:
    """Leads agents away from the fence, and finds planners and avoiders that are stuck.

    A kernel, `nothing_wrong`, follows both in one pass; `FencePress` and `RepeatedSetpoints` run
    only in a tick in which there is something to do or to report.

    Args:
        scene: Agents, fence and tick.
    """

    after = Stage.AVOIDED

    def __init__(self, scene: Scene) -> None:
        self._fence = np.array([scene.world.fence.low, scene.world.fence.high])
        self._period = scene.period
        self.press = FencePress(scene)
        self.repeated = RepeatedSetpoints(scene)
        none = frozen(np.zeros((len(scene.agents), 3)))  # of the types that it has in flight
        at_rest = Setpoint.none(len(none))
        self._quiet(none, none, Goals.none(len(none)), at_rest, at_rest)  # before the flight
        self.press, self.repeated = FencePress(scene), RepeatedSetpoints(scene)

    def check(self, state: TickState) -> Iterator[Use | Strike]:
        """Yield the avoider's setpoint, drawn in from the fence, and what is wrong, by plugin."""
        estimate, goals, avoided, planned = (
            state.estimate,
            state.goals,
            state.setpoint,
            state.planned,
        )
        if some(state.redirected):  # the core stops them on their way to their goals
            goals = replace(goals, active=goals.active & ~state.redirected)
        if self._quiet(estimate.position, estimate.velocity, goals, avoided, planned):
            return
        drawn_in, outward = self.press.draw_in(estimate, avoided, planned)
        if drawn_in is not avoided:
            yield Use("setpoint", drawn_in)
        for kind, reason in self.repeated.find(estimate, goals, avoided, planned, outward).items():
            yield Strike(kind, reason)

    def _quiet(
        self, position: Array, flown: Array, goals: Goals, avoided: Setpoint, planned: Setpoint
    ) -> bool:
        press, repeated = self.press, self.repeated
        return nothing_wrong(
            position,
            flown,
            goals.position,
            goals.velocity,
            goals.active,
            avoided.velocity,
            planned.velocity,
            planned.active,
            self._fence,
            self._period,
            press.pressed,
            repeated.lasted,
            repeated.before,
            repeated.begun,
            repeated.start,
            repeated.near,
        )


@compiled
def nothing_wrong(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917 -- one pass over all agents
    position: Array,
    flown: Array,
    goal: Array,
    goal_velocity: Array,
    has_goal: Mask,
    avoided: Array,
    planned: Array,
    steered: Mask,
    fence: Array,
    period: float,
    pressed: Array,
    lasted: Array,
    before: Array,
    begun: Array,
    start: Array,
    near: Mask,
) -> bool:
    """Follow the setpoints of a tick as `FencePress` and `RepeatedSetpoints` do.

    Args:
        position: (N, 3) m.
        flown: (N, 3) current velocities, m/s.
        goal: (N, 3) m.
        goal_velocity: (N, 3) m/s.
        has_goal: (N,) agents with a goal.
        avoided: (N, 3) the avoider's velocities, m/s.
        planned: (N, 3) the planner's, m/s.
        steered: (N,) agents that setpoints fly.
        fence: (2, 3) its lowest and its highest corner, m.
        period: Of the ticks, s.
        pressed: (N,) state of `FencePress`.
        lasted: (len(CHECKS), N) state of `RepeatedSetpoints`, as the next four.
        before: (4, N, 3).
        begun: (N, 3).
        start: (N, 3).
        near: (N,).

    Returns:
        Whether there is nothing to do or to report. If not, the state is as it was.
    """
    n = len(steered)
    press, last, close = np.empty(n), np.empty((4, n)), np.empty(n, np.bool_)
    frozen_avoided, frozen_planned = np.empty(n, np.bool_), np.empty(n, np.bool_)
    repeated = True  # the velocities of all agents that setpoints fly, by the avoider
    for row in range(n):
        if pressed[row] > PRESSED_TIME:
            return False
        frozen_avoided[row] = True
        for axis in range(3):
            if avoided[row, axis] != before[0, row, axis]:
                frozen_avoided[row] = False
        if steered[row] and not frozen_avoided[row]:
            repeated = False
    for row in range(n):
        same_planned, same_position, same_goal, rests, moves = True, True, True, True, False
        outward, avoided_out, planned_out = False, False, False
        ignored = away = towards = speed = along = moved = 0.0
        for axis in range(3):
            fast = flown[row, axis]
            if math.isnan(fast):
                fast = 0.0
            elif math.isinf(fast):
                fast = math.copysign(MAX_FLOAT, fast)
            ahead = position[row, axis] + LAG * fast
            most = BRAKING_GAIN * (fence[1, axis] - ahead)
            most = max(most, -RETURN_SPEED) + MIN_CORRECTION
            least = BRAKING_GAIN * (fence[0, axis] - ahead)
            least = min(least, RETURN_SPEED) - MIN_CORRECTION
            by_avoider, by_planner = avoided[row, axis], planned[row, axis]
            outward = outward or by_avoider > most or by_avoider < least
            outward = outward or by_planner > most or by_planner < least
            most = max(most, MIN_CORRECTION)
            least = min(least, -MIN_CORRECTION)
            avoided_out = avoided_out or by_avoider > most or by_avoider < least
            planned_out = planned_out or by_planner > most or by_planner < least
            same_planned = same_planned and by_planner == before[1, row, axis]
            same_position = same_position and position[row, axis] == before[2, row, axis]
            same_goal = same_goal and goal[row, axis] == before[3, row, axis]
            rests = rests and goal_velocity[row, axis] == 0.0
            moves = moves or by_avoider != 0.0
            change = by_planner - (begun[row, axis] if frozen_avoided[row] else by_planner)
            ignored += change * change
            way = goal[row, axis] - position[row, axis]
            away += way * way
            towards += by_planner * way
            speed += by_planner * by_planner
            path = position[row, axis] - start[row, axis]
            along += by_planner * path
            moved += path * path
        frozen_planned[row] = same_planned
        distance = math.sqrt(away)
        beside = towards < 0.0 and moved * speed - along * along > ARRIVAL * ARRIVAL * speed
        close[row] = (
            same_planned and same_goal and has_goal[row] and rests
            and (near[row] or distance < ARRIVAL or beside)
        )  # fmt: skip
        repeats = (
            math.sqrt(ignored) > MIN_CHANGE and moves and repeated,
            close[row] and distance > ARRIVAL,
            frozen_avoided[row] and not same_planned and avoided_out and not same_position,
            same_planned and planned_out and not same_position,
        )
        press[row] = pressed[row] + period if outward and steered[row] else 0.0
        for check in range(4):
            last[check, row] = (
                lasted[check, row] + period if repeats[check] and steered[row] else 0.0
            )
            if last[check, row] > (REPEATED_TIME if check < REPEATED_CHECKS else OUTWARD_TIME):
                return False
    for row in range(n):
        pressed[row], near[row] = press[row], close[row]
        for check in range(4):
            lasted[check, row] = last[check, row]
        for axis in range(3):
            if not frozen_avoided[row]:
                begun[row, axis] = planned[row, axis]
            if not frozen_planned[row]:
                start[row, axis] = position[row, axis]
            before[0, row, axis], before[1, row, axis] = avoided[row, axis], planned[row, axis]
            before[2, row, axis], before[3, row, axis] = position[row, axis], goal[row, axis]
    return True


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
        self.pressed = np.zeros(n)  # s

    def draw_in(
        self, estimate: Estimate, avoided: Setpoint, planned: Setpoint
    ) -> tuple[Setpoint, Mask]:
        """Return the setpoint, with agents that press against the fence led away from it.

        Args:
            estimate: Of the agents' positions.
            avoided: The avoider's setpoint.
            planned: The planner's.

        Returns:
            The setpoint, and whether the velocities of avoider and planner lead out of the fence:
            (2, N).
        """
        drawn = self.pressed > PRESSED_TIME
        low, high = self._fence
        ahead = estimate.position + LAG * np.nan_to_num(estimate.velocity)
        if some(drawn):
            std = np.sqrt(np.nan_to_num(np.diagonal(estimate.covariance, axis1=1, axis2=2)))
            margin = np.minimum(SIGMAS * std, np.minimum(MAX_DRAW_IN, (high - low) / 4))
            margin *= drawn[:, None]
            low, high = low + margin, high - margin
        up = np.maximum(BRAKING_GAIN * (high - ahead), -RETURN_SPEED)
        down = np.minimum(BRAKING_GAIN * (low - ahead), RETURN_SPEED)
        most, least = up + MIN_CORRECTION, down - MIN_CORRECTION
        velocity = np.array([avoided.velocity, planned.velocity])
        outward = (velocity > most) | (velocity < least)
        beyond = np.maximum(most, MIN_CORRECTION), np.minimum(least, -MIN_CORRECTION)
        leads_out: Mask = ((velocity > beyond[0]) | (velocity < beyond[1])).any(axis=2)
        presses = outward.any(axis=(0, 2)) & planned.active
        self.pressed = np.where(presses, self.pressed + self._period, 0.0)
        drawn &= presses
        if not some(drawn):
            return avoided, leads_out
        kept = np.clip(avoided.velocity, down, up)
        velocity = np.where(drawn[:, None], kept, avoided.velocity)
        return replace(avoided, velocity=frozen(velocity)), leads_out


class RepeatedSetpoints:
    """Finds planners and avoiders that are stuck: their velocities stay the same to the last bit.

    That alone is right in many flights. It is reported of

    - an avoider that repeats the velocities of all agents though the planner's, of an agent that
      does not stand still, is `MIN_CHANGE` from what it was when the repetition began;
    - a planner that repeats the velocity of an agent which has been within `ARRIVAL` of its goal,
      and no longer is, or which the avoider has pushed so far aside that it passes the goal at a
      greater distance; the goal stays where it is;
    - either, if what it repeats leads out of the fence while the estimated position changes, for
      the avoider the planner's velocity too.

    Args:
        scene: Agents and tick.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, n = scene, len(scene.agents)
        self.lasted = np.zeros((len(CHECKS), n))  # s
        self._limit = np.array([[limit] for _, limit, _ in CHECKS])
        # velocities of avoider and planner, position and goal, in the tick before
        self.before = np.full((4, n, 3), np.nan)
        self.begun = np.zeros((n, 3))  # the planner's velocities when the avoider's were new
        self.start = np.full((n, 3), np.nan)  # the positions when the planner's were
        self.near = np.zeros(n, np.bool_)  # since the planner's were

    def find(
        self, estimate: Estimate, goals: Goals, avoided: Setpoint, planned: Setpoint, outward: Mask
    ) -> dict[str, str]:
        """Return what is wrong with avoider or planner, by its kind.

        Args:
            estimate: Of the agents' positions.
            goals: The tasks'.
            avoided: The avoider's setpoint.
            planned: The planner's.
            outward: (2, N) whether the velocities of avoider and planner lead out of the fence.
        """
        now = np.array([avoided.velocity, planned.velocity, estimate.position, goals.position])
        same_avoided, same_planned, same_position, same_goal = (now == self.before).all(axis=2)
        self.before = now
        self.begun = np.where(same_avoided[:, None], self.begun, planned.velocity)
        ignored = _length(planned.velocity - self.begun) > MIN_CHANGE
        way = goals.position - estimate.position
        distance = _length(way)
        at_rest = same_goal & goals.active & ~goals.velocity.any(axis=1)
        self.start = np.where(same_planned[:, None], self.start, estimate.position)
        path, velocity = estimate.position - self.start, planned.velocity
        speed = np.vecdot(velocity, velocity)  # squared, as the distance from the first line
        aside = np.vecdot(path, path) * speed - np.vecdot(velocity, path) ** 2
        beside = (np.vecdot(velocity, way) < 0) & (aside > ARRIVAL**2 * speed)
        self.near = same_planned & at_rest & (self.near | (distance < ARRIVAL) | beside)
        repeats: Mask = np.array(
            [
                ignored & now[0].any(axis=1) & bool(same_avoided[planned.active].all()),
                self.near & (distance > ARRIVAL),
                same_avoided & ~same_planned & outward[0] & ~same_position,
                same_planned & outward[1] & ~same_position,
            ]
        )
        self.lasted = np.where(repeats & planned.active, self.lasted + self._scene.period, 0.0)
        return {
            kind: text.format(self._scene.named(np.flatnonzero(late)))
            for (kind, _, text), late in zip(CHECKS, self.lasted > self._limit, strict=True)
            if late.any()
        }


def _length(vectors: Array) -> Array:
    length: Array = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return length
