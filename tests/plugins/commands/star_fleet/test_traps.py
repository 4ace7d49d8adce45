"""What bites a client of the firmware bites a client of the simulation."""

from __future__ import annotations

import errno
import math
import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from star_core import Supervisor
from star_fleet.packet import Port
from tests.plugins.commands.star_fleet.conftest import Bench, Start

VELOCITY = ("Bffff", 8, 0.2, 0.0, 0.0, 0.0)


def close_link(bench: Any) -> None:
    """What cflib sends last."""
    bench.ask(Port.ATTITUDE, 0, struct.pack("<fffH", 0.0, 0.0, 0.0, 0))


def test_after_a_disconnect_a_take_off_is_accepted_and_not_flown(bench: Bench) -> None:
    close_link(bench)
    bench.fly(5.0)
    assert bench.takeoff() == 0
    bench.fly(1.0)
    assert Supervisor.COMMANDER_ACTIVE in bench.state()
    assert not bench.turned
    bench.fly(2.0)
    assert bench.position[2] == 0
    bench.let_go()
    bench.command("BB", 3, 0)
    assert bench.takeoff() == 0
    bench.fly(3.0)
    assert bench.position[2] == pytest.approx(0.8, abs=0.02)


def test_commands_under_setpoints_wait_until_setpoints_stop(aloft: Bench) -> None:
    aloft.fly(0.5, *VELOCITY)
    assert aloft.go(0.0, 1.0, 0.8, 0.0, duration=3.0) == 0
    aloft.fly(0.4)
    assert abs(aloft.log("stateEstimate.vy")[0]) < 0.02
    aloft.let_go()
    aloft.fly(5.0)
    assert aloft.position == pytest.approx([0, 1, 0.8], abs=0.03)


def test_an_agent_that_lets_go_with_no_plan_falls(aloft: Bench) -> None:
    aloft.fly(0.5, *VELOCITY)
    aloft.let_go()
    aloft.fly(0.02)
    assert not aloft.turned


def test_a_landing_right_after_letting_go_is_flown(aloft: Bench) -> None:
    aloft.fly(0.5, *VELOCITY)
    aloft.let_go()
    assert aloft.land() == 0
    aloft.fly(0.75)
    assert aloft.turned
    assert 0.2 < aloft.position[2] < 0.7
    aloft.fly(3.5)
    assert aloft.position[2] == pytest.approx(0, abs=0.01)
    assert Supervisor.LOCKED not in aloft.state()


def test_closing_the_link_right_after_landing_locks_the_vehicle(aloft: Bench) -> None:
    aloft.land()
    aloft.fly(1.5 + 0.5)
    close_link(aloft)
    aloft.fly(2.5)
    assert Supervisor.LOCKED in aloft.state()
    assert aloft.takeoff() == errno.EBUSY
    assert b"".join(packet[1:] for packet in aloft.streamed[0] if packet[0] == 0).endswith(
        b"SUP: Locked, reboot required\n"
    )


def test_closing_the_link_two_seconds_after_landing_is_safe(aloft: Bench) -> None:
    aloft.land()
    aloft.fly(1.5 + 2.1)
    assert Supervisor.FLYING not in aloft.state()
    close_link(aloft)
    aloft.fly(3.0)
    assert Supervisor.LOCKED not in aloft.state()


def test_half_a_second_without_setpoints_levels_out(aloft: Bench) -> None:
    aloft.fly(0.6, "Bffff", 9, 10.0, 0.0, 0.0, 0.8)
    aloft.fly(0.4)
    assert aloft.log("stateEstimate.roll")[0] == pytest.approx(10, abs=1)
    aloft.fly(0.5)
    assert aloft.log("stateEstimate.roll")[0] == pytest.approx(0, abs=1)
    assert aloft.log("stateEstimate.z")[0] == pytest.approx(0.8, abs=0.1)
    assert Supervisor.FLYING | Supervisor.CAN_FLY in aloft.state()


def test_setpoints_that_come_again_in_time_are_flown(aloft: Bench) -> None:
    aloft.fly(0.5, *VELOCITY)
    aloft.fly(1.5)
    aloft.fly(2.0, *VELOCITY)
    assert aloft.log("stateEstimate.vx")[0] == pytest.approx(0.2, abs=0.03)
    assert Supervisor.LOCKED not in aloft.state()


def test_two_seconds_without_setpoints_lock_the_vehicle(aloft: Bench) -> None:
    aloft.fly(0.5, *VELOCITY)
    aloft.fly(1.9)
    assert aloft.turned
    aloft.fly(0.2)
    assert not aloft.turned
    assert Supervisor.LOCKED in aloft.state()
    aloft.fly(1.0, *VELOCITY)
    assert not aloft.turned
    aloft.let_go()
    assert aloft.takeoff() == errno.EBUSY


def test_high_level_commander_hovers_without_a_link(aloft: Bench) -> None:
    aloft.fly(20.0)
    assert aloft.position[2] == pytest.approx(0.8, abs=0.02)


def test_a_setpoint_stops_the_plan(aloft: Bench) -> None:
    aloft.fly(0.1, *VELOCITY)
    assert Supervisor.COMMANDER_ACTIVE not in aloft.state()


