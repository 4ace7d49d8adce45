"""What a Crazyradio can serve, and what the check reports when it cannot."""

from __future__ import annotations

import pytest

from star_radio.budget import overloads, report_period


def on_dongle(n: int, dongle: int = 0) -> list[str]:
    return [f"radio://{dongle}/80/2M/E7E7E7E7{i:02X}" for i in range(n)]


def test_drones_share_what_a_dongle_carries() -> None:
    assert report_period(on_dongle(1), "legacy") == 0.01  # as fast as it estimates
    assert report_period(on_dongle(3), "legacy") == 0.02
    assert report_period(on_dongle(2) + on_dongle(2, 1), "legacy") == 0.02
    assert list(overloads(on_dongle(3), "legacy", 0.05, None)) == []


def test_a_slower_link_takes_longer() -> None:
    slow = [uri.replace("2M", "250K") for uri in on_dongle(20)]
    assert list(overloads(on_dongle(20), "inline", 0.1, 0.1)) == []
    (said,) = overloads(slow, "inline", 0.1, 0.1)
    assert "it can serve 16" in said


def test_udp_is_not_counted() -> None:
    uris = [f"udp://127.0.0.1:{19850 + i}" for i in range(100)]
    assert report_period(uris, "legacy") == 0.01
    assert list(overloads(uris, "legacy", 0.05, 0.01)) == []


def test_excessive_report_rates_are_refused_with_the_budget() -> None:
    assert list(overloads(on_dongle(3), "legacy", 0.05, 0.01)) == [
        "dongle '0' is to serve 3 agents with 100 exchanges/s each (20 setpoints/s up, "
        "100 reports/s down): 300/s, where 150/s may be planned, 50% of the 300/s of mode "
        "'legacy'; it can serve 1; reports take the most: report less often, or share the agents "
        "among more dongles"
    ]


SHARE = "share the agents among more dongles"


@pytest.mark.parametrize(
    ("n", "mode", "tick", "report", "advice"),
    [
        (8, "legacy", 0.05, None, f"setpoints take the most: lower the mission's rate, or {SHARE}"),
        (
            4,
            "legacy",
            0.02,
            0.02,
            "setpoints and reports alike take the most: lower the mission's rate and report less "
            f"often, or {SHARE}",
        ),
        (69, "inline", 0.1, None, f"setpoints and reports alike take the most: {SHARE}"),
        (20, "legacy", 0.2, None, f"reports take the most: {SHARE}"),
    ],
)
def test_what_can_be_fewer_is_advised(
    n: int, mode: str, tick: float, report: float | None, advice: str
) -> None:
    [told] = overloads(on_dongle(n), mode, tick, report)
    assert told.endswith(f"; {advice}")


@pytest.mark.parametrize(("n", "fits"), [(68, True), (69, False)])
def test_the_published_table_is_met(n: int, fits: bool) -> None:  # noqa: FBT001
    assert (not list(overloads(on_dongle(n), "inline", 0.1, 0.1))) is fits


def test_a_link_that_is_limited_reports_as_often_as_it_can() -> None:
    limited = "radio://0/80/2M/E7E7E7E701?rate_limit=30"
    assert report_period([limited], "legacy") == 0.04  # 1/30 + 1/300 s
    assert list(overloads([limited], "legacy", 0.05, None)) == []


def test_a_link_that_is_limited_is_refused_what_goes_beyond() -> None:
    limited = "radio://0/80/2M/E7E7E7E701?rate_limit=50"
    assert list(overloads([limited], "legacy", 0.05, 0.03)) == []
    assert list(overloads([limited], "legacy", 0.05, 0.02)) == [
        f"{limited!r} can carry 42.9 exchanges/s, and is to carry 50 (20 setpoints/s up, 50 "
        "reports/s down): raise its rate_limit, or leave it out"
    ]
