"""Monitors the setpoints of planner and avoider: pressed against the fence, or stuck."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np

from star_core import Array, Estimate, Goals, Mask, Scene, Setpoint, Transform
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
    records,
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

STATE: Final = np.dtype(
    [
        ("pressed", "f8"),  # s
        ("lasted", "f8", len(CHECKS)),  # s
        # Velocities of avoider and planner, position and goal, in the tick before.
        ("before", "f8", (4, 3)),
        ("begun", "f8", 3),  # the planner's velocity when the avoider's was new
        ("start", "f8", 3),  # the position when the planner's was
        ("near", "?"),  # since the planner's was
    ],
    align=True,
)


class SetpointMonitor:
    """Leads agents away from the fence, and finds planners and avoiders that are stuck.

    The fence of the safety filter is that of the estimated positions, so that goals near it can be
    reached. An agent that is held there for long is carried out by the drift of its estimate: as
    when a planner or an avoider repeats its last output. A setpoint presses if it leads nearer to
    the fence than an agent can brake before it, in the filter's terms; after `PRESSED_TIME` the
    fence is moved in for the agent, by `SIGMAS` standard deviations of its position, until no
    setpoint presses.

    Velocities that stay the same to the last bit are right in many flights. They are reported of

    - an avoider that repeats the velocities of all agents though the planner's, of an agent that
      does not stand still, is `MIN_CHANGE` from what it was when the repetition began;
    - a planner that repeats the velocity of an agent which has been within `ARRIVAL` of its goal,
      and no longer is, or which the avoider has pushed so far aside that it passes the goal at a
      greater distance; the goal stays where it is;
    - either, if what it repeats leads out of the fence while the estimated position changes, for
      the avoider the planner's velocity too.
    """

    after = Stage.AVOIDED

    def __init__(self, scene: Scene) -> None:
        self._scene, n = scene, len(scene.agents)
        self._fence = np.array([scene.world.fence.low, scene.world.fence.high])
        self._state = records(n, STATE)
        self._state["before"] = self._state["start"] = np.nan
        none, nothing, no_agent = np.zeros(0), np.zeros((0, 3)), np.zeros(0, np.bool_)
        now = Estimate(0, nothing, nothing, none, np.zeros((0, 3, 3)), no_agent, Transform.none())
        self._follow(now, Goals.none(), Setpoint.none(), Setpoint.none())  # compiled before flight

    def check(self, state: TickState) -> Iterator[Use | Strike]:
        """Yield the avoider's setpoint, drawn in from the fence, and what is wrong, by plugin."""
        now, goals, avoided = state.estimate, state.goals, state.setpoint
        if some(state.redirected):  # the core stops them on their way to their goals
            goals = replace(goals, active=goals.active & ~state.redirected)
        velocity, draws, finds = self._follow(now, goals, avoided, state.planned)
        if draws:
            yield Use("setpoint", replace(avoided, velocity=frozen(velocity)))
        if not finds:
            return
        reasons = {
            kind: text.format(self._scene.named(np.flatnonzero(lasted > limit)))
            for (kind, limit, text), lasted in zip(CHECKS, self._state["lasted"].T, strict=True)
            if (lasted > limit).any()
        }
        for kind, reason in reasons.items():
            yield Strike(kind, reason)

    def _follow(
        self, now: Estimate, goals: Goals, avoided: Setpoint, planned: Setpoint
    ) -> tuple[Array, bool, bool]:
        velocity = np.empty(now.position.shape)
        draws, finds = follow(
            velocity,
            now.position,
            now.velocity,
            now.covariance,
            goals.position,
            goals.velocity,
            goals.active,
            avoided.velocity,
            planned.velocity,
            planned.active,
            self._fence,
            self._scene.period,
            self._state,
        )
        return velocity, draws, finds


