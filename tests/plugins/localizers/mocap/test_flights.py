"""Simulated flights by motion capture: some of those of `tests.campaign.mocap`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from star_core import Registry, Tick, Truth, fly, hookimpl, load
from star_sim.transport import Simulator
from tests.campaign import mocap, mocap_fleet

SEED = mocap.SEED + 500
SHORT = "mission=[takeoff: {height: 0.8}, goto: {by: [1.5, 0, 0]}, land: {}]"


@pytest.mark.extended
@pytest.mark.parametrize("holds", mocap.LOSSES.values(), ids=list(mocap.LOSSES))
def test_what_a_system_loses_is_noticed(holds: Callable[[int], bool]) -> None:
    assert holds(SEED)


@pytest.mark.extended
@pytest.mark.parametrize("holds", [mocap_fleet.long_loss, mocap_fleet.exchange])
def test_losses_are_noticed_over_the_protocols(holds: Callable[[int], bool]) -> None:
    pytest.importorskip("natnet")
    assert holds(SEED)


def test_drones_with_a_marker_each_keep_their_identities() -> None:
    assert mocap.passing(SEED)


@pytest.mark.extended
@pytest.mark.parametrize("latency", [0.0, pytest.param(0.06, marks=pytest.mark.campaign), 0.12])
def test_the_latency_is_estimated_within_five_milliseconds(latency: float) -> None:
    assert abs(mocap.latency_error(SEED, latency)) <= 0.005


@pytest.mark.parametrize(
    "forward",
    ["none", *(pytest.param(name, marks=pytest.mark.extended) for name in ("extpos", "extpose"))],
)
def test_positions_are_within_a_centimetre(forward: str) -> None:
    flight = mocap.accuracy(SEED, [f"localizer.forward={forward}", SHORT])
    assert flight.rms <= 0.01
    assert 0.5 <= flight.nees <= 2.0
    assert (flight.on_board < 0.05) is (forward != "none")


class Estimates:
    """Keeps what a flight is flown by."""

    def __init__(self) -> None:
        self.ticks: list[bytes] = []

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self.ticks.append(tick.estimate.position.tobytes() + tick.sent.velocity.tobytes())


def estimates() -> list[bytes]:
    """Fly a short mission, and return what it was flown by."""
    observer = Estimates()
    registry = Registry(observer)
    changes = ["collisions=record", SHORT.replace("1.5", "0.5")]
    fly(load(mocap.MISSION, registry, changes), registry)
    return observer.ticks


@pytest.mark.extended
def test_no_plugin_receives_the_ground_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    """A flight with another ground truth is the same to the last bit."""
    before, real = estimates(), Simulator.truth

    def elsewhere(own: Simulator) -> Truth | None:
        truth = real(own)
        return None if truth is None else replace(truth, position=truth.position + 9)

    monkeypatch.setattr(Simulator, "truth", elsewhere)
    assert len(before) > 100
    assert estimates() == before
