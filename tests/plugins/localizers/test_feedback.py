"""Fixes that are sent to the drones' own estimators."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_apriltag.feedback import JUMP, LEAST, LEAST_YAW, Feedback
from star_apriltag.reckoning import Belief
from star_core import (
    Array,
    Corrections,
    Registry,
    Telemetry,
    Tick,
    Transform,
    fly,
    hookimpl,
    load,
)
from star_sim.drone import standing
from star_sim.fusion import POSITION_GROWTH, Fusion

MISSION = Path(__file__).parents[3] / "missions" / "paper_circle.yaml"
SEEDS = (0, 1)
AT_HOME = Transform(np.array([math.pi / 2]), np.array([[1.0, 2.0, 0.0]]))


class OnBoard:
    """An observer that keeps how far off each drone's own estimate is, put where it started."""

    def __init__(self) -> None:
        self.squares: list[float] = []

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        assert tick.truth is not None
        start = Transform(np.array([math.pi / 2]), np.array([[1.97, 0.0, 0.0]]))
        off = start.apply(tick.telemetry.position) - tick.truth.position
        self.squares.append(float((off**2).sum()))


@cache
def flown(feedback: str, seed: int) -> tuple[dict[str, Any], float]:
    """Fly 25 s; return the summary, and the mean square error of the drone's own estimate, m²."""
    watcher = OnBoard()
    registry = Registry(watcher)
    options = f"localizer={{use: apriltag, feedback: {feedback}}}"
    changes = [
        f"seed={seed}",
        "transport.camera.mode=geometric",
        "mission.1.follow.until={elapsed: 25}",
    ]
    summary = fly(load(MISSION, registry, [*changes, options]), registry)
    return summary, float(np.mean(watcher.squares))


@pytest.mark.parametrize(("feedback", "share"), [("extpos", 0.5), ("extpose", 0.25)])
def test_a_drone_that_is_told_where_it_is_drifts_less_itself(feedback: str, share: float) -> None:
    alone = np.mean([flown("none", seed)[1] for seed in SEEDS])
    told = np.mean([flown(feedback, seed)[1] for seed in SEEDS])
    assert told < share * alone


def test_what_a_drone_is_told_is_not_counted_twice() -> None:
    summaries = [flown("extpose", seed)[0] for seed in SEEDS]
    assert np.mean([summary["position_nees"] for summary in summaries]) < 2.0
    assert np.mean([summary["position_mse_m2"]["mean"] for summary in summaries]) < 0.005


def belief(position: list[float], yaw: float = math.pi / 2, spread: float = 0.001) -> Belief:
    covariance = np.diag([spread**2] * 4)
    return Belief(1.0, np.array(position), yaw, 0.05, -0.02, np.zeros(3), 0.0, covariance)


def telemetry(position: list[float]) -> Telemetry:
    one: Array = np.zeros(1)
    attitude, state = np.array([[0.0, 0, 0, 1]]), np.zeros(1, np.int64)
    return Telemetry(1.0, np.array([position]), np.zeros((1, 3)), attitude, one, state, one)


def told(found: Belief, reported: list[float]) -> Corrections:
    return Feedback(AT_HOME).corrections([0], [found], AT_HOME, telemetry(reported))


def test_a_place_is_told_in_the_frame_in_which_the_drone_started() -> None:
    answer = told(belief([1.0, 2.5, 0.8]), [0.4, 0.0, 0.8])
    assert answer.position == pytest.approx(np.array([[0.5, 0.0, 0.8]]))


def test_an_attitude_has_the_drones_own_tilt_and_the_heading_that_was_found() -> None:
    x, y, z, w = told(belief([1.0, 2.0, 0.8], yaw=math.pi / 2 + 0.1), [0.0, 0.0, 0.8]).attitude[0]
    assert math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(0.1)
    assert math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) == pytest.approx(0.05)
    assert math.asin(2 * (w * y - z * x)) == pytest.approx(-0.02)


def test_a_drone_may_be_told_its_place_and_not_its_heading() -> None:
    found = belief([1.0, 2.5, 0.8], yaw=math.pi / 2 + 0.1)
    positions = Feedback(AT_HOME, turns=False)
    answer = positions.corrections([0], [found], AT_HOME, telemetry([0.4, 0.0, 0.8]))
    assert answer.position == pytest.approx(np.array([[0.5, 0.0, 0.8]]))
    drones = standing(np.zeros((1, 3)), np.zeros(1), 1.0)
    Fusion(1).take(drones, answer, 4.0)
    assert drones["believed_position"][0, 0] > 0.1
    assert drones["believed_yaw"][0] == 0


def test_a_fix_is_told_to_be_less_sure_than_it_is() -> None:
    sure, unsure = (
        told(belief([1.0, 2.0, 0.8], spread=spread), [0.0, 0.0, 0.8]) for spread in (0.001, 0.1)
    )
    assert (sure.position_deviation[0], sure.attitude_deviation[0]) == (LEAST, LEAST_YAW)
    assert unsure.position_deviation[0] == pytest.approx(0.15)
    assert unsure.attitude_deviation[0] == pytest.approx(0.15)


def test_a_jump_moves_the_frame_and_not_the_drone() -> None:
    feedback = Feedback(AT_HOME)
    lies = Transform(np.array([math.pi / 2]), np.array([[1.0, 3.0, 0.0]]))
    far, here = belief([1.0, 2.0 + JUMP + 0.7, 0.8]), telemetry([0.0, 0.0, 0.8])
    assert len(feedback.corrections([0], [far], lies, here).agent) == 0
    assert feedback.corrections([0], [far], lies, here).position[0, :2] == pytest.approx([0.0, 0.0])


def corrections(position: list[float], deviation: float) -> Corrections:
    turned = [0.0, 0.0, math.sin(0.1), math.cos(0.1)]
    one = np.array([deviation])
    return Corrections(np.array([0]), np.array([position]), np.array([turned]), one, one)


def test_an_estimator_goes_part_of_the_way_to_where_it_is_told_to_be() -> None:
    drones = standing(np.zeros((1, 3)), np.zeros(1), 1.0)
    Fusion(1).take(drones, corrections([0.2, 0.1, 0.5], math.sqrt(POSITION_GROWTH * 4)), 4.0)
    assert drones["believed_position"][0] == pytest.approx([0.1, 0.05, 0.0])


def test_an_estimator_that_was_just_told_hardly_moves() -> None:
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
