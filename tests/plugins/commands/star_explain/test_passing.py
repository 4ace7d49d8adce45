"""How agents pass each other in a rehearsal."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from star_core.toolkit import Rehearsal
from tests.plugins.commands.star_explain.conftest import Rehearse

MISSION = """\
star: 1
name: swap
world: hall.yaml
swarm: {a: {start: [-1.5, 0, 0]}, b: {start: [1.5, 0, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: {use: orca, radius: 0.3}
mission:
  - takeoff: {height: 0.8}
  - parallel:
      - goto: {agents: a, to: [1.5, 0, 0.8]}
      - goto: {agents: b, to: [-1.5, 0, 0.8]}
"""
DISTANCE = 0.6  # m: twice the radius


@pytest.fixture
def rehearsed(rehearse: Rehearse) -> Rehearse:
    return partial(rehearse, MISSION)


def least_distance(rehearsal: Rehearsal) -> float:
    offset = rehearsal.position[:, 0] - rehearsal.position[:, 1]
    return float(np.linalg.norm(offset, axis=1).min())


def test_agents_that_swap_positions_make_way(rehearsed: Rehearse) -> None:
    rehearsal = rehearsed()
    assert least_distance(rehearsal) > 0.9 * DISTANCE
    assert {step.outcome for step in rehearsal.steps} == {"done"}


def test_making_way_takes_time(rehearsed: Rehearse) -> None:
    swap, straight = rehearsed(), rehearsed("avoider=none")
    assert least_distance(straight) < 0.1
    assert swap.time[-1] > straight.time[-1] + 0.2


def test_goals_nearer_than_the_distance_are_reached(rehearsed: Rehearse) -> None:
    near = "mission.1.parallel.1.goto.to=[1.5, 0.4, 0.8]"
    rehearsal = rehearsed(near)
    assert {step.outcome for step in rehearsal.steps} == {"done"}


def test_agents_in_the_way_do_not_end_a_rehearsal(rehearsed: Rehearse) -> None:
    same = "mission.1.parallel.1.goto.to=[1.5, 0, 0.8]"
    rehearsal = rehearsed(same, "limits.separation=0.1")
    assert rehearsal.duration is not None


def test_drones_with_dynamics_take_longer(rehearsed: Rehearse) -> None:
    ideal, real = rehearsed("transport.controller=ideal"), rehearsed("transport.controller=pid")
    climbs = [each.steps[0].duration for each in (ideal, real)]
    assert climbs == pytest.approx([2.7, 3.6])
    assert real.time[-1] > ideal.time[-1] + 1.0


def test_uncertain_agents_pass_farther_apart(rehearsed: Rehearse) -> None:
    exact = rehearsed("limits.uncertainty_margin=0")
    assert least_distance(rehearsed()) > least_distance(exact) + 0.05  # m
