"""Estimated positions that an agent can have reached by flying, and others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from star_core import AgentPhase, Array, Estimate, Limits, Mask, Order, Telemetry
from star_core.safety.estimate_gate import (
    CORRECTION_SIGMAS,
    JUMP_MARGIN,
    MIN_PLAUSIBLE_SPEED,
    SPOILED_TIME,
    UNCORRECTED_MARGIN,
    EstimateMonitor,
)
from star_core.testing import estimate, scene
from star_core.toolkit import TickState, Use
from tests.core.conftest import Lab

SPEED, PERIOD = 0.5, 0.05  # m/s, s
AIRBORNE = np.ones(1, np.bool_)
SILENT = np.full((1, 3), np.nan)


def monitor() -> EstimateMonitor:
    """The monitor of one agent."""
    return EstimateMonitor(scene(1, limits=Limits(speed=SPEED)), "localizer 'seer'")


def checked(
    gate: EstimateMonitor,
    now: Estimate,
    airborne: Mask = AIRBORNE,
    velocity: Array = SILENT,
    height: float = np.nan,
) -> tuple[Estimate, list[str]]:
    """Check the estimate of an agent that is heard and reports a velocity and a height."""
    position, zero = np.array([[np.nan, np.nan, height]]), np.zeros(1)
    attitude, bits = np.zeros((1, 4)), np.zeros(1, np.int64)
    telemetry = Telemetry(now.time, position, velocity, attitude, zero, bits, zero)
    phase = np.where(airborne, AgentPhase.FLYING, AgentPhase.GROUNDED)
    state = TickState(telemetry, phase, ~AIRBORNE)
    state.estimate = now
    texts = []
    for finding in gate.check(state):
        if isinstance(finding, Use):
            state.estimate = cast("Estimate", finding.value)
        else:
            texts.append(finding.text)
    return state.estimate, texts


def believed(x: float, time: float, *, std: float = 0.01) -> Estimate:
    """An agent at (x, 0, 1), m, with this standard deviation along every axis, m."""
    now = estimate(np.array([[x, 0.0, 1.0]]), time=time)
    return replace(now, covariance=std**2 * np.eye(3)[None])


def gated(*positions: float) -> list[bool]:
    """Which of these positions along x, m, in consecutive ticks in flight are accepted."""
    gate = monitor()
    return [
        bool(checked(gate, believed(x, k * PERIOD))[0].valid[0]) for k, x in enumerate(positions)
    ]


def test_flight_at_the_speed_limit_is_accepted() -> None:
    assert all(gated(*(SPEED * PERIOD * np.arange(200)).tolist()))


def test_a_jump_is_rejected_until_the_estimate_is_back() -> None:
    assert gated(0.0, 50.0, 50.0, 0.1) == [True, False, False, True]


def test_a_height_that_the_ranger_denies_is_rejected_for_good() -> None:
    gate = monitor()
    descent = np.array([[0.0, 0.0, -0.3]])

    def accepted(tick: int, wrong: float, reported: float) -> bool:
        now = estimate(np.array([[0.0, 0.0, reported + wrong]]), time=tick * PERIOD)
        now = replace(now, covariance=1e-4 * np.eye(3)[None])
        answer, _ = checked(gate, now, AIRBORNE, descent, reported)
        return bool(answer.valid[0])

    heights = 1.3 + descent[0, 2] * PERIOD * np.arange(60)
    wrong = [accepted(k, 0.4 * (k >= 10), height) for k, height in enumerate(heights.tolist())]
    assert wrong == [True] * 10 + [False] * 50
    assert accepted(60, 0.0, float(heights[-1]))


def test_heights_over_an_obstacle_are_accepted() -> None:
    still = np.zeros((1, 3))
    for follows in (0.0, 1.0):  # whether the estimate is that of the ranger
        gate = monitor()
        for k, top in enumerate((0.0, 0.0, 0.4, 0.4, 0.0)):
            now = estimate(np.array([[0.0, 0.0, 1.0 - follows * top]]), time=k * PERIOD)
            now = replace(now, covariance=1e-4 * np.eye(3)[None])
            answer, _ = checked(gate, now, AIRBORNE, still, 1.0 - top)
            assert answer.valid.all()


def test_a_rejected_row_stays_where_it_was_at_rest() -> None:
    gate = monitor()
    checked(gate, believed(0.3, 0.0))
    moved = replace(believed(50.0, PERIOD), velocity=np.ones((1, 3)))
    answer, (text,) = checked(gate, moved)
    assert answer.position.tolist() == [[0.3, 0.0, 1.0]]
    assert answer.velocity.tolist() == [[0.0, 0.0, 0.0]]
    assert not answer.valid.any()
    most = MIN_PLAUSIBLE_SPEED * PERIOD + UNCORRECTED_MARGIN
    assert gate._state["jump"][0] == pytest.approx((49.7, PERIOD, most))
    assert text == (
        "cf1 brakes: its estimated position moved 49.70 m in 0.05 s, expected at most "
        f"{most:.2f} m from localizer 'seer'"
    )


def test_corrected_positions_may_jump_farther() -> None:
    def accepted(*stds: float) -> bool:
        gate = monitor()
        for k, std in enumerate(stds):
            checked(gate, believed(0.0, k * PERIOD, std=std))
        jump = MIN_PLAUSIBLE_SPEED * PERIOD + 0.9 * JUMP_MARGIN
        later = believed(jump, len(stds) * PERIOD, std=stds[-1])
        return bool(checked(gate, later)[0].valid[0])

    assert not accepted(0.1, 0.11, 0.12)  # dead reckoning
    assert not accepted(0.12, 0.1199, 0.1198)  # back to its start
    assert accepted(0.1, 0.12, 0.05, 0.05)


def stuck(*velocities: float, drift: float = 0.0) -> list[bool]:
    """In which ticks a position that only drifts is accepted while the agent reports velocities."""
    gate = monitor()
    valid = []
    for k, velocity in enumerate(velocities):
        reported = np.array([[velocity, 0.0, 0.0]])
        answer, _ = checked(gate, believed(drift * k, k * PERIOD), velocity=reported)
        valid.append(bool(answer.valid[0]))
    return valid


def test_estimates_frozen_in_flight_are_rejected() -> None:
    flight = [SPEED + noise for noise in np.linspace(0, 0.01, 30)]
    answer = stuck(*flight)
    assert answer.index(False) == 12  # 0.3 m at 0.5 m/s
    assert not any(answer[12:])
    assert all(stuck(*[np.nan] * 30))
    assert all(stuck(*flight, drift=1e-9))
    assert all(stuck(*[SPEED] * 30))  # reports that repeat


def spoiled(*velocities: float, airborne: bool = True) -> list[tuple[bool, float]]:
    """In which ticks an agent that reports velocities is located, and its position, m.

    An agent that reports another velocity than 0 reports a random position.
    """
    gate, random = monitor(), np.random.default_rng(0)
    track = []
    for k, velocity in enumerate(velocities):
        position = 0.1 if velocity == 0 else 0.1 + random.normal()
        now = replace(believed(position, k * PERIOD), valid=np.isfinite([velocity]))
        reported = np.array([[velocity, 0.0, 0.0]])
        answer, _ = checked(gate, now, airborne & AIRBORNE, reported)
        track.append((bool(answer.valid[0]), float(answer.position[0, 0])))
    return track


@pytest.mark.parametrize("airborne", [True, False])
def test_random_velocity_reports_keep_the_last_position(*, airborne: bool) -> None:
    bad = np.where(np.random.default_rng(1).random(200) < 0.5, np.nan, 20.0).tolist()
    ticks = round(SPOILED_TIME / PERIOD)
    track = spoiled(*[0.0] * 5, *bad, *[0.0] * (ticks + 5), airborne=airborne)
    assert all(x == 0.1 for _, x in track)
    located = [valid for valid, _ in track]
    assert located[:5] == [True] * 5
    assert not any(located[5 : 5 + 200 + ticks - 2])
    assert all(located[-5:])


def test_an_agent_that_reports_no_velocity_at_all_is_located() -> None:
    gate = monitor()
    for k in range(5):
        assert checked(gate, believed(0.0, k * PERIOD))[0].valid.all()


def test_a_jump_is_reported_once() -> None:
    gate = monitor()
    checked(gate, believed(0.0, 0.0))
    jumps = [checked(gate, believed(50.0, k * PERIOD))[1] for k in range(1, 5)]
    assert [len(texts) for texts in jumps] == [1, 0, 0, 0]


def test_a_jump_that_lasts_does_not_become_plausible() -> None:
    gate = monitor()
    checked(gate, believed(0.0, 0.0))
    velocity = SPEED
    for k in range(1, 60):
        velocity *= 0.9  # it brakes
        reported = np.array([[velocity, 0.0, 0.0]])
        assert not checked(gate, believed(2.0, k * PERIOD), AIRBORNE, reported)[0].valid.any()
    assert checked(gate, believed(0.2, 3.0), AIRBORNE, reported)[0].valid.all()


def test_many_small_jumps_are_a_large_one() -> None:
    step = MIN_PLAUSIBLE_SPEED * PERIOD + 0.9 * UNCORRECTED_MARGIN
    assert gated(0.0, step, 2 * step) == [True, True, False]


def test_a_correction_that_the_covariance_announced_is_accepted() -> None:
    gate = monitor()
    drift = 1.0  # m, standard deviation along every axis
    checked(gate, believed(0.0, 0.0, std=drift))
    correction = 0.9 * CORRECTION_SIGMAS * drift
    for k in range(1, 40):  # and does not count against later ticks
        answer, jumps = checked(gate, believed(correction, k * PERIOD))
        assert answer.valid.all()
        assert not jumps


def test_persistently_large_covariance_does_not_admit_jumps() -> None:
    gate = monitor()
    checked(gate, believed(0.0, 0.0, std=1.0))
    answer, _ = checked(gate, believed(2.0, PERIOD, std=1.0))
    assert not answer.valid.any()


def test_everything_is_accepted_on_the_ground() -> None:
    gate, grounded = monitor(), np.zeros(1, np.bool_)
    checked(gate, believed(0.0, 0.0), grounded)
    assert checked(gate, believed(50.0, PERIOD), grounded)[0].valid.all()
    assert checked(gate, believed(50.0, 2 * PERIOD))[0].valid.all()


def test_agents_rejected_in_flight_are_not_accepted_elsewhere() -> None:
    gate, grounded = monitor(), np.zeros(1, np.bool_)
    at_rest = np.zeros((1, 3))
    checked(gate, believed(0.0, 0.0), AIRBORNE, at_rest)
    for k in range(1, 100):
        answer, _ = checked(
            gate, believed(1.0, k * PERIOD), grounded if k > 20 else AIRBORNE, at_rest
        )
        assert answer.position[0, 0] == 0.0
        assert not answer.valid.any()
    assert checked(gate, believed(0.2, 5.0), grounded, at_rest)[0].valid.all()


def test_unlocated_agents_may_reappear_within_flight_distance() -> None:
    gate = monitor()
    checked(gate, believed(0.0, 0.0))
    lost = replace(believed(np.nan, 1.0), valid=np.zeros(1, np.bool_))
    checked(gate, lost)
    assert checked(gate, believed(2 * MIN_PLAUSIBLE_SPEED, 2.0))[0].valid.all()


HOLD = "\n  - climb: {}\n  - wait: {seconds: 6}\n  - descend: {}"


def jumping(after: float) -> Callable[..., Estimate]:
    """A localizer that is right until a mission time, s, and then 50 m off for the first agent."""

    def locate(right: Callable[..., Estimate], telemetry: Telemetry) -> Estimate:
        answer = right(telemetry)
        off = np.array([[50.0, 0.0, 50.0], [0.0, 0.0, 0.0]]) * (telemetry.time > after)
        return replace(answer, position=answer.position + off)

    return locate


def test_localizer_jumps_are_reported_and_the_agent_lands(lab: Lab) -> None:
    lab.spoil("localizer", "locate", jumping(after=3.0))
    summary = lab.fly(HOLD)
    (text,) = lab.said("estimate")
    assert text.startswith("cf1 brakes: its estimated position moved 70.71 m in 0.10 s")
    assert "localizer 'seer' (their-dist 1.2:lab)" in text
    assert summary["reason"].endswith("cf1 is lost")
    landings = [command for _, command in lab.robots.commands if command.order is Order.LAND]
    assert max(float(command.duration.max()) for command in landings) <= 5.0
    assert summary["flight_time_s"] < 15.0


def test_localizer_jumps_trigger_the_position_lost_rule(lab: Lab) -> None:
    lab.spoil("localizer", "locate", jumping(after=3.0))
    summary = lab.fly(HOLD, more="safety: {position_lost: {after: 1.0}}\n")
    assert summary["outcome"] == "completed"
    assert lab.said("safety") == ["cf1 lands: position_lost: not located for 1 s"]
