"""Reports are restarted in flight, and reboots are detected by their clock."""

from __future__ import annotations

import pytest

from star_core import Supervisor
from star_radio import orders
from star_radio.transport import Radio
from tests.plugins.transports.star_radio.conftest import TICK, Open, ticks
from tests.plugins.transports.star_radio.peer import LINK_TIMEOUT, Peer

HOVERS = {
    "supervisor.info": int(Supervisor.FLYING | Supervisor.COMMANDER_FINISHED),
    "stateEstimateZ.z": 800,
}


def cut(drone: Peer, radio: Radio, seconds: float) -> None:
    """Cut the link of a drone in both directions."""
    take = drone.take
    drone.take = lambda data: None  # type: ignore[method-assign]  # noqa: ARG005
    drone.mute.set()
    ticks(radio, round(seconds / TICK) + 1)
    drone.take = take  # type: ignore[method-assign]
    drone.mute.clear()


def landings(drone: Peer) -> list[bytes]:
    return [payload for payload in drone.ordered if payload[0] == orders.LAND]


def test_a_lost_log_block_is_created_again_and_is_no_reboot(drone: Peer, radio: Radio) -> None:
    cut(drone, radio, LINK_TIMEOUT + 0.5)
    assert radio.receive().age[0] > LINK_TIMEOUT
    ticks(radio, 11)
    telemetry = radio.receive()
    assert telemetry.age[0] < 0.1
    assert telemetry.rebooted is not None
    assert not telemetry.rebooted.any()
    assert radio.connected.all()


@pytest.mark.parametrize("start", [b"\x51\x06", b"\x51\x07", b"\x51\x03", b"\x51"])
def test_a_log_block_is_created_again_although_answers_are_lost(
    drone: Peer, radio: Radio, start: bytes
) -> None:
    drone.lose[start] = 2
    cut(drone, radio, LINK_TIMEOUT + 0.5)
    drone.values["stateEstimateZ.x"] = 1234
    ticks(radio, 81)
    telemetry = radio.receive()
    assert telemetry.age[0] < 0.1
    assert telemetry.position[0, 0] == 1.234


def test_a_landing_survives_the_gap_and_is_repeated(drone: Peer, connect: Open) -> None:
    drone.values |= HOVERS
    radio = connect([drone])
    ticks(radio, 5)
    drone.mute.set()
    radio.vehicles[0].land()
    cut(drone, radio, 6.0)
    count = len(landings(drone))
    ticks(radio, 21)
    assert len(landings(drone)) > count


def test_a_drone_whose_clock_restarts_has_rebooted(drone: Peer, radio: Radio) -> None:
    ticks(radio, 5)
    drone.boot -= 3.0
    ticks(radio, 5)
    telemetry = radio.receive()
    assert telemetry.rebooted is not None
    assert telemetry.rebooted.tolist() == [True]
    assert radio.connected.tolist() == [False]
    assert landings(drone) == []
    ticks(radio, 21)
    assert radio.receive().age[0] > 0.9  # what it reports since is of another flight


def test_a_drone_that_rebooted_but_flies_is_landed(drone: Peer, connect: Open) -> None:
    drone.values |= HOVERS
    radio = connect([drone])
    ticks(radio, 5)
    drone.boot -= 3.0
    ticks(radio, 7)
    assert landings(drone)
    assert landings(drone)[0][1] == orders.ALL_GROUPS


@pytest.mark.parametrize(
    ("hovers", "heard", "notified"),
    [(True, False, 0), (True, True, 0), (False, True, 1)],  # without a plan its motors would stop
)
def test_only_a_drone_on_the_ground_is_notified_at_the_end(
    drone: Peer, connect: Open, *, hovers: bool, heard: bool, notified: int
) -> None:
    drone.values |= HOVERS if hovers else {}
    radio = connect([drone])
    ticks(radio, 5)
    if not heard:
        drone.mute.set()  # it receives, but is not heard
        ticks(radio, 21)
        radio.vehicles[0]._handover = None
    count = len(drone.sent_to(7, 1))
    radio.vehicles[0].end_reports()
    assert len(drone.sent_to(7, 1)) == count + notified
