"""Flying: reports in, orders and setpoints out, and what is done about those that are not heard."""

from __future__ import annotations

import math
import struct
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from star_core import (
    Array,
    ContractError,
    Corrections,
    Order,
    PluginError,
    Setpoint,
    Supervisor,
)
from star_core.toolkit import Refusal
from star_radio import orders
from star_radio.transport import Radio
from tests.plugins.transports.star_radio.conftest import TICK, UNSERVED, Open, Peers, command, ticks
from tests.plugins.transports.star_radio.peer import Peer

PLACE = (1.0, 2.0, 0.8)  # m


def refusals(radio: Radio, n: int) -> list[Refusal]:
    """Let ticks pass; return what was refused."""
    return [refusal for telemetry in ticks(radio, n) for refusal in telemetry.refusals]


def flown(velocity: Array, yaw: float = 0.0) -> Setpoint:
    n = len(velocity)
    return Setpoint(velocity, np.full(n, yaw), np.ones(n, np.bool_))


def velocity_of(payload: bytes) -> tuple[float, ...]:
    kind, *values = struct.unpack("<Bffff", payload)
    assert kind == 8
    return tuple(values)


def test_telemetry_is_in_si_and_right_handed(drone: Peer, connect: Open) -> None:
    drone.values |= {
        "stateEstimateZ.x": 1000, "stateEstimateZ.y": -500, "stateEstimateZ.z": 800,
        "stateEstimateZ.vx": 100, "stateEstimateZ.vy": 200, "stateEstimateZ.vz": -50,
        "stateEstimate.roll": 10.0, "stateEstimate.pitch": 5.0, "stateEstimate.yaw": 90.0,
        "stateEstimateZ.rateYaw": 250, "pm.vbatMV": 3712, "supervisor.info": 0x11F,
        "radio.rssi": 61,
    }  # fmt: skip
    radio = connect([drone])
    telemetry = radio.receive()
    assert np.allclose(telemetry.position, [[1, -0.5, 0.8]])
    assert np.allclose(telemetry.velocity, [[0.1, 0.2, -0.05]])
    assert np.allclose(telemetry.battery, [3.712])
    assert telemetry.state.tolist() == [0x11F]
    assert telemetry.signal is not None
    assert telemetry.signal.tolist() == [-61.0]
    x, y, z, w = telemetry.attitude[0]
    nose = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])
    up = math.sin(math.radians(5.0))  # the firmware's pitch is nose up positive
    assert np.allclose(nose, [0, math.cos(math.radians(5.0)), up], atol=1e-3)
    odometry = ticks(radio, 3)[-1].odometry
    assert len(odometry.agent) >= 2
    assert np.allclose(odometry.velocity, [0.2, -0.1, -0.05])  # it looks along y
    assert np.allclose(odometry.yaw_rate, 0.25)
    assert np.allclose(odometry.roll, math.radians(10), atol=1e-4)
    assert np.allclose(odometry.pitch, -math.radians(5), atol=1e-4)
    assert np.allclose(odometry.height, 0.8)


def test_firmware_without_the_compressed_state_reports_the_same(
    peers: Peers, connect: Open
) -> None:
    [drone] = peers(lacks=tuple(f"stateEstimateZ.{name}" for name in ("x", "vy", "rateYaw")))
    drone.values |= {"stateEstimate.x": 1.5, "stateEstimate.vy": 0.25, "gyro.z": 90.0}
    telemetry = ticks(connect([drone]), 3)[-1]
    assert telemetry.position[0, 0] == 1.5
    assert telemetry.velocity[0, 1] == 0.25
    assert np.allclose(telemetry.odometry.yaw_rate, math.pi / 2)


def test_firmware_without_rssi_reports_everything_else(peers: Peers, connect: Open) -> None:
    telemetry = connect(peers(lacks=("radio.rssi",))).receive()
    assert telemetry.signal is not None
    assert np.isnan(telemetry.signal).all()
    assert np.allclose(telemetry.battery, [4.0])


