"""Log blocks beside that of the state: of the accelerometer, and of variances of positions."""

from __future__ import annotations

import errno

import numpy as np
import pytest

from star_core import Array, PluginError
from star_radio.extra_reports import ACCELEROMETER, POSITION_VARIANCE
from star_radio.transport import Radio
from tests.plugins.transports.star_radio.conftest import Open, ticks
from tests.plugins.transports.star_radio.peer import LINK_TIMEOUT, Peer
from tests.plugins.transports.star_radio.test_report_stream import cut

FORCE = {"acc.x": -0.02, "acc.y": 0.05}  # g
MEASURED = 9.81 * np.array([-0.02, 0.05])  # m/s²


def force(radio: Radio) -> Array:
    measured = ticks(radio, 11)[-1].specific_force
    assert measured is not None
    first: Array = measured[0]
    return first


def test_the_accelerometer_is_reported_beside_the_state(drone: Peer, connect: Open) -> None:
    drone.values |= FORCE
    radio = connect([drone])
    assert force(radio) == pytest.approx(MEASURED, rel=1e-3)
    drone.values["acc.x"] = 0.04
    assert force(radio)[0] == pytest.approx(9.81 * 0.04, rel=1e-3)


def test_its_log_block_is_created_again_after_a_cut_link(drone: Peer, connect: Open) -> None:
    drone.values |= FORCE
    radio = connect([drone])
    cut(drone, radio, LINK_TIMEOUT + 0.5)
    silent = radio.receive().specific_force
    assert silent is not None
    assert np.isnan(silent).all()
    ticks(radio, 31)
    assert force(radio) == pytest.approx(MEASURED, rel=1e-3)


def test_a_drone_that_refuses_the_log_block_flies_without(drone: Peer, connect: Open) -> None:
    drone.values |= FORCE
    refuse(drone, ACCELEROMETER.number)
    assert np.isnan(force(connect([drone]))).all()


def test_firmware_without_the_variables_is_not_asked_for_them(drone: Peer, connect: Open) -> None:
    assert np.isnan(force(connect([drone]))).all()
    assert all(packet[1:3] != bytes([6, ACCELEROMETER.number]) for packet in drone.got)


def refuse(drone: Peer, block: int) -> None:
    """Let a drone have no memory left for a block."""
    answer = drone._log

    def refused(payload: bytes) -> bytes:
        no_memory = payload[0] in {6, 7} and payload[1] == block
        return payload[:2] + bytes([errno.ENOMEM]) if no_memory else answer(payload)

    drone._log = refused  # type: ignore[method-assign]


VARIANCE = {"kalman.varX": 1e-4, "kalman.varY": 4e-4, "kalman.varZ": 1e4}  # m²


def in_map(peers: list[Peer], make: Open) -> Radio:
    """A radio for a localizer that takes reports in the map, connected."""
    radio = make([peer.uri for peer in peers], reports_in_map=True)
    radio.connect()
    return radio


def test_variances_of_positions_are_reported_where_they_count(drone: Peer, make: Open) -> None:
    drone.values |= VARIANCE
    radio = in_map([drone], make)
    variance = ticks(radio, 11)[-1].position_variance
    assert variance is not None
    assert variance[0] == pytest.approx([*VARIANCE.values()], rel=1e-3)
    cut(drone, radio, 0.7)
    silent = radio.receive().position_variance
    assert silent is not None
    assert np.isnan(silent).all()


def test_without_them_other_localizers_fly(drone: Peer, connect: Open) -> None:
    drone.values |= VARIANCE
    radio = connect([drone])
    assert ticks(radio, 11)[-1].position_variance is None
    assert all(packet[1:3] != bytes([6, POSITION_VARIANCE.number]) for packet in drone.got)


@pytest.mark.parametrize(("logs", "code"), [(False, "update it"), (True, "no memory left")])
def test_a_drone_that_cannot_report_them_does_not_fly(
    drone: Peer, make: Open, *, logs: bool, code: str
) -> None:
    if logs:
        drone.values |= VARIANCE
        refuse(drone, POSITION_VARIANCE.number)
    with pytest.raises(PluginError, match=code):
        in_map([drone], make)
