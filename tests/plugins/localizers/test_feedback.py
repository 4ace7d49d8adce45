"""Fixes that are sent to the drones' own estimators."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_apriltag.dead_reckoning import AgentState
from star_apriltag.localizer import MIN_STD, MIN_YAW_STD, RETURN_STEP, RETURN_TURN, Feedback
from star_core import Corrections, Registry, Telemetry, Tick, Transform, fly, hookimpl, load
from star_sim.drone import standing
from star_sim.fusion import POSITION_GROWTH, Fusion
from tests.plugins.localizers.conftest import report

pytestmark = pytest.mark.ideal_world

MISSIONS = Path(__file__).parents[3] / "missions"
PATHS = ("box", "circle", "figure8")  # the paper's
AT_HOME = Transform(np.array([math.pi / 2]), np.array([[1.0, 2.0, 0.0]]))


class OnBoard:
    """An observer of the error of an on-board estimate, in the odometry frame of the start."""

    def __init__(self) -> None:
        self.start = AT_HOME
        self.squares: list[float] = []  # m²

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        assert tick.truth is not None
        off = self.start.apply(tick.telemetry.position) - tick.truth.position
        self.squares.append(float((off**2).sum()))


@cache
def flown(path: str, feedback: str, seed: int, *changes: str) -> tuple[dict[str, Any], float]:
    """Fly one of the paper's paths; return the summary and the mean square on-board error, m²."""
    watcher = OnBoard()
    registry = Registry(watcher)
    mission = load(
        MISSIONS / f"paper_{path}.yaml",
        registry,
        [
            f"seed={seed}",
            "transport.camera.mode=geometric",
            f"localizer={{use: apriltag, feedback: {feedback}, processes: 0}}",
            *changes,
        ],
    )
    (agent,) = mission.scene.agents
    watcher.start = Transform(np.array([agent.yaw]), np.array([agent.start]))
    return fly(mission, registry), float(np.mean(watcher.squares))


def flown_briefly(path: str, feedback: str, seed: int = 0) -> tuple[dict[str, Any], float]:
    return flown(path, feedback, seed, "mission.1.follow.until={elapsed: 16}")


@pytest.mark.extended
def test_corrections_reduce_the_drift_of_the_on_board_estimate() -> None:
    drift, positions, poses = (
        flown_briefly("circle", feedback)[1] for feedback in ("none", "extpos", "extpose")
    )
    assert positions < 0.2 * drift
    assert poses < 0.1 * drift


@pytest.mark.campaign
@pytest.mark.parametrize("path", PATHS)
def test_position_feedback_alone_bounds_on_board_drift(path: str) -> None:
    errors = [
        np.mean([flown(path, feedback, seed)[1] for seed in range(5)])
        for feedback in ("none", "extpos", "extpose")
    ]
    print(path, "RMS m, none, extpos, extpose:", np.sqrt(errors).round(3))  # noqa: T201
    assert errors[1] < 0.25**2
    assert errors[1] < errors[0] / 10


@pytest.mark.extended
def test_corrections_are_not_counted_twice() -> None:
    summaries = [flown_briefly("circle", "extpose", seed)[0] for seed in (0, 1)]
    assert np.mean([summary["position_nees"] for summary in summaries]) < 2.0
    assert np.mean([summary["position_mse_m2"]["mean"] for summary in summaries]) < 0.005


def belief(position: list[float], yaw: float = math.pi / 2, spread: float = 0.001) -> AgentState:
    covariance = np.diag([spread**2] * 4)
    return AgentState(np.array(position), yaw, 0.05, -0.02, np.zeros(3), 0.0, covariance)


def report_at(position: list[float]) -> Telemetry:
    return report([position], time=1.0)


def heading(corrections: Corrections) -> float:
    x, y, z, w = corrections.attitude[0].tolist()
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def sent(state: AgentState, reported: list[float]) -> Corrections:
    return Feedback(AT_HOME).corrections([0], [state], AT_HOME, report_at(reported))


def test_positions_are_sent_in_the_starting_frame_of_the_drone() -> None:
    answer = sent(belief([1.0, 2.5, 0.8]), [0.4, 0.0, 0.8])
    assert answer.position == pytest.approx(np.array([[0.5, 0.0, 0.8]]))


def test_attitudes_combine_own_tilt_with_the_estimated_heading() -> None:
    answer = sent(belief([1.0, 2.0, 0.8], yaw=math.pi / 2 + 0.1), [0.0, 0.0, 0.8])
    x, y, z, w = answer.attitude[0]
    assert heading(answer) == pytest.approx(0.1)
    assert math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) == pytest.approx(0.05)
    assert math.asin(2 * (w * y - z * x)) == pytest.approx(-0.02)


def test_a_position_can_be_sent_without_a_heading() -> None:
    state = belief([1.0, 2.5, 0.8], yaw=math.pi / 2 + 0.1)
    positions = Feedback(AT_HOME, turns=False)
    answer = positions.corrections([0], [state], AT_HOME, report_at([0.4, 0.0, 0.8]))
    assert answer.position == pytest.approx(np.array([[0.5, 0.0, 0.8]]))
    drones = standing(np.zeros((1, 3)), np.zeros(1), 1.0)
    Fusion(1).take(drones, answer, 4.0)
    assert drones["believed_position"][0, 0] > 0.1
    assert drones["believed_yaw"][0] == 0


