"""Time stamps become times of the computer's clock."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_radio.report import WINDOW, WRAP, Clock

LEAD = 1234.5  # s, of the computer's clock


def run(delays: list[float], start: int = 0, drift: float = 0.0) -> list[float]:
    """Return by how much the times of reports every 10 ms are wrong, s."""
    clock = Clock()
    wrong = []
    for i, delay in enumerate(delays):
        true = LEAD + 0.01 * i * (1 + drift)
        wrong.append(clock.time((start + 10 * i) % WRAP, true + delay) - true)
    return wrong


@given(st.lists(st.floats(0.001, 0.3), min_size=2, max_size=50))
def test_times_are_late_by_the_least_delay_so_far(delays: list[float]) -> None:
    wrong = run(delays)
    least = [min(delays[: i + 1]) for i in range(len(delays))]
    assert all(abs(a - b) < 1e-6 for a, b in zip(wrong, least, strict=True))


def test_a_stamp_turns_over() -> None:
    wrong = run([0.002] * 100, start=WRAP - 500)
    assert max(abs(late - 0.002) for late in wrong) < 1e-6


def test_times_follow_a_clock_that_is_fast_or_slow() -> None:
    for drift in (-40e-6, 40e-6):
        wrong = run([0.002] * 6000, drift=drift)
        assert max(abs(late - 0.002) for late in wrong) < 2.5 * WINDOW * 40e-6


def test_a_clock_that_fell_behind_is_followed_within_two_windows() -> None:
    n = round(2 * WINDOW / 0.01)
    wrong = run([0.002] * n + [0.302] * (n + 2))
    assert abs(wrong[n] - 0.002) < 1e-6
    assert abs(wrong[-1] - 0.302) < 1e-6


@pytest.mark.parametrize(("uptime", "restarted"), [(60_000, 20), (12_000_000, 1000)])  # ms
def test_a_drone_that_restarts_counts_anew(uptime: int, restarted: int) -> None:
    clock = Clock()
    clock.time(uptime, 100.0)
    assert clock.time(restarted, 101.0) == 101.0
    assert abs(clock.time(restarted + 10, 101.5) - 101.01) < 1e-9
    assert clock.restarted


def test_a_packet_that_is_late_is_no_restart() -> None:
    clock = Clock()
    for i in range(10):
        clock.time(1000 + 10 * i, 50 + 0.01 * i)
    assert abs(clock.time(1030, 50.3) - 50.03) < 1e-9
    assert not clock.restarted


def altered(*stamps: int) -> tuple[Clock, list[float]]:
    """A clock, and how late reports every 10 ms are whose first timestamps, ms, are altered."""
    clock = Clock()
    clock.time(5000, 50.0)
    every = [*stamps, *range(5010 + 10 * len(stamps), 5100, 10)]
    arrivals = [50.01 + 0.01 * i for i in range(len(every))]
    return clock, [
        clock.time(*reading) - reading[1] for reading in zip(every, arrivals, strict=True)
    ]


@pytest.mark.parametrize("stamps", [(20,), (200_000,), (WRAP // 2 + 5000,), (20, 200_000, 3000)])
def test_altered_timestamps_that_disagree_are_no_restart(stamps: tuple[int, ...]) -> None:
    clock, late = altered(*stamps)
    assert not clock.restarted
    assert max(map(abs, late)) < 1e-9


def test_a_pause_of_minutes_is_no_restart() -> None:
    clock = Clock()
    clock.time(1000, 50.0)
    assert clock.time(601_000, 650.0) == 650.0
    assert not clock.restarted
