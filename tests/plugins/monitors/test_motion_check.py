"""Agents whose flow sensor sees no motion, and agents in wind, with a tilted sensor, or without."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from star_core import AgentPhase, Array, Estimate, Telemetry, Transform
from star_core.testing import scene
from star_core.toolkit import TickState, quaternion_from_euler
from star_monitors.drag_check import DRAG
from star_monitors.flow_monitor import FlowMonitor
from star_monitors.motion_check import GRAVITY, MotionCheck

PERIOD = 0.05  # s
BEGUN = 2.0  # s, when something goes wrong
AIR_DRAG = 0.42  # 1/s: 0.0135 N s/m, the greatest in recorded flights, of 32 g
FLOW_GAIN = 2.0  # 1/s, of the estimated velocity towards the flow sensor's
AIRBORNE = np.ones(1, np.bool_)


def report(time: float, speed: float, pull: float, yaw: float) -> Telemetry:
    """An agent that flies along (-1, 1) in its odometry frame, m/s, and tilts for m/s²."""
    direction = np.array([[-1.0, 1.0, 0.0]]) / np.sqrt(2)
    ahead, aside = (pull * np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])) @ (
        direction[0, :2]
    )
    attitude = quaternion_from_euler(
        np.array([-np.arctan2(aside, np.hypot(GRAVITY, ahead))]),
        np.array([np.arctan2(ahead, GRAVITY)]),
        np.array([yaw]),
    )
    zero = np.zeros(1)
    return Telemetry(
        time, np.zeros((1, 3)), speed * direction, attitude, zero, np.zeros(1, np.int64), zero
    )


def detection_time(
    speeds: Array, *, share: float = 1.0, wind: float = 0.0, error: float = 0.0, tilts: bool = True
) -> float:
    """Return when an agent is found that follows some speeds, (K,) m/s; infinity if never.

    Args:
        speeds: Of every tick.
        share: Share of the motion that its flow sensor sees from `BEGUN` on.
        wind: Acceleration by wind from then on, m/s².
        error: Of the reported tilt, m/s².
        tilts: Whether it reports a tilt at all.
    """
    check, speed, believed = MotionCheck(1), 0.0, 0.0
    for k, target in enumerate(speeds):
        time = k * PERIOD
        fails = time >= BEGUN
        pull = 3.0 * (target - believed)
        change = PERIOD * (pull - AIR_DRAG * speed + wind * fails)
        speed += change
        measured = (share if fails else 1.0) * speed
        believed += change + PERIOD * FLOW_GAIN * (measured - believed)
        now = report(time, believed, pull + error if tilts else 0.0, yaw=0.3 * time)
        if check.check(now, AIRBORNE)[0]:
            return time
    return np.inf


TRIP = np.repeat([0.0, 0.5, 0.0, -0.5, 0.0, 1.0], 40)


def test_an_agent_that_sees_no_motion_is_found_soon() -> None:
    assert detection_time(np.repeat([0.0, 0.5], [30, 100]), share=0.0) <= BEGUN + 0.6
    assert (
        detection_time(np.repeat([0.0, -0.5, 0.5], [30, 40, 100]), share=0.0, error=0.2)
        <= BEGUN + 0.3
    )
    assert detection_time(np.repeat([0.0, 0.25], [30, 100]), share=0.0) <= BEGUN + 2.1


@pytest.mark.parametrize("ticks", [1, 2, 3])
def test_a_bump_is_no_stuck_flow_sensor(ticks: int) -> None:
    check = MotionCheck(1)
    for k in range(80):
        speed = 0.5 - 0.25 * np.clip(k - 60, 0, ticks)  # it is stopped, and does not tilt
        pull = DRAG * speed + 1e-6
        assert not check.check(report(k * PERIOD, speed, pull, 0), AIRBORNE).any()


@pytest.mark.parametrize(
    "flight",
    [{}, {"wind": 0.6}, {"error": 0.3}, {"share": 0.8}, {"share": 1.2}, {"tilts": False}],
    ids=str,
)
def test_other_flights_are_let_alone(flight: dict[str, float]) -> None:
    assert detection_time(TRIP, **flight) == np.inf  # type: ignore[arg-type]


def test_one_that_was_found_stays_so_until_it_takes_off_again() -> None:
    check = MotionCheck(1)
    for k in range(100):  # it tilts all the time, and reports a constant speed
        answer = check.check(report(k * PERIOD, 0.5 * (k > 30), 1.5 * (k > 30) + 1e-6, 0), AIRBORNE)
    assert answer.all()
    away, faster = check.errors()
    assert faster[0, 0] < -0.5
    assert faster[0, 1] > 0.5
    assert away[0, 1] > 0.2
    assert check.check(report(5.0, 0.0, 1e-6, 0), AIRBORNE).all()
    away, _ = check.errors()
    assert check.check(report(5.05, 0.0, 1e-6, 0), ~AIRBORNE).all()
    assert check.errors()[0].tolist() == away.tolist()  # it lies there
    assert not check.errors()[1].any()
    assert not check.check(report(5.1, 0.0, 1e-6, 0), AIRBORNE).any()
    assert not np.any(check.errors())


def test_the_drag_corrects_the_velocity_of_one_that_was_found() -> None:
    check, missing = MotionCheck(1), 0.2 - 0.1j
    for k in range(100):
        check.check(report(k * PERIOD, 0.5 * (k > 30), 1.5 * (k > 30) + 1e-6, 0), AIRBORNE)
    before = check.errors()[1]
    check.correct(np.full((1, 2), np.nan))
    assert check.errors()[1].tolist() == before.tolist()
    for k in range(100, 150):
        check.check(report(k * PERIOD, 0.5, DRAG * 0.5, 0), AIRBORNE)
        check.correct(np.array([[missing.real, missing.imag]]))
    assert check.errors()[1][0, :2] == pytest.approx([0.2, -0.1], abs=0.05)


@pytest.mark.parametrize("flow_deck", [True, False])
def test_agents_without_flow_decks_are_not_judged(*, flow_deck: bool) -> None:
    monitor = FlowMonitor(dataclasses.replace(scene(1), flow_deck=flow_deck))
    reports: list[object] = []
    for k in range(100):
        heard = report(k * PERIOD, 0.5 * (k > 30), 1.5 * (k > 30) + 1e-6, 0)
        state = TickState(heard, np.array([AgentPhase.FLYING]), np.zeros(1, np.bool_))
        state.estimate = Estimate(
            time=heard.time,
            position=heard.position,
            velocity=heard.velocity,
            yaw=np.zeros(1),
            covariance=np.zeros((1, 3, 3)),
            valid=AIRBORNE,
            map_from_odom=Transform(np.zeros(1), np.zeros((1, 3))),
        )
        reports += monitor.check(state)
    assert bool(reports) == flow_deck