def test_sent_deviations_exceed_those_of_the_fix() -> None:
    sure, unsure = (
        sent(belief([1.0, 2.0, 0.8], spread=spread), [0.0, 0.0, 0.8]) for spread in (0.001, 0.1)
    )
    assert (sure.position_deviation[0], sure.attitude_deviation[0]) == (MIN_STD, MIN_YAW_STD)
    assert unsure.position_deviation[0] == pytest.approx(0.15)
    assert unsure.attitude_deviation[0] == pytest.approx(0.15)


@pytest.mark.parametrize(("turns", "yaw"), [(True, RETURN_TURN), (False, 0.3)])
def test_a_jump_moves_the_frame_which_then_returns(*, turns: bool, yaw: float) -> None:
    feedback = Feedback(AT_HOME, turns=turns)
    lies = Transform(np.array([math.pi / 2 + 0.3]), np.array([[1.0, 3.0, 0.0]]))
    far, report = belief([1.0, 3.0, 0.8], yaw=math.pi / 2 + 0.3), report_at([0.0, 0.0, 0.8])
    assert len(feedback.corrections([0], [far], lies, report).agent) == 0

    answer = feedback.corrections([0], [far], lies, report)
    assert math.hypot(*answer.position[0, :2]) == pytest.approx(RETURN_STEP)
    assert heading(answer) == pytest.approx(yaw)
    for _fix in range(20):
        answer = feedback.corrections([0], [far], lies, report)
    assert math.hypot(*answer.position[0, :2]) == pytest.approx(21 * RETURN_STEP)


def test_jumps_of_unreported_drones_leave_their_frame_finite() -> None:
    feedback = Feedback(AT_HOME)
    state = belief([1.0, 2.0, 0.8])
    assert not len(feedback.corrections([0], [state], AT_HOME, report_at([math.nan] * 3)).agent)
    assert len(feedback.corrections([0], [state], AT_HOME, report_at([0.0, 0.0, 0.8])).agent)


def corrections(position: list[float], std: float, *, turns: bool = True) -> Corrections:
    turned = [0.0, 0.0, math.sin(0.1), math.cos(0.1)]
    position_std, yaw_std = np.array([std]), np.array([std if turns else math.inf])
    return Corrections(
        np.array([0]), np.array([position]), np.array([turned]), position_std, yaw_std
    )


def test_an_estimator_moves_partly_to_the_position_sent() -> None:
    drones = standing(np.zeros((1, 3)), np.zeros(1), 1.0)
    Fusion(1).take(drones, corrections([0.2, 0.1, 0.5], math.sqrt(POSITION_GROWTH * 4)), 4.0)
    assert drones["believed_position"][0] == pytest.approx([0.1, 0.05, 0.0])


def test_an_estimator_corrected_just_before_hardly_moves() -> None:
    drones = standing(np.zeros((1, 3)), np.zeros(1), 1.0)
    fusion = Fusion(1)
    fusion.take(drones, corrections([0.0, 0.0, 0.0], 0.01), 10.0)
    fusion.take(drones, corrections([0.2, 0.0, 0.0], 0.1), 10.0)
    assert 0 < drones["believed_position"][0, 0] < 0.005


def test_a_velocity_turns_with_the_heading() -> None:
    drones = standing(np.zeros((1, 3)), np.zeros(1), 1.0)
    drones["believed_velocity"][0] = [1.0, 0.0, 0.3]
    Fusion(1).take(drones, corrections([0.0, 0.0, 0.0], 1e-6), 10.0)
    assert drones["believed_yaw"][0] == pytest.approx(0.2, abs=1e-3)
    expected = [math.cos(0.2), math.sin(0.2), 0.3]
    assert drones["believed_velocity"][0] == pytest.approx(expected, abs=1e-3)


def test_a_position_fix_after_motion_corrects_the_heading() -> None:
    drones = standing(np.zeros((1, 3)), np.zeros(1), 1.0)
    fusion = Fusion(1)
    for way in range(1, 31):  # along x by its own heading, and in truth 0.1 rad to the left
        drones["believed_position"][0, 0] += math.cos(drones["believed_yaw"][0] - 0.1)
        drones["believed_position"][0, 1] += math.sin(drones["believed_yaw"][0] - 0.1)
        fusion.take(drones, corrections([float(way), 0.0, 0.0], 0.01, turns=False), 1.0 * way)
    assert drones["believed_yaw"][0] == pytest.approx(0.1, abs=0.02)


def test_a_position_fix_without_motion_leaves_the_heading() -> None:
    drones = standing(np.zeros((1, 3)), np.zeros(1), 1.0)
    Fusion(1).take(drones, corrections([0.1, 0.1, 0.0], 0.01, turns=False), 10.0)
    assert drones["believed_position"][0, :2] == pytest.approx([0.1, 0.1], rel=0.05)
    assert drones["believed_yaw"][0] == 0.0


@given(
    st.lists(
        st.tuples(st.floats(0.01, 20), *[st.floats(-5, 5)] * 2, st.floats(1e-3, 1)), min_size=1
    )
)
def test_a_covariance_stays_a_covariance(fixes: list[tuple[float, float, float, float]]) -> None:
    drones = standing(np.zeros((1, 3)), np.zeros(1), 1.0)
    fusion = Fusion(1)
    now = 0.0
    for passed, x, y, std in fixes:
        now += passed
        drones["believed_position"][0, :2] += [y, x]
        fusion.take(drones, corrections([x, y, 0.0], std, turns=False), now)
        covariance = fusion.covariance(drones, now)[0]
        assert np.allclose(covariance, covariance.T, rtol=1e-6)
        assert np.linalg.eigvalsh(covariance)[0] >= -1e-9 * np.trace(covariance)
