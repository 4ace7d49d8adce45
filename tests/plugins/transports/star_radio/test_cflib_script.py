"""Which drone of a fleet a radio address of a script for cflib belongs to."""

from __future__ import annotations

import pytest

from star_radio.cflib_script import Drone, Drones, address

FLEET = [
    Drone("cf1", "", "E7E7E7E701", "udp://127.0.0.1:1"),
    Drone("cf2", "radio://0/60/2M/E7E7E7E710", "E7E7E7E710", "udp://127.0.0.1:2"),
    Drone("cf3", "", "E7E7E7E703", "udp://127.0.0.1:3"),
]


def test_an_address_is_that_of_the_mission_then_of_the_radio_then_the_next() -> None:
    drones = Drones(FLEET)
    names = [
        drones.drone(uri).name
        for uri in (
            "radio://0/80/2M/E7E7E7E703",
            "radio://0/60/2M/E7E7E7E710?rate_limit=100",
            "radio://0/80/2M",
            "radio://0/80/2M/E7E7E7E703",
        )
    ]
    assert names == ["cf3", "cf2", "cf1", "cf3"]
    with pytest.raises(ConnectionError, match="usb://0: all 3 drones"):
        drones.drone("usb://0")


def test_one_address_on_two_channels_is_two_drones() -> None:
    drones = Drones(FLEET)
    uris = ("radio://0/70/2M/E7E7E7E701", "radio://0/94/2M/E7E7E7E701")
    assert [drones.drone(uri).name for uri in uris] == ["cf1", "cf2"]


def test_short_addresses_are_padded() -> None:
    assert address("radio://0/80/250K/1") == "0000000001"
    assert address("radio://0/80/250K") == "E7E7E7E7E7"
    assert address("usb://0") == ""