@compiled
def follow(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917 -- one pass over all agents
    velocity: Array,
    position: Array,
    flown: Array,
    covariance: Array,
    goal: Array,
    goal_velocity: Array,
    has_goal: Mask,
    avoided: Array,
    planned: Array,
    steered: Mask,
    fence: Array,
    period: float,
    state: Any,
) -> tuple[bool, bool]:
    """Follow the setpoints of a tick as `SetpointMonitor` describes it.

    Args:
        velocity: (N, 3) output: the avoider's velocities, drawn in from the fence, m/s.
        position: (N, 3) m.
        flown: (N, 3) current velocities, m/s.
        covariance: (N, 3, 3) of the positions, m².
        goal: (N, 3) m.
        goal_velocity: (N, 3) m/s.
        has_goal: (N,) agents with a goal.
        avoided: (N, 3) the avoider's velocities, m/s.
        planned: (N, 3) the planner's, m/s.
        steered: (N,) agents that setpoints fly.
        fence: (2, 3) its lowest and its highest corner, m.
        period: Of the ticks, s.
        state: (N,) records of `STATE`, changed in place.

    Returns:
        Whether an agent is drawn in, and whether there is something to report.
    """
    n, draws, finds = len(steered), False, False
    same_avoided = np.empty(n, np.bool_)
    repeated = True  # the velocities of all agents that setpoints fly, by the avoider
    for row in range(n):
        same_avoided[row] = True
        for axis in range(3):
            if avoided[row, axis] != state[row].before[0, axis]:
                same_avoided[row] = False
        if steered[row] and not same_avoided[row]:
            repeated = False
    for row in range(n):
        agent = state[row]
        drawn = agent.pressed > PRESSED_TIME
        same_planned, same_position, same_goal, rests, moves = True, True, True, True, False
        presses, avoided_out, planned_out = False, False, False
        ignored = away = towards = speed = along = moved = 0.0
        for axis in range(3):
            if not same_avoided[row]:
                agent.begun[axis] = planned[row, axis]
            if planned[row, axis] != agent.before[1, axis]:
                same_planned = False
            fast = flown[row, axis]
            if math.isnan(fast):
                fast = 0.0
            elif math.isinf(fast):
                fast = math.copysign(MAX_FLOAT, fast)
            low, high, margin = fence[0, axis], fence[1, axis], 0.0
            if drawn:
                variance = covariance[row, axis, axis]
                std = math.sqrt(variance) if variance > 0.0 else 0.0
                margin = min(SIGMAS * std, MAX_DRAW_IN, (high - low) / 4)
            ahead = position[row, axis] + LAG * fast
            up = max(BRAKING_GAIN * (high - margin - ahead), -RETURN_SPEED)
            down = min(BRAKING_GAIN * (low + margin - ahead), RETURN_SPEED)
            most, least = up + MIN_CORRECTION, down - MIN_CORRECTION
            by_avoider, by_planner = avoided[row, axis], planned[row, axis]
            velocity[row, axis] = min(max(by_avoider, down), up) if drawn else by_avoider
            presses = presses or by_avoider > most or by_avoider < least
            presses = presses or by_planner > most or by_planner < least
            most, least = max(most, MIN_CORRECTION), min(least, -MIN_CORRECTION)
            avoided_out = avoided_out or by_avoider > most or by_avoider < least
            planned_out = planned_out or by_planner > most or by_planner < least
            same_position = same_position and position[row, axis] == agent.before[2, axis]
            same_goal = same_goal and goal[row, axis] == agent.before[3, axis]
            rests = rests and goal_velocity[row, axis] == 0.0
            moves = moves or by_avoider != 0.0
            change = by_planner - agent.begun[axis]
            ignored += change * change
            way = goal[row, axis] - position[row, axis]
            away += way * way
            towards += by_planner * way
            speed += by_planner * by_planner
        for axis in range(3):
            if not same_planned:
                agent.start[axis] = position[row, axis]
            path = position[row, axis] - agent.start[axis]
            along += planned[row, axis] * path
            moved += path * path
        distance = math.sqrt(away)
        # of the first line towards the goal, squared distances times the squared speed
        beside = towards < 0.0 and moved * speed - along * along > ARRIVAL * ARRIVAL * speed
        agent.near = (
            same_planned and same_goal and has_goal[row] and rests
            and (agent.near or distance < ARRIVAL or beside)
        )  # fmt: skip
        repeats = (
            math.sqrt(ignored) > MIN_CHANGE and moves and repeated,
            agent.near and distance > ARRIVAL,
            same_avoided[row] and not same_planned and avoided_out and not same_position,
            same_planned and planned_out and not same_position,
        )
        for check in range(4):
            lasts = repeats[check] and steered[row]
            agent.lasted[check] = agent.lasted[check] + period if lasts else 0.0
            limit = REPEATED_TIME if check < REPEATED_CHECKS else OUTWARD_TIME
            finds = finds or agent.lasted[check] > limit
        presses = presses and steered[row]
        agent.pressed = agent.pressed + period if presses else 0.0
        draws = draws or (drawn and presses)
        for axis in range(3):
            if not presses:
                velocity[row, axis] = avoided[row, axis]
            agent.before[0, axis], agent.before[1, axis] = avoided[row, axis], planned[row, axis]
            agent.before[2, axis], agent.before[3, axis] = position[row, axis], goal[row, axis]
    return draws, finds