@pytest.mark.parametrize(
    ("port", "channel", "payload"), [(Port.SUPERVISOR, 1, b"\x03"), (Port.LOCALISATION, 1, b"\x03")]
)
def test_an_emergency_stop_is_not_answered_and_latches(
    aloft: Bench, port: int, channel: int, payload: bytes
) -> None:
    assert aloft.ask(port, channel, payload) == []
    aloft.fly(0.05)
    assert not aloft.turned
    aloft.fly(3.0)
    assert Supervisor.LOCKED in aloft.state()
    assert aloft.ask(Port.SUPERVISOR, 1, b"\x01\x01") == [b"\x81\x00\x00"]
    assert aloft.takeoff() == errno.EBUSY


def test_a_parameter_stops_the_motors_too(aloft: Bench) -> None:
    aloft.write("stabilizer.stop", "B", 1)
    aloft.fly(0.05)
    assert Supervisor.LOCKED in aloft.state()


@pytest.mark.parametrize(
    ("port", "payload"), [(Port.SUPERVISOR, b"\x04"), (Port.LOCALISATION, b"\x04")]
)
def test_watchdog_stops_drones_after_a_second_without_setpoint(
    aloft: Bench, port: int, payload: bytes
) -> None:
    for _ in range(4):
        assert aloft.ask(port, 1, payload) == []
        aloft.fly(0.9)
    assert aloft.turned
    aloft.fly(0.2)
    assert Supervisor.LOCKED in aloft.state()


def full_state(yaw_rate: float) -> bytes:
    """What cflib packs for a hover and this rate: documented as deg/s, sent as mrad/s."""
    commander: Any = pytest.importorskip("cflib.crazyflie.commander")
    sent: list[Any] = []
    client = commander.Commander(SimpleNamespace(send_packet=sent.append))
    zero = (0.0, 0.0, 0.0)
    client.send_full_state_setpoint((0.0, 0.0, 0.8), zero, zero, (0, 0, 0, 1), 0, 0, yaw_rate)
    return bytes(sent[0].data)


def test_full_state_yaw_rates_in_degrees_overflow() -> None:
    assert struct.unpack("<h", full_state(math.radians(45))[-2:]) == (785,)
    with pytest.raises(struct.error):
        full_state(45.0)


def test_a_vehicle_with_brushed_motors_is_armed_by_itself(bench: Bench) -> None:
    flags = Supervisor.ARMED | Supervisor.AUTO_ARM | Supervisor.CAN_FLY
    assert bench.state() == flags
    assert bench.ask(Port.SUPERVISOR, 1, b"\x01\x01") == [b"\x81\x01\x01"]
    assert bench.ask(Port.SUPERVISOR, 0, b"\x02") == [b"\x82\x01"]
    assert bench.ask(Port.SUPERVISOR, 0, b"\x05") == [b"\x85\x00"]


def test_a_vehicle_with_brushless_motors_flies_when_it_is_armed(start: Start) -> None:
    bench = start(arms_itself=False)
    assert bench.state() == Supervisor.CAN_ARM
    assert bench.takeoff() == errno.EBUSY
    assert bench.ask(Port.SUPERVISOR, 1, b"\x01\x01") == [b"\x81\x01\x01"]
    bench.fly(0.1)
    assert bench.takeoff() == 0
    bench.fly(3.0)
    assert bench.position[2] == pytest.approx(0.8, abs=0.02)
    assert bench.ask(Port.PLATFORM, 0, b"\x01\x00") == [b"\x01\x01\x00"]
    bench.fly(0.1)
    assert not bench.turned


def test_idle_agents_are_disarmed_after_half_a_minute(start: Start) -> None:
    bench = start(arms_itself=False)
    bench.ask(Port.SUPERVISOR, 1, b"\x01\x01")
    bench.fly(29.0)
    assert Supervisor.ARMED in bench.state()
    bench.fly(2.0)
    assert bench.state() == Supervisor.CAN_ARM


def test_tumbled_agents_have_crashed_and_can_recover(aloft: Bench) -> None:
    drone = aloft.fleet.simulator.drones[0]
    for _ in range(30):
        drone["attitude"] = np.array([1.0, 0.0, 0.0, 0.0])  # on its back
        aloft.fleet.advance()
    aloft.fly(0.1)
    crashed = Supervisor.CRASHED | Supervisor.TUMBLED
    assert crashed in aloft.state()
    assert not aloft.turned
    assert aloft.ask(Port.SUPERVISOR, 1, b"\x02") == [b"\x82\x00\x00"]
    drone["attitude"] = np.array([0.0, 0.0, 0.0, 1.0])
    aloft.fly(2.5)
    assert Supervisor.CRASHED in aloft.state()
    assert aloft.ask(Port.SUPERVISOR, 1, b"\x02") == [b"\x82\x01\x01"]
    aloft.fly(0.2)
    assert Supervisor.CAN_FLY in aloft.state()
    assert Supervisor.CRASHED not in aloft.state()
    assert aloft.takeoff() == 0
