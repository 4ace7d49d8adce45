"""Goals that the stages of a tick change, and then do not change any more."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Goals
from star_core.execution.instructions import GoalDraft
from star_core.testing import estimate

POSITION = np.array([[1.0, 2.0, 0.8], [0.0, 1.0, 0.8]])


def test_finished_goals_do_not_change_any_more() -> None:
    before = Goals.none(2)
    draft = GoalDraft(before)
    draft.set(1, POSITION[1], 0.5, 0.3)
    after = draft.finish()
    assert not before.active.any()
    assert after.active.tolist() == [False, True]
    assert after.position[1].tolist() == [0.0, 1.0, 0.8]
    with pytest.raises(ValueError, match="read-only"):
        draft.set(0, POSITION[0], 0.0, 0.3)


def test_flying_agents_without_goals_hold_their_positions() -> None:
    draft = GoalDraft(Goals.none(2))
    draft.hold(np.array([True, False]), estimate(POSITION), 0.4)
    held = draft.finish()
    assert held.active.tolist() == [True, False]
    assert held.position[0].tolist() == POSITION[0].tolist()
    assert held.speed.tolist() == [0.4, 0.0]