def test_samples_have_the_mission_time_they_were_taken_at(peers: Peers, connect: Open) -> None:
    drones = peers(2)
    drones[1].boot = 1000.0
    radio = connect(drones)
    ticks(radio, 1)
    now = radio.wait(8 * TICK)
    telemetry = radio.receive()
    for row in range(2):
        mine = telemetry.odometry.time[telemetry.odometry.agent == row]
        assert len(mine) > 5
        assert (np.diff(mine) > 0).all()
        assert 0 <= mine[0] < mine[-1] <= now
        assert mine[-1] > now - 0.3
    assert telemetry.time == telemetry.odometry.time.max()


@pytest.mark.usefixtures("virtual_clock")
def test_time_is_that_of_the_clock_and_starts_at_the_first_tick(make: Open) -> None:
    radio = make([UNSERVED])
    time.sleep(0.05)
    assert radio.wait(0.0) < 0.04
    begun = time.monotonic()
    assert radio.wait(0.1) == pytest.approx(0.1, abs=0.002)
    assert time.monotonic() - begun > 0.05


@pytest.mark.usefixtures("virtual_clock")
def test_a_tick_that_is_late_does_not_wait(make: Open) -> None:
    radio = make([UNSERVED])
    radio.wait(0.0)
    time.sleep(0.1)
    begun = time.monotonic()
    assert radio.wait(0.05) == pytest.approx(0.1, abs=0.002)
    assert time.monotonic() - begun < 0.05


def test_a_drone_is_polled_while_nothing_is_sent(drone: Peer, connect: Open) -> None:
    connect([drone])
    assert drone.until(lambda: drone.echoes >= 2)


def test_a_drone_that_falls_silent_ages(peers: Peers, connect: Open) -> None:
    drones = peers(2)
    radio = connect(drones)
    ticks(radio, 2)
    drones[0].mute.set()
    age = ticks(radio, 12)[-1].age
    assert age[0] > 0.4
    assert age[1] < 0.3


def test_a_drone_that_is_gone_stops_no_other(peers: Peers, connect: Open) -> None:
    gone, other = peers(2)
    radio = connect([gone, other])
    ticks(radio, 1)
    gone.mute.set()
    for _ in range(7):
        ticks(radio, 2)
        radio.send(flown(np.zeros((2, 3))))
    radio.command(command(Order.LAND, [0, 1]))
    ticks(radio, 6)
    assert other.until(lambda: len(other.sent_to(7, 0)) == 7 and bool(other.ordered))
    assert radio.receive().age[1] < 0.3


def test_setpoints_go_to_the_active_rows_only(peers: Peers, connect: Open) -> None:
    drones = peers(2)
    radio = connect(drones)
    radio.receive()
    setpoint = Setpoint(
        np.array([[0.1, 0.2, 0.3], [1, 1, 1]]), np.zeros(2), np.array([True, False])
    )
    sent = radio.send(setpoint)
    assert drones[0].until(lambda: bool(drones[0].sent_to(7, 0)))
    assert np.allclose(velocity_of(drones[0].sent_to(7, 0)[0]), (0.1, 0.2, 0.3, 0))
    assert drones[1].sent_to(7, 0) == []
    assert sent.active.tolist() == [True, False]
    assert (sent.velocity == setpoint.velocity).all()


@pytest.mark.parametrize(("yaw", "rate"), [(0.1, 0.3), (-0.1, -0.3), (3.0, 2.0), (-3.0, -2.0)])
def test_a_heading_is_turned_to(drone: Peer, radio: Radio, yaw: float, rate: float) -> None:
    radio.receive()
    radio.send(flown(np.zeros((1, 3)), yaw))
    assert drone.until(lambda: bool(drone.sent_to(7, 0)))
    assert velocity_of(drone.sent_to(7, 0)[0])[3] == pytest.approx(math.degrees(rate), rel=1e-3)


def test_a_setpoint_that_is_not_finite_is_refused(radio: Radio) -> None:
    with pytest.raises(ContractError, match="the setpoint of cf1 is not finite"):
        radio.send(flown(np.full((1, 3), np.nan)))


def test_an_absent_agent_is_sent_nothing(drone: Peer, make: Open) -> None:
    radio = make([UNSERVED, drone.uri], absent="fly-without")
    radio.connect()
    assert radio.send(flown(np.zeros((2, 3)))).active.tolist() == [False, True]
    radio.command(command(Order.TAKEOFF, [0, 1]))
    ticks(radio, 6)
    assert drone.until(lambda: bool(drone.ordered))


