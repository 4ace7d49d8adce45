"""Agents that stream no odometry, or none for a while, are followed by what they report."""

from __future__ import annotations

from dataclasses import replace

from star_core import Odometry, Telemetry
from tests.plugins.localizers.apriltag.conftest import (
    TICK,
    Circle,
    flight,
    flown,
    localizer,
    off,
    room,
    sheets,
    telemetry,
)

TAGS = sheets()


def silent(heard: Telemetry) -> Telemetry:
    return replace(heard, odometry=Odometry.none())


def test_agents_without_odometry_are_tracked_by_their_reports() -> None:
    circle = Circle(10)
    estimates = flight(circle, change=silent)
    assert off(estimates, circle).max() < 0.03  # the first report gives no yaw rate
    with_tags = flight(circle, TAGS, change=silent)
    assert off(with_tags, circle)[100:].max() < 0.01


def test_a_stream_that_comes_every_few_ticks_is_what_counts() -> None:
    circle = Circle(10)
    made, since, estimates = localizer(room([circle], TAGS)), 0.0, []
    for k in range(1, 200):
        now = k * TICK
        if k % 4:
            heard = silent(telemetry([circle], now))
            if now > 4 * TICK:
                heard = replace(heard, velocity=5 * heard.velocity)  # which must not be used
        else:
            heard, since = telemetry([circle], now, since=since), now
        estimates.append(made.locate(heard))
    assert off(estimates, circle).max() < 0.03


def test_agents_without_odometry_are_not_sent_corrections() -> None:
    circle = Circle(10)
    streams = localizer(room([circle], TAGS), feedback="extpose")
    assert any(len(e.corrections.agent) for e in flown(streams, [circle], 5.0, TAGS))
    reports = localizer(room([circle], TAGS), feedback="extpose")
    late = flown(reports, [circle], 5.0, TAGS, change=silent)[20:]  # silent for more than 0.5 s
    assert not any(len(estimate.corrections.agent) for estimate in late)


def test_a_stream_that_ends_is_made_up_for() -> None:
    circle = Circle(10)

    def until_three(heard: Telemetry) -> Telemetry:
        return heard if heard.time < 3.0 else silent(heard)

    estimates = flight(circle, change=until_three)
    assert off(estimates, circle).max() < 0.03
