"""The transport with a guardian in a process of its own, against simulated Crazyflies over UDP."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import star_radio
from star_core import Order, PluginError, Setpoint
from star_core.testing import scene
from star_fleet.link_faults import LinkFaults
from star_fleet.server import Fleet
from star_radio.guarded import GuardedRadio
from star_radio.takeoffs import ATTEMPTS, REPLY_TIME, WRITE_TIMEOUT
from tests.end_to_end.virtual_air import ON_FLOOR
from tests.plugins.transports.star_radio.conftest import UNSERVED, command, options, reached
from tests.simulators import ideal_fleet

PATIENCE = 60.0  # s, on a busy machine
PERIOD = 0.05  # s


class Flight:
    """Two drones behind a guardian."""

    def __init__(self, folder: Path, fleet: Fleet) -> None:
        self.fleet = fleet
        room = dataclasses.replace(reached(fleet.addresses), period=PERIOD)
        made = star_radio.make(room, **options(cache=str(folder), guardian=True))
        assert isinstance(made, GuardedRadio)
        self.radio = made
        self.now = 0.0

    def tick(self) -> None:
        still = Setpoint(np.zeros((2, 3)), np.zeros(2), np.ones(2, np.bool_))
        self.now = self.radio.wait(self.now + PERIOD)
        self.radio.receive()
        self.radio.send(still)

    def climb(self, height: float) -> None:
        """Connect, and take off until the drones are at a height, m."""
        self.radio.connect()
        self.radio.wait(0.0)
        self.radio.command(command(Order.TAKEOFF, [0, 1], (0.0, 0.0, 0.4)))
        end = time.monotonic() + PATIENCE
        while (self.height < height).any() and time.monotonic() < end:
            self.now = self.radio.wait(self.now + PERIOD)

    def take_off(self) -> None:
        """Fly, by setpoints in the end."""
        self.climb(0.3)
        for _ in range(5):
            self.tick()

    def has_landed(self) -> bool:
        """Wait until the drones are down; return whether they are, and none is locked."""
        end = time.monotonic() + PATIENCE
        while (self.height > ON_FLOOR).any() and time.monotonic() < end:
            time.sleep(0.01)
        return bool((self.height <= ON_FLOOR).all()) and not self.drones["locked"].any()

    @property
    def drones(self) -> np.ndarray:
        return self.fleet.simulator.drones

    @property
    def height(self) -> np.ndarray:
        height: np.ndarray = self.drones["position"][:, 2].copy()
        return height


@pytest.fixture
def flight(tmp_path: Path) -> Iterator[Flight]:
    with ideal_fleet(scene(2), noise=False) as fleet:
        flight = Flight(tmp_path, fleet)
        with closing(flight.radio):
            yield flight


def test_guardian_lands_agents_of_a_killed_flight(flight: Flight, tmp_path: Path) -> None:
    flight.take_off()
    flight.radio.record_in(tmp_path)
    flight.radio._connection.close()  # as when the process is killed
    flight.radio._process.wait(PATIENCE)
    assert flight.has_landed()
    lines = (tmp_path / "guardian.log").read_text().splitlines()
    assert lines[0].endswith("the flight has ended without closing its links: landing cf1, cf2")


@pytest.mark.extended
def test_the_flight_lands_its_agents_if_the_guardian_is_killed(flight: Flight) -> None:
    flight.take_off()
    flight.radio._process.kill()
    flight.radio._process.wait(PATIENCE)
    with pytest.raises(PluginError, match=r"guardian process has ended: landing cf1, cf2 .*failed"):
        flight.tick()
    assert flight.has_landed()
    with pytest.raises(PluginError, match=r"^the guardian process has ended \[link-failed\]$"):
        flight.tick()


def lose_in_take_off(flight: Flight, *rows: int) -> None:
    """Cut the links of some drones while both climb, and close."""
    flight.climb(0.1)
    for row in rows:
        flight.fleet.links.faults[row] = LinkFaults(loss=1.0)
    while flight.radio.receive().age[rows[0]] < 0.6:
        flight.now = flight.radio.wait(flight.now + PERIOD)
    flight.radio.close()


@pytest.mark.extended
@pytest.mark.parametrize(
    ("patience", "says"),
    [
        (PATIENCE, "star: the guardian has landed cf1, cf2"),
        (0.0, "the guardian goes on landing cf1, cf2"),
    ],
)
def test_guardian_lands_drones_heard_again_after_the_flight(
    flight: Flight,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    patience: float,
    says: str,
) -> None:
    monkeypatch.setattr("star_radio.guarded.UNATTENDED_TIME", patience)
    lose_in_take_off(flight, 0, 1)
    assert (flight.height > 0.2).all()
    assert flight.radio._process.poll() is None
    flight.fleet.links.faults[:] = [LinkFaults()] * 2
    flight.radio.await_landings()
    assert flight.has_landed()
    assert flight.radio._process.wait(PATIENCE) == 0
    assert says in capfd.readouterr().err


@pytest.mark.extended
def test_ctrl_c_gives_up_a_drone_that_is_not_heard(
    flight: Flight, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    lose_in_take_off(flight, 1)
    assert flight.height[0] <= ON_FLOOR
    monkeypatch.setattr(flight.radio, "_connection", Interrupted(flight.radio._connection))
    with pytest.raises(KeyboardInterrupt):
        flight.radio.await_landings()
    assert flight.radio._process.wait(PATIENCE) == 0
    assert flight.height[1] > 0.2
    assert "star: given up, may be in the air: cf2" in capfd.readouterr().err


class Interrupted:
    """A connection whose reader presses Ctrl-C."""

    def __init__(self, connection: Any) -> None:
        self.close = connection.close

    def poll(self, _timeout: float) -> bool:
        raise KeyboardInterrupt


def test_what_keeps_the_links_from_opening_is_reported(tmp_path: Path) -> None:
    how = options(cache=str(tmp_path), guardian=True, response_timeout=0.2)
    radio = star_radio.make(reached([UNSERVED]), **how)
    with closing(radio), pytest.raises(PluginError, match="cannot reach 1 of 1 agents") as raised:
        radio.connect()
    assert raised.value.code == "agents-unreachable"


def test_drones_that_may_start_late_count_as_in_the_air(flight: Flight) -> None:
    flight.radio.connect()
    flight.radio.wait(0.0)
    assert flight.radio._airborne() == []
    flight.radio._taken_off[1] = time.monotonic() - WRITE_TIMEOUT - ATTEMPTS * REPLY_TIME
    assert [drone.name for drone in flight.radio._airborne()] == ["cf2"]