def test_orders_follow_the_last_setpoint_and_end_setpoints(drone: Peer, radio: Radio) -> None:
    radio.receive()
    before = len(drone.got)
    radio.send(flown(np.zeros((1, 3))))
    radio.command(command(Order.LAND))
    assert drone.until(lambda: bool(drone.sent_to(7, 0)))
    assert drone.ordered == []  # a setpoint that is late would cancel it
    ticks(radio, 6)
    assert drone.until(lambda: len(drone.got) >= before + 3)
    assert [packet[0] for packet in drone.got[before : before + 3]] == [0x70, 0x80, 0x71]


def test_setpoints_are_not_ended_while_an_order_is_not_answered(drone: Peer, radio: Radio) -> None:
    drone.lose[b"\x80\x08"] = 2
    before = len(drone.got)
    radio.command(command(Order.LAND))
    ticks(radio, 12)
    assert [packet[0] for packet in drone.got[before : before + 4]] == [0x80, 0x80, 0x80, 0x71]


def test_a_stop_waits_for_nothing(drone: Peer, radio: Radio) -> None:
    drone.lose[b"\x80\x03"] = 100
    before = len(drone.got)
    radio.send(flown(np.zeros((1, 3))))
    radio.command(command(Order.STOP))
    assert drone.until(lambda: len(drone.got) >= before + 3)
    assert [packet[0] for packet in drone.got[before : before + 3]] == [0x70, 0x80, 0x71]


def test_a_drone_is_armed_before_it_takes_off(drone: Peer, radio: Radio) -> None:
    before = len(drone.got)
    radio.command(command(Order.TAKEOFF, position=PLACE))
    assert drone.until(lambda: len(drone.got) >= before + 3)
    takeoff = orders.only_for(orders.MISSION, orders.takeoff(PLACE[2], 1.0))
    assert drone.got[before : before + 3] == [
        b"\x91\1\1", b"\x80" + takeoff[1:], b"\x71" + bytes(5)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("order", "packet"),
    [
        (Order.GOTO, orders.only_for(orders.MISSION, orders.go_to(PLACE, 0.5, 2.0, 12))),
        (Order.LAND, orders.only_for(orders.MISSION, orders.land(PLACE[2], 2.0))),
        (Order.STOP, orders.stop()),
    ],
)
def test_orders_are_addressed_to_the_group_of_the_drone(
    drone: Peer, connect: Open, order: Order, packet: bytes
) -> None:
    connect([drone]).command(command(order, position=PLACE, yaw=0.5, duration=2.0))
    assert drone.sent_to(8, 0)[0] == orders.set_groups(orders.MISSION)[1:]
    assert drone.until(lambda: drone.ordered == [packet[1:]])


def test_arming_is_an_order_of_its_own(drone: Peer, connect: Open) -> None:
    connect([drone]).command(command(Order.ARM))
    assert drone.until(lambda: drone.sent_to(9, 1) == [b"\1\1"])


def test_an_order_is_given_again_while_the_supervisor_blocks_it(
    drone: Peer, connect: Open, caplog: pytest.LogCaptureFixture
) -> None:
    drone.errors[7] = [16, 16]
    radio = connect([drone])
    radio.command(command(Order.TAKEOFF))
    ticks(radio, 16)
    assert len(drone.ordered) == 3
    assert caplog.text == ""


def test_a_newer_order_replaces_one_that_is_not_confirmed(drone: Peer, radio: Radio) -> None:
    drone.lose[b"\x80\7"] = 100
    radio.command(command(Order.TAKEOFF))
    radio.command(command(Order.LAND))
    ticks(radio, 12)
    assert [payload[0] for payload in drone.ordered] == [7, 8]


def test_the_answer_to_an_order_that_was_replaced_is_dropped(drone: Peer, radio: Radio) -> None:
    drone.errors[8] = [5]
    vehicle = radio.vehicles[0]
    vehicle.land()
    assert drone.until(lambda: drone.ordered)
    vehicle.land()
    assert vehicle.retry(time.monotonic()) == []


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize(
    ("error", "words"),
    [(8, "it does not know it"), (16, "its supervisor blocks it"), (5, "error 5")],
)
def test_an_order_that_is_refused_is_reported(
    drone: Peer, connect: Open, caplog: pytest.LogCaptureFixture, error: int, words: str
) -> None:
    drone.errors[8] = [error] * 100
    radio = connect([drone])
    radio.command(command(Order.LAND))
    assert refusals(radio, 14) == [(0, f"refuses the order to land: {words}")]
    assert f"radio: cf1 refuses the order to land: {words}" in caplog.text


