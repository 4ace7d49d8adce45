"""The accelerometer's log block beside that of the state."""

from __future__ import annotations

import errno

import numpy as np
import pytest

from star_core import Array
from star_radio.accelerometer import BLOCK
from star_radio.transport import Radio
from tests.plugins.transports.star_radio.conftest import Open, Peers
from tests.plugins.transports.star_radio.peer import LINK_TIMEOUT, Peer
from tests.plugins.transports.star_radio.test_report_stream import cut, tick

FORCE = {"acc.x": -0.02, "acc.y": 0.05}  # g
MEASURED = 9.81 * np.array([-0.02, 0.05])  # m/s²


def force(radio: Radio) -> Array:
    tick(radio, 0.5)
    measured = radio.receive().specific_force
    assert measured is not None
    first: Array = measured[0]
    return first


def test_the_accelerometer_is_reported_beside_the_state(peers: Peers, connect: Open) -> None:
    [drone] = peers()
    drone.values |= FORCE
    radio = connect([drone])
    assert force(radio) == pytest.approx(MEASURED, rel=1e-3)
    drone.values["acc.x"] = 0.04
    assert force(radio)[0] == pytest.approx(9.81 * 0.04, rel=1e-3)


def test_its_log_block_is_created_again_after_a_cut_link(peers: Peers, connect: Open) -> None:
    [drone] = peers()
    drone.values |= FORCE
    radio = connect([drone])
    cut(drone, radio, LINK_TIMEOUT + 0.5)
    silent = radio.receive().specific_force
    assert silent is not None
    assert np.isnan(silent).all()
    tick(radio, 1.5)
    assert force(radio) == pytest.approx(MEASURED, rel=1e-3)


def test_a_drone_that_refuses_the_log_block_flies_without(peers: Peers, connect: Open) -> None:
    [drone] = peers()
    drone.values |= FORCE
    refuse(drone)
    assert np.isnan(force(connect([drone]))).all()


def test_firmware_without_the_variables_is_not_asked_for_them(peers: Peers, connect: Open) -> None:
    [drone] = peers()
    assert np.isnan(force(connect([drone]))).all()
    assert all(packet[1:3] != bytes([6, BLOCK]) for packet in drone.got)


def refuse(drone: Peer) -> None:
    """Let a drone have no memory left for the block."""
    answer = drone._log

    def refused(payload: bytes) -> bytes:
        no_memory = payload[0] in {6, 7} and payload[1] == BLOCK
        return payload[:2] + bytes([errno.ENOMEM]) if no_memory else answer(payload)

    drone._log = refused  # type: ignore[method-assign]
