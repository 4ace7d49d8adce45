"""What is forwarded to the on-board estimators."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from star_core import Agent, PoseFixes
from star_core.testing import scene
from star_core.toolkit import yaw_from_quaternion
from star_mocap.forwarding import Forwarding
from star_mocap.kernel import COLUMNS, HEADING, QX, QZ, TIME, VX
from tests.plugins.localizers.conftest import fixes

AGENTS = (Agent("cf1", (1.0, 0.0, 0.0), yaw=math.pi / 2), Agent("cf2", (0.0, 0.0, 0.0)))


def forwarding(*, turns: bool = True) -> Forwarding:
    return Forwarding(replace(scene(2), agents=AGENTS), 10.0, turns=turns)


def measured(time: float, *, rows: list[int], yaw: float = math.pi / 2) -> PoseFixes:
    position = [[1.0, 2.0, 0.8]] * len(rows)
    return fixes(time, position, agent=rows, yaw=yaw, std=0.001)


STILL = np.zeros((2, 3))


def test_poses_are_in_the_odometry_frame_of_the_start() -> None:
    sent = forwarding().corrections(1.0, measured(1.0, rows=[0]), STILL)
    assert sent.agent.tolist() == [0]
    assert sent.position[0] == pytest.approx([2.0, 0.0, 0.8])  # ahead of its start
    assert yaw_from_quaternion(sent.attitude) == pytest.approx([0.0], abs=1e-9)
    assert sent.position_deviation == pytest.approx([0.01])


def test_poses_are_moved_on_to_the_time_at_which_they_are_sent() -> None:
    flying = np.array([[0.0, 0.5, 0.0], [0.0, 0.0, 0.0]])
    sent = forwarding().corrections(1.1, measured(1.0, rows=[0]), flying)
    assert sent.position[0] == pytest.approx([2.05, 0.0, 0.8])


def test_each_agent_is_sent_its_newest_pose_at_the_rate() -> None:
    plugin = forwarding()
    times = [tick / 20 for tick in range(21)]
    sent = [plugin.corrections(t, measured(t, rows=[0, 1]), STILL).agent.tolist() for t in times]
    assert sent == [[0, 1], []] * 10 + [[0, 1]]


def test_only_new_measurements_are_sent() -> None:
    plugin = forwarding()
    assert len(plugin.corrections(1.0, measured(1.0, rows=[1]), STILL).agent) == 1
    assert len(plugin.corrections(2.0, PoseFixes.none(), STILL).agent) == 0


@pytest.mark.parametrize(("turns", "yaw"), [(False, 0.5), (True, math.nan)])
def test_positions_without_headings_are_sent_alone(*, turns: bool, yaw: float) -> None:
    sent = forwarding(turns=turns).corrections(1.0, measured(1.0, rows=[0], yaw=yaw), STILL)
    assert np.isinf(sent.attitude_deviation).all()
    assert np.isfinite(sent.attitude).all()


def test_odometry_is_the_integral_of_velocities() -> None:
    plugin = forwarding()
    for tick in range(11):
        report = np.zeros((2, COLUMNS))
        report[:, TIME], report[:, VX] = tick / 10, 0.5
        report[0, QX] = 7.0  # an estimate that a forwarded pose has moved
        report[1, HEADING] = np.nan if tick == 5 else 0.0  # one report is spoiled
        plugin.dead_reckon(report)
    assert report[:, QX] == pytest.approx([0.5, 0.5])
    assert report[:, QZ] == pytest.approx([0.0, 0.0])