def test_a_take_off_whose_answer_got_lost_is_not_refused(
    drone: Peer, connect: Open, caplog: pytest.LogCaptureFixture
) -> None:
    drone.lose[b"\x80\7"] = 1
    drone.errors[7] = [0, 1]  # told again, it says that a plan is in the way
    radio = connect([drone])
    radio.command(command(Order.TAKEOFF))
    assert refusals(radio, 12) == []
    assert len(drone.ordered) == 2
    assert caplog.text == ""


@pytest.mark.parametrize("errors", [[1], [16, 1]])
def test_a_take_off_that_a_plan_is_in_the_way_of_is_refused(
    drone: Peer, connect: Open, errors: list[int]
) -> None:
    drone.errors[7] = [*errors]
    radio = connect([drone])
    radio.command(command(Order.TAKEOFF))
    assert refusals(radio, 12) == [(0, "refuses the order to take off: error 1")]


@pytest.mark.usefixtures("soon")
def test_an_order_that_is_never_confirmed_is_reported(
    drone: Peer, radio: Radio, caplog: pytest.LogCaptureFixture
) -> None:
    drone.mute.set()
    radio.command(command(Order.GOTO))
    assert refusals(radio, 14) == []
    assert "radio: cf1 does not confirm the order to go to a position" in caplog.text


@pytest.mark.parametrize(("stop", "locks"), [("lock", [b"\3"] * 3), ("motors", [])])
def test_a_stop_can_lock(drone: Peer, connect: Open, stop: str, locks: list[bytes]) -> None:
    connect([drone], stop=stop).command(command(Order.STOP))
    assert drone.until(lambda: bool(drone.ordered))
    assert drone.sent_to(9, 1) == locks


def test_the_watchdog_is_fed(drone: Peer, connect: Open) -> None:
    radio = connect([drone], watchdog=True)
    ticks(radio, 12)
    assert drone.sent_to(9, 1)[:2] == [b"\4", b"\4"]


def corrections(position: float, attitude: float) -> Corrections:
    return Corrections(
        agent=np.zeros(1, np.int64),
        position=np.array([[1.0, 2.0, 3.0]]),
        attitude=np.array([[0.0, 0.0, 0.0, 1.0]]),
        position_deviation=np.array([position]),
        attitude_deviation=np.array([attitude]),
    )


def test_corrections_follow_their_standard_deviations(drone: Peer, radio: Radio) -> None:
    before = len(drone.got)
    radio.correct(corrections(0.05, 0.1))
    assert drone.until(lambda: bool(drone.sent_to(6, 1)))
    assert [packet[0] for packet in drone.got[before:]] == [0x22, 0x22, 0x61]
    assert drone.stored["locSrv.extPosStdDev"] == struct.pack("<f", 0.05)
    assert drone.stored["locSrv.extQuatStdDev"] == struct.pack("<f", 0.1)
    assert drone.sent_to(6, 1) == [orders.measured_pose((1, 2, 3), (0, 0, 0, 1))[1:]]


def test_a_position_alone_is_reported_without_an_attitude(drone: Peer, radio: Radio) -> None:
    before = len(drone.got)
    radio.correct(corrections(0.05, math.inf))
    assert drone.until(lambda: bool(drone.sent_to(6, 0)))
    assert [packet[0] for packet in drone.got[before:]] == [0x22, 0x60]
    assert drone.stored["locSrv.extQuatStdDev"] == struct.pack("<f", 4.5e-3)
    assert drone.sent_to(6, 0) == [orders.measured_position((1, 2, 3))[1:]]


def test_deviations_are_sent_when_they_change(drone: Peer, radio: Radio) -> None:
    before = len(drone.sent_to(2, 2))
    for deviation in (0.05, 0.052, 0.0548, 0.06):
        radio.correct(corrections(deviation, 0.1))
    assert drone.until(lambda: len(drone.sent_to(6, 1)) == 4)
    assert len(drone.sent_to(2, 2)) - before == 3  # two at first, one change beyond 10 %


