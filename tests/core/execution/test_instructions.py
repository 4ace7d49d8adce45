"""Stages of a tick return new goals and commands, and leave those that they are called with."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Goals
from star_core.execution.instructions import Draft, Instructions, hold
from star_core.testing import estimate

POSITION = np.array([[1.0, 2.0, 0.8], [0.0, 1.0, 0.8]])


def test_a_draft_leaves_the_instructions_it_starts_from() -> None:
    before = Instructions(Goals.none(2), doing=("goto cf1",))
    draft = Draft(before)
    draft.goals.set(1, POSITION[1], 0.5, 0.3)
    draft.leave.add(0)
    after = draft.finish()
    assert not before.goals.active.any()
    assert before.leave == frozenset()
    assert after.goals.active.tolist() == [False, True]
    assert after.goals.position[1].tolist() == [0.0, 1.0, 0.8]
    assert after.leave == frozenset({0})
    assert after.doing == ("goto cf1",)


def test_finished_goals_do_not_change_any_more() -> None:
    draft = Draft(Instructions(Goals.none(2)))
    draft.finish()
    with pytest.raises(ValueError, match="read-only"):
        draft.goals.set(0, POSITION[0], 0.0, 0.3)


def test_flying_agents_without_goals_hold_their_positions() -> None:
    goals = Goals.none(2)
    located = estimate(POSITION)
    assert hold(goals, np.zeros(2, np.bool_), located, 0.4) is goals
    held = hold(goals, np.array([True, False]), located, 0.4)
    assert held.active.tolist() == [True, False]
    assert held.position[0].tolist() == POSITION[0].tolist()
    assert held.speed.tolist() == [0.4, 0.0]
