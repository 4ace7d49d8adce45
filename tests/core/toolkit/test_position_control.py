"""The flight to a point that planners share; its law is tested through the planner ``straight``."""

from __future__ import annotations

import numpy as np
import pytest

from star_core.messages.state import Goals
from star_core.testing import estimate, scene
from star_core.toolkit.position_control import PositionController


def test_an_agent_with_a_way_to_go_beyond_its_point_does_not_brake_for_it() -> None:
    homing = PositionController(scene(2), gain=1.0, yaw_rate_deg=90.0)
    near = Goals(
        position=np.array([[0.1, 0, 1], [0.1, 0, 1]]),
        velocity=np.zeros((2, 3)),
        yaw=np.zeros(2),
        speed=np.full(2, 0.5),
        active=np.ones(2, np.bool_),
    )
    here = estimate(np.array([[0.0, 0, 1], [0, 0, 1]]))
    velocity = homing.velocity(here, near, beyond=np.array([0.0, 2.0]))
    assert velocity[:, 0] == pytest.approx([0.1, 0.5])
