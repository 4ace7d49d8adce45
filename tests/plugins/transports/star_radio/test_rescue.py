"""Landings through new links, after the guardian is lost."""

from __future__ import annotations

import pytest

pytest.importorskip("cflib")

from star_radio import orders, rescue


class Recorder:
    """A link that records the packets posted to it."""

    posted: list[bytes]

    def __init__(self, *_arguments: object) -> None:
        Recorder.posted = []

    def open(self, _timeout: float) -> None: ...

    def post(self, packet: bytes) -> None:
        self.posted.append(packet)

    def close(self) -> None: ...


def test_landings_precede_the_notification(monkeypatch: pytest.MonkeyPatch) -> None:
    """A notification that arrives without a landing would stop the motors."""
    monkeypatch.setattr(rescue, "Link", Recorder)
    monkeypatch.setattr("star_radio.rescue.time.sleep", lambda _time: None)
    rescue.land([rescue.Airborne("cf1", "udp://127.0.0.1:9", 0.6)], "cflib")
    first = Recorder.posted.index(orders.no_more_setpoints())
    assert first == rescue.ORDERS_FIRST
    assert all(packet[1] == orders.LAND for packet in Recorder.posted[:first])
    assert Recorder.posted.count(orders.no_more_setpoints()) > 1