@pytest.mark.usefixtures("soon")
def test_a_deviation_that_was_given_up_is_reported_anew(drone: Peer, radio: Radio) -> None:
    drone.lose[b"\x22\1\0"] = 10
    before = len(drone.sent_to(2, 2))
    radio.correct(corrections(0.05, 0.1))
    ticks(radio, 14)
    assert len(drone.sent_to(2, 2)) - before == 11
    radio.correct(corrections(0.05, 0.1))
    assert drone.until(lambda: len(drone.sent_to(2, 2)) - before == 12)
    ticks(radio, 2)
    radio.correct(corrections(0.05, 0.1))
    ticks(radio, 2)
    assert len(drone.sent_to(2, 2)) - before == 12


@pytest.mark.usefixtures("soon")
def test_deviations_given_up_repeatedly_are_reported_once(
    drone: Peer, radio: Radio, caplog: pytest.LogCaptureFixture
) -> None:
    drone.lose[b"\x22\1\0"] = 21
    for _ in range(3):
        radio.correct(corrections(0.05, 0.1))
        ticks(radio, 13)
    said = "radio: cf1 does not confirm parameter 'locSrv.extPosStdDev'"
    assert caplog.messages == [said]
    assert drone.stored["locSrv.extPosStdDev"] == struct.pack("<f", 0.05)


def test_firmware_that_cannot_receive_deviations_is_named(peers: Peers, connect: Open) -> None:
    radio = connect(peers(lacks=("locSrv.extPosStdDev",)))
    with pytest.raises(PluginError, match=r"cf1: its firmware has no parameter 'locSrv.extPosStdD"):
        radio.correct(corrections(0.1, 0.1))


def test_reports_that_are_none_are_passed_over(drone: Peer, radio: Radio) -> None:
    for junk in (b"\x52", b"\x52\1\2", b"\x52\2" + bytes(28), b"\x00hello", b"\xff", b"\x81"):
        drone.say(junk)
    assert any(len(telemetry.odometry.agent) for telemetry in ticks(radio, 3))


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(noise=st.lists(st.binary(min_size=1, max_size=40), min_size=20, max_size=60))
def test_no_datagram_breaks_a_link(drone: Peer, noise: list[bytes], connect: Open) -> None:
    radio = connect([drone], reset=False)
    for datagram in noise:
        drone.say(datagram)
    drone.values["stateEstimateZ.x"] = 1234
    assert drone.until(lambda: radio.receive().position[0, 0] == 1.234)
    radio.close()


def test_a_late_reader_keeps_the_newest_reports(drone: Peer, radio: Radio) -> None:
    drone.until(lambda: False, timeout=0.1)
    for i in range(1500):
        drone.values["stateEstimateZ.x"] = i
        drone.report(time.monotonic())
    drone.mute.set()
    time.sleep(0.3)
    telemetry = radio.receive()
    assert telemetry.position[0, 0] == pytest.approx(1.499)


@pytest.mark.parametrize(
    ("state", "z", "told"),
    [
        (Supervisor.FLYING | Supervisor.COMMANDER_ACTIVE, 0.02, True),  # it takes off
        (Supervisor.FLYING | Supervisor.COMMANDER_FINISHED, 0.8, True),  # it hovers
        (Supervisor.FLYING | Supervisor.COMMANDER_FINISHED, 0.02, False),  # it has just landed
        (Supervisor.CAN_FLY, 0.8, False),  # it stands on a table
    ],
)
def test_agents_flying_by_themselves_at_the_end_are_landed(
    state: Supervisor,
    z: float,
    told: bool,  # noqa: FBT001
    peers: Peers,
    connect: Open,
) -> None:
    [drone] = peers()
    drone.values |= {"supervisor.info": int(state), "stateEstimateZ.z": 1000 * z}
    connect([drone]).close()
    landings = [payload for payload in drone.sent_to(8, 0) if payload[0] == orders.land(0, 3)[1]]
    assert bool(landings) is told


def test_of_many_drones_in_the_air_ten_are_named(make: Open) -> None:
    radio = make([f"udp://127.0.0.1:{port}" for port in range(1, 13)])
    text = radio.describe(range(12))
    assert text.startswith("cf1 it was never heard; cf2 ")
    assert text.endswith("cf10 it was never heard and 2 more")
    assert "cf11" not in text
