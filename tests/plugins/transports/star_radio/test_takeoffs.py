"""Take-offs and trajectories on board that come down by themselves: what is uploaded and flown."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from star_core import Command, Order, Telemetry
from star_fleet.link_faults import LinkFaults
from star_fleet.trajectory import compressed
from star_radio import orders, profiles, trajectories
from star_radio.transport import Radio
from star_sim import pieces
from star_sim.commander import ending_at_rest
from tests.campaign.link_cuts import FOLLOW, PATH
from tests.end_to_end.virtual_air import LINK_LOST, START_TRAJECTORY, TAKEOFF, Air, flown
from tests.plugins.transports.star_radio.conftest import Open, command, ticks
from tests.plugins.transports.star_radio.peer import Peer
from tests.plugins.transports.star_radio.virtual import EPOCH

CUT = LinkFaults(cuts=((0.0, math.inf),))
HOLD = """\
  - takeoff: {height: 0.6}
  - hold: {for: 12}
  - land: {}
"""
TWO = """\
  - parallel:
    - takeoff: {agents: cf1, height: 0.4}
    - takeoff: {agents: cf2, height: 1.4, speed: 0.2}
  - hold: {for: 1}
  - land: {}
"""


class Cut:
    """Cuts the link of the first drone when it is 0.1 m high, for some time, s.

    Attributes:
        heights: Of all drones, m, each cycle of 10 ms.
    """

    def __init__(self, length: float) -> None:
        self._length = length
        self._is_cut = False
        self.heights: list[np.ndarray] = []

    def __call__(self, air: Air, _operator: object) -> None:
        self.heights.append(air.height)
        if not self._is_cut and air.height[0] > 0.1:
            self._is_cut = True
            now = air.fleet.time
            air.links.faults[0] = LinkFaults(cuts=((now, now + self._length),))


def test_takeoff_profiles_climb_hover_and_descend() -> None:
    data = profiles.profile(0.5, 1.0, 2.0)
    assert data is not None
    climb, hover, down = compressed(data, 0) or []
    ones = np.ones(1)
    own = ending_at_rest(0 * ones, 0 * ones, 0 * ones, 0.5 * ones, 2 * ones)[0]
    assert climb.coefficients[2] == pytest.approx(own, abs=1e-9)
    assert climb.coefficients[:2] == pytest.approx(np.zeros((2, 8)))
    assert [climb.duration, hover.duration] == [2.0, 3.0]
    for piece in (climb, hover, down):
        assert piece.at(1.0)[0][3] == pytest.approx(1.0, abs=1e-3)
    assert hover.at(1.0)[0][2] == 0.5
    assert down.at(1.0)[1][2] == pytest.approx(-0.3, abs=1e-3)
    assert down.at(math.inf)[0][2] == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ("rise", "yaw", "duration"),
    [(0.0, 0.0, 2.0), (-0.1, 0.0, 2.0), (40.0, 0.0, 2.0), (0.5, math.nan, 2.0), (0.5, 0.0, 70.0)],
)
def test_what_the_format_cannot_hold_has_no_profile(
    rise: float, yaw: float, duration: float
) -> None:
    assert profiles.profile(rise, yaw, duration) is None


def test_simulated_drones_come_down_as_real_drones_do() -> None:
    assert pieces.HOVER_TIME == trajectories.HOVER_TIME
    assert pieces.DESCENT_SPEED == trajectories.DESCENT_SPEED


@pytest.mark.extended
@pytest.mark.parametrize("length", [math.inf, 9.0])
def test_a_drone_without_a_link_in_its_take_off_comes_down(tmp_path: Path, length: float) -> None:
    flight = flown(tmp_path, n=2, steps=HOLD, changes=[LINK_LOST], watch=Cut(length))
    assert flight.fallen == []
    assert flight.air.impact.max() < 0.4
    motors_on = flight.air.drones["mode"][0] != 0
    assert motors_on == (length == math.inf)  # whatever client returns stops them


@pytest.mark.extended
@pytest.mark.parametrize(
    ("steps", "begins"),
    [
        (HOLD, TAKEOFF),
        (FOLLOW.replace("on_board", "timescale: 1.5, on_board"), START_TRAJECTORY),
    ],
)
def test_when_a_drone_comes_down_by_itself_is_announced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: str, begins: int
) -> None:
    (tmp_path / "path.csv").write_text(PATH)
    times: list[float] = []
    heights: list[float] = []
    announced: list[float] = []
    receive = Radio.receive

    def cut(air: Air, _operator: object) -> None:
        times.append(air.fleet.time)
        heights.append(air.height[0])
        if air.fleet.time >= air.ordered.get(begins, np.inf) + 0.6:
            air.links.faults[0] = CUT

    def record(radio: Radio) -> Telemetry:
        telemetry = receive(radio)
        if telemetry.lands_by is not None and radio.began is not None:
            announced.append(telemetry.lands_by[0] + radio.began - EPOCH)
        return telemetry

    monkeypatch.setattr(Radio, "receive", record)
    flown(tmp_path, n=2, steps=steps, changes=[LINK_LOST], watch=cut)
    down = times[np.flatnonzero(np.array(heights) > 0.02)[-1]]
    assert math.isinf(announced[0])
    assert down <= announced[-1] <= down + (1.5 if begins == TAKEOFF else 12.0)


@pytest.mark.extended
def test_takeoffs_of_any_height_are_taken_over_before_descent(tmp_path: Path) -> None:
    watch = Cut(0.0)
    flight = flown(tmp_path, n=2, steps=TWO, watch=watch)
    assert flight.summary["outcome"] == "completed"
    assert flight.fallen == []
    heights = np.array(watch.heights)
    slow = heights[:, 1]
    assert slow.max() == pytest.approx(1.4, abs=0.15)
    waits = heights[np.argmax(heights[:, 0] > 0.35) : np.argmax(slow > 1.3), 0]
    assert len(waits) > 300  # 3 s
    assert waits.min() > 0.3


def test_lost_packets_start_no_second_climb(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch, airs, order = Cut(0.0), list[Air](), Radio.command

    def look(air: Air, operator: object) -> None:
        airs.append(air)
        watch(air, operator)

    def lose(radio: Radio, command: Command) -> None:
        airs[0].links.faults[:] = [LinkFaults(loss=0.3, delay=0.02, jitter=0.1)] * 3
        order(radio, command)

    monkeypatch.setattr(Radio, "command", lose)
    flight = flown(tmp_path, watch=look)
    assert np.max(watch.heights) < 0.7  # of 0.5 m, with the overshoot of the controller
    assert flight.fallen == []


def take_off(radio: Radio) -> None:
    ticks(radio, 2)
    radio.command(command(Order.TAKEOFF, position=(0.0, 0.0, 0.5), duration=2.0))


def test_a_start_is_repeated_only_while_reports_show_no_effect(drone: Peer, connect: Open) -> None:
    radio = connect([drone], descent=True)
    drone.lose[b"\x80\x0d"] = 2  # answers to a start
    take_off(radio)
    ticks(radio, 20)
    started = [payload for payload in drone.sent_to(8, 0) if payload[0] == 13]
    assert 2 <= len(started) <= 4
    drone.values["supervisor.info"] = 0x10F  # its commander is active
    ticks(radio, 3)
    before = len(drone.sent_to(8, 0))
    drone.mute.set()
    ticks(radio, 20)
    assert len(drone.sent_to(8, 0)) == before


def test_a_drone_that_refuses_a_profile_takes_off_without(drone: Peer, connect: Open) -> None:
    drone.errors[6] = [8]
    radio = connect([drone], descent=True)
    take_off(radio)
    ticks(radio, 2)
    assert drone.ordered[-1] == orders.only_for(1, orders.takeoff(0.5, 2.0))[1:]


def test_a_newer_command_replaces_a_take_off_that_is_not_written(
    drone: Peer, connect: Open
) -> None:
    radio = connect([drone], descent=True)
    drone.lose[b"\x42"] = 100  # answers to writes
    take_off(radio)
    radio.command(command(Order.STOP))
    ticks(radio, 30)
    assert {payload[0] for payload in drone.ordered} == {6, orders.STOP}


def test_a_climb_is_over_after_its_duration(drone: Peer, connect: Open) -> None:
    radio = connect([drone], descent=True)
    take_off(radio)
    ticks(radio, 2)
    drone.values["supervisor.info"] = 0x11F
    finished = [bool(telemetry.state[0] & 0x200) for telemetry in ticks(radio, 60)]
    assert finished == sorted(finished)
    assert 38 <= finished.index(True) <= 44  # 2 s after the first report
