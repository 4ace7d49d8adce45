"""``star land``: drones that no program flies any more, over UDP in real time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import star_radio
from star_core import InputError, Order
from star_core.testing import scene
from star_fleet.server import Fleet
from star_radio.transport import Radio
from tests.commands import command
from tests.end_to_end.virtual_air import ON_FLOOR
from tests.plugins.transports.star_radio.conftest import (
    UNSERVED,
    options,
    reached,
    received,
    report_unknown_heights,
)
from tests.plugins.transports.star_radio.conftest import command as order
from tests.simulators import ideal_fleet

run = command("land")

PATIENCE = 60.0  # s, on a busy machine
HIGH_LEVEL, SET_GROUPS, LAND = 8, 0, 8
PARAMETER, PLATFORM, SUPERVISOR, SETPOINT = 2, 13, 9, 7
WRITE = 2  # channel of the port PARAMETER


@pytest.fixture
def fleet(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Fleet]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with ideal_fleet(scene(2), noise=False) as fleet:
        yield fleet


def abandon(fleet: Fleet, folder: Path, rows: list[int]) -> None:
    """Take off, and disappear in the climb, as when all programs are killed."""
    radio = star_radio.make(reached(fleet.addresses), **options(cache=str(folder)))
    assert isinstance(radio, Radio)
    radio.connect()
    radio.wait(0.0)
    radio.command(order(Order.TAKEOFF, rows, (0.0, 0.0, 0.4)))
    end = time.monotonic() + PATIENCE
    while (fleet.simulator.drones["position"][rows, 2] < 0.1).any() and time.monotonic() < end:
        radio.wait(0.0)
    for vehicle in radio.vehicles:
        vehicle.link.close()


def test_drones_that_were_abandoned_in_their_take_off_are_landed(
    fleet: Fleet,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    abandon(fleet, tmp_path, [0])
    time.sleep(1.2)  # it hovers, and its firmware has deleted the reports
    assert fleet.simulator.drones["position"][0, 2] > 0.3
    packets = received(fleet, monkeypatch)
    assert run(fleet.addresses) == 0
    assert (fleet.simulator.drones["position"][:, 2] < ON_FLOOR).all()
    assert not fleet.simulator.drones["locked"].any()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"{fleet.addresses[0]}  landed, was flying at 0.")
    assert lines[1] == f"{fleet.addresses[1]}  on the floor"
    commands = {payload[0] for port, _channel, payload in packets if port == HIGH_LEVEL}
    assert commands == {LAND}  # and no groups
    assert not {(port, channel) for port, channel, _ in packets} & {
        (PARAMETER, WRITE), (SUPERVISOR, 1), (PLATFORM, 0), (SETPOINT, 0),
    }  # fmt: skip


def test_a_drone_of_unknown_height_is_landed_once(
    fleet: Fleet,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    abandon(fleet, tmp_path, [0])
    report_unknown_heights(monkeypatch)
    assert run([*fleet.addresses, "--timeout", "20"]) == 0
    assert (fleet.simulator.drones["mode"] == 0).all()
    line = f"{fleet.addresses[0]}  landed, was flying at an unknown height"
    assert capsys.readouterr().out.splitlines()[0] == line


def test_a_drone_that_is_not_reached_is_named(
    fleet: Fleet, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([fleet.addresses[0], UNSERVED, "--timeout", "4"]) == 1
    first, second = capsys.readouterr().out.splitlines()
    assert first == f"{fleet.addresses[0]}  on the floor"
    assert second.startswith(f"{UNSERVED}  not reached: no answer about ")


def test_the_links_of_a_mission_are_those_of_its_agents(
    fleet: Fleet, missions: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    links = zip(("cf1", "cf2", "cf3"), [*fleet.addresses, fleet.addresses[0]], strict=True)
    changes = [f"--set=swarm.{name}.uri={uri}" for name, uri in links]
    mission = str(missions / "first_flight.yaml")
    assert run([mission, *changes, fleet.addresses[1]]) == 0
    assert capsys.readouterr().out.splitlines() == ["cf1  on the floor", "cf2  on the floor"]
    with pytest.raises(InputError) as raised:
        run([mission])
    assert raised.value.code == "missing-option"


def test_an_address_that_is_none_is_refused() -> None:
    with pytest.raises(InputError) as raised:
        run(["radio://0/300/2M"])
    assert raised.value.code == "invalid-address"
