"""Rows of setpoints that follow a trajectory: kept when nothing changes them, else velocities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import Estimate, Plan, Setpoint
from tests.core.conftest import Lab

PLACES = """
  - climb: {}
  - visit: {agents: cf1, to: [1, 0, 1]}
  - descend: {}
"""


def along(right: Callable[..., Plan], now: Estimate, *args: Any) -> Plan:
    """Let agents that fly follow a trajectory 3 cm in front of them at 0.3 m/s."""
    plan = right(now, *args)
    moves = np.tile([0.3, 0.0, 0.0], (len(now.yaw), 1))
    setpoint = Setpoint(
        moves, plan.setpoint.yaw, plan.setpoint.active, now.position + 0.1 * moves, 0 * moves
    )
    return replace(plan, setpoint=setpoint)


def followed(lab: Lab) -> list[bool]:
    """Whether any agent followed a trajectory, by the setpoints that were sent."""
    return [bool(tick.sent.followed().any()) for tick in lab.ticks if tick.sent.active.any()]


def test_setpoints_on_trajectories_reach_the_transport(lab: Lab) -> None:
    lab.spoil("planner", "plan", along)
    lab.fly(PLACES, more="limits: {speed: 0.6}\n")
    assert any(followed(lab))
    sent = [setpoint for _, setpoint in lab.robots.sent if setpoint.followed().any()]
    assert len(sent) == sum(followed(lab))


@pytest.mark.parametrize("factor", [0.5, 0.0])
def test_an_avoided_row_falls_back_to_its_velocity(lab: Lab, factor: float) -> None:
    def slower(_right: Callable[..., Setpoint], _now: Estimate, planned: Setpoint) -> Setpoint:
        return replace(planned, velocity=factor * planned.velocity)  # with its position

    lab.spoil("planner", "plan", along)
    lab.spoil("avoider", "avoid", slower)
    lab.fly(PLACES, more="limits: {speed: 0.6}\n")
    assert not any(followed(lab))


def test_avoiders_that_know_velocities_only_keep_trajectories(lab: Lab) -> None:
    def bare(_right: Callable[..., Setpoint], _now: Estimate, planned: Setpoint) -> Setpoint:
        return Setpoint(planned.velocity, planned.yaw, planned.active)

    lab.spoil("planner", "plan", along)
    lab.spoil("avoider", "avoid", bare)
    lab.fly(PLACES, more="limits: {speed: 0.6}\n")
    assert any(followed(lab))
