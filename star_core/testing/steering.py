"""Checks of localizers, planners and avoiders: one call with each of a number of inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from star_core.contracts import Avoider, Localizer, Planner
from star_core.messages.state import Estimate, Goals, Setpoint
from star_core.plugin_support.outputs import checked_location, checked_plan, checked_setpoint
from star_core.testing.calls import Case, Times, check_method, require_inactive
from star_core.testing.inputs import flight_telemetry, scene, situations
from star_core.world.scene import Scene


def check_avoider(make: Callable[[Scene], Avoider], scene: Callable[[int], Scene] = scene) -> Times:
    """Check that an avoider returns finite setpoints and keeps inactive rows inactive.

    Raises:
        ContractError: It does not.
    """

    def cases(room: Scene) -> Iterator[Case]:
        for label, now, active in situations(room):
            draw = np.random.default_rng(len(active)).uniform(-0.4, 0.4, (len(active), 3))
            yield label, (now, Setpoint(draw, np.nan_to_num(now.yaw), active))

    def check(answer: Any, _now: Estimate, planned: Setpoint) -> None:
        safe = checked_setpoint(answer, len(planned.yaw))
        require_inactive(safe.active, planned.active, "planned")

    return check_method(make, Avoider, "avoid", scene, cases, check)


def check_planner(make: Callable[[Scene], Planner], scene: Callable[[int], Scene] = scene) -> Times:
    """Check that a planner returns finite plans and keeps rows without goals inactive.

    Raises:
        ContractError: It does not.
    """

    def cases(room: Scene) -> Iterator[Case]:
        for label, now, active in situations(room):
            n, position = len(active), np.nan_to_num(now.position)
            for what, away in (("a goal near by", 0.5), ("a goal outside the fence", 1e3)):
                goals = position + np.array([away, 0.0, 0.0])
                rest = np.zeros((n, 3)), np.zeros(n), np.full(n, 0.5), active
                yield f"{label}, {what}", (now, Goals(goals, *rest))
            yield f"{label}, at the goal", (now, Goals(position, *rest))
            lost = f"{label}, goals for all agents, also for those that are not located"
            yield lost, (now, Goals(position, *rest[:3], np.ones(n, np.bool_)))

    def check(answer: Any, _now: Estimate, goals: Goals) -> None:
        plan = checked_plan(answer, len(goals.yaw))
        require_inactive(plan.setpoint.active, goals.active, "goals")

    return check_method(make, Planner, "plan", scene, cases, check)


def check_localizer(
    make: Callable[[Scene], Localizer], scene: Callable[[int], Scene] = scene
) -> Times:
    """Check that a localizer returns estimates of the right time, finite where valid.

    Raises:
        ContractError: It does not.
    """

    def cases(room: Scene) -> Iterator[Case]:
        n = len(room.agents)
        last, every, none = np.arange(n) == n - 1, np.ones(n, np.bool_), np.zeros(n, np.bool_)
        situations = (
            ("before any agent was heard", every, every),
            ("at the first reports", none, none),
            ("in flight", none, none),
            ("an agent is not heard", last, none),
            ("an agent reports no position", none, last),
            ("no agent is heard any more", every, none),
            ("all agents are heard again", none, none),
        )
        for tick, (label, silent, unknown) in enumerate(situations):
            yield label, (flight_telemetry(room, tick * room.period, silent, unknown),)

    return check_method(make, Localizer, "locate", scene, cases, checked_location)
