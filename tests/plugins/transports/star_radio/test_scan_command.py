"""``star scan``: which drones answer, over UDP in real time."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from star_core import InputError
from star_core.testing import scene
from star_fleet.parameters import PARAMETERS
from star_fleet.server import Fleet
from star_radio import scan_command
from tests.commands import command
from tests.plugins.transports.star_radio.conftest import UNSERVED, received
from tests.simulators import ideal_fleet

run = command("scan")

PARAMETER, WRITE = 2, 2  # port and channel
STEERING = {(7, 0), (8, 0), (9, 1), (13, 0)}  # setpoints, commands, arming


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        with ideal_fleet(scene(2), noise=False) as fleet:
            yield fleet


def test_drones_that_answer_are_listed_and_left_alone(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    packets = received(fleet, monkeypatch)
    assert run([*fleet.addresses, UNSERVED]) == 1
    heading, first, second, note, absent = capsys.readouterr().out.splitlines()
    assert heading.split() == [*scan_command.COLUMNS]
    assert first.split()[0] == fleet.addresses[0]
    assert "STAR simulation  4.1" in first
    assert "Flow2, ZRanger2  100 %" in first
    assert second.endswith("(0.00 0.00 0.00 m, 0°)")
    assert note.startswith("(position): from where")
    assert absent.startswith(f"{UNSERVED}  does not answer: no answer about")
    used = {(port, channel) for port, channel, _payload in packets}
    assert not used & {(PARAMETER, WRITE), *STEERING}


def test_agents_are_written_as_a_swarm(
    fleet: Fleet, missions: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    links = zip(("cf1", "cf2", "cf3"), [*fleet.addresses, fleet.addresses[0]], strict=True)
    changes = [f"--set=swarm.{name}.uri={uri}" for name, uri in links]
    file = tmp_path / "swarm.yaml"
    mission = str(missions / "first_flight.yaml")
    assert run([mission, *changes, "--json", "--write", str(file)]) == 0
    drones = json.loads(capsys.readouterr().out)["drones"]
    assert [drone["name"] for drone in drones] == ["cf1", "cf2"]
    assert drones[0]["decks"] == ["Flow2", "ZRanger2"]
    assert drones[0]["self_test"]
    assert drones[0]["link_quality_percent"] > 70
    assert 4.0 < drones[0]["battery_v"] < 4.2
    swarm = YAML(typ="safe").load(file)["swarm"]
    assert swarm["cf2"] == {"start": [0.0, 0.0, 0.0], "yaw_deg": 0, "uri": fleet.addresses[1]}
    with pytest.raises(InputError) as raised:
        run([fleet.addresses[0], "--write", str(file)])
    assert raised.value.code == "unwritable-file"


def test_leds_of_a_drone_blink_and_are_released(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    packets = received(fleet, monkeypatch)
    monkeypatch.setattr(scan_command, "BLINK_PERIOD", 0.01)
    assert run([fleet.addresses[0], "--blink", fleet.addresses[0]]) == 0
    number = [parameter.name for parameter in PARAMETERS].index("led.bitmask")
    values = [
        payload[2]
        for port, channel, payload in packets
        if (port, channel) == (PARAMETER, WRITE) and payload[0] == number
    ]
    assert values == [0xBF, 0x80] * scan_command.BLINKS + [0]


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["radio://0/300/2M"], "invalid-address"),
        ([UNSERVED, "--blink", "cf1"], "unknown-agent"),
        (["missions/first_flight.yaml"], "missing-option"),
    ],
)
def test_scans_of_bad_input_are_refused(arguments: list[str], code: str) -> None:
    with pytest.raises(InputError) as raised:
        run(arguments)
    assert raised.value.code == code


def test_a_search_without_a_dongle_finds_no_drone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scan_command, "radio_links", lambda _addresses: iter(()))
    assert run([]) == 1
