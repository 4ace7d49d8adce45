"""Parameters that would run the motors past the safety filter."""

from __future__ import annotations

import pytest

from star_core import PluginError
from tests.plugins.transports.star_radio.conftest import Open, Peers


def test_no_mission_runs_motors_by_parameters(peers: Peers, connect: Open) -> None:
    [drone] = peers()
    with pytest.raises(PluginError):
        connect([drone], parameters={"motorPowerSet.enable": 1})
    assert drone.stored["motorPowerSet.enable"] == b"\0"


def test_no_script_runs_motors_by_parameters(peers: Peers, connect: Open) -> None:
    [drone] = peers()
    radio = connect([drone])
    radio.set_parameters([0], {"motorPowerSet.enable": 1, "ring.effect": 7})
    for tick in range(10):
        radio.wait(0.05 * tick)
    assert drone.stored["motorPowerSet.enable"] == b"\0"
    assert drone.stored["ring.effect"] == b"\7"
