"""Every packet, byte by byte, against what cflib sends for the same wish."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cflib.crazyflie.commander import Commander
from cflib.crazyflie.high_level_commander import HighLevelCommander
from cflib.crazyflie.localization import Localization
from cflib.crazyflie.mem.trajectory_memory import Poly4D
from cflib.crazyflie.supervisor import Supervisor
from cflib.utils.encoding import decompress_quaternion
from hypothesis import assume, given
from hypothesis import strategies as st

from star_core import Trajectory
from star_radio import orders, packets
from star_radio.trajectory import packed

NUMBER = st.floats(-30, 30, width=32)
POINT = st.tuples(NUMBER, NUMBER, NUMBER)
QUATERNION = st.tuples(*[st.floats(-1, 1, width=32)] * 4)


class Client:
    """What cflib's commanders send packets through."""

    def __init__(self, version: int = 12) -> None:
        self.sent: list[bytes] = []
        self.platform = SimpleNamespace(get_protocol_version=lambda: version)

    def send_packet(self, packet: Any, **_how: object) -> None:
        self.sent.append(bytes([packet.get_header()]) + bytes(packet.data))

    def add_port_callback(self, *_what: object) -> None:
        """Nobody answers."""


def unit(quaternion: tuple[float, ...]) -> list[float]:
    norm = math.hypot(*quaternion)
    assume(norm > 0.1)
    return [value / norm for value in quaternion]


@given(POINT, st.floats(-3, 3, width=32), st.sampled_from([9, 12]))
def test_velocity_setpoints(
    velocity: tuple[float, float, float], rate: float, version: int
) -> None:
    cflib = Client(version)
    Commander(cflib).send_velocity_world_setpoint(*velocity, math.degrees(rate))
    assert cflib.sent == [orders.velocity(velocity, rate, version)]


def test_velocity_setpoints_of_old_firmware_turn_the_other_way() -> None:
    cflib = Client(8)
    with pytest.warns(DeprecationWarning, match="legacy"):
        Commander(cflib).send_velocity_world_setpoint(1, 2, 3, math.degrees(0.5))
    assert cflib.sent == [orders.velocity((1, 2, 3), 0.5, 8)]


@given(POINT, NUMBER)
def test_position_setpoints(point: tuple[float, float, float], yaw: float) -> None:
    cflib = Client()
    Commander(cflib).send_position_setpoint(*point, math.degrees(yaw))
    assert cflib.sent == [orders.position(point, yaw)]


@given(st.lists(st.integers(-30000, 30000), min_size=12, max_size=12), QUATERNION)
def test_whole_states(thousandths: list[int], quaternion: tuple[float, ...]) -> None:
    attitude = unit(quaternion)
    cflib = Client()
    exact = [value / 1000 + math.copysign(1e-9, value) for value in thousandths]  # it truncates
    state = exact[0:3], exact[3:6], exact[6:9], attitude, exact[9:12]
    Commander(cflib).send_full_state_setpoint(*state[:4], *state[4])
    assert cflib.sent == [orders.full_state(*state)]


def test_a_state_beyond_sixteen_bits_is_refused() -> None:
    zero = (0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match=r"expected a state within ±32.767, got \[33.0, "):
        orders.full_state((33.0, 0, 0), zero, zero, (0, 0, 0, 1), zero)


@given(QUATERNION)
def test_a_packed_quaternion_is_the_same_turn(quaternion: tuple[float, ...]) -> None:
    attitude = unit(quaternion)
    back = decompress_quaternion(orders.packed_quaternion(attitude))
    assert abs(np.dot(attitude, back)) > math.cos(0.003)  # half the angle, rad


def test_setpoints_are_ended() -> None:
    cflib = Client()
    Commander(cflib).send_notify_setpoint_stop()
    assert cflib.sent == [orders.no_more_setpoints()]


@given(NUMBER, NUMBER)
def test_take_off_and_landing(height: float, duration: float) -> None:
    cflib = Client()
    high = HighLevelCommander(cflib)
    high.takeoff(height, duration, yaw=None)
    high.land(height, duration, yaw=None)
    assert cflib.sent == [orders.takeoff(height, duration), orders.land(height, duration)]


@given(POINT, NUMBER, NUMBER, st.sampled_from([7, 8, 12]))
def test_going_to_a_place(
    point: tuple[float, float, float], yaw: float, duration: float, version: int
) -> None:
    cflib = Client(version)
    HighLevelCommander(cflib).go_to(*point, yaw, duration)
    assert cflib.sent == [orders.go_to(point, yaw, duration, version)]


@pytest.mark.parametrize("version", [9, 10, 12])
def test_trajectories(version: int) -> None:
    cflib = Client(version)
    high = HighLevelCommander(cflib)
    high.define_trajectory(3, 132, 2)
    high.start_trajectory(3, 1.5, relative_position=True)
    assert cflib.sent == [
        orders.define_trajectory(3, 2, 132),
        orders.start_trajectory(3, version, stretch=1.5, relative=True),
    ]


def test_pieces_of_a_trajectory() -> None:
    numbers = np.linspace(-4, 4, 32).reshape(4, 8)
    axes = [Poly4D.Poly(list(axis)) for axis in numbers]
    ours = packed(Trajectory(np.full(2, 2.5), np.stack([numbers] * 2)))
    assert ours == bytes(Poly4D(2.5, *axes).pack()) * 2


def test_stopping() -> None:
    cflib = Client()
    HighLevelCommander(cflib).stop()
    assert cflib.sent == [orders.stop()]


@given(st.integers(1, 255), POINT, NUMBER, st.sampled_from([7, 8, 9, 10, 12]))
def test_orders_for_groups(
    groups: int, point: tuple[float, float, float], time: float, version: int
) -> None:
    cflib = Client(version)
    high = HighLevelCommander(cflib)
    high.set_group_mask(groups)
    high.takeoff(point[2], time, groups, yaw=None)
    high.land(point[2], time, groups, yaw=None)
    high.stop(groups)
    high.go_to(*point, 1.0, time, group_mask=groups)
    high.start_trajectory(3, time, relative_position=True, group_mask=groups)
    everybodys = [
        orders.takeoff(point[2], time),
        orders.land(point[2], time),
        orders.stop(),
        orders.go_to(point, 1.0, time, version),
        orders.start_trajectory(3, version, stretch=time, relative=True),
    ]
    assert cflib.sent[0] == orders.set_groups(groups)
    assert cflib.sent[1:] == [orders.only_for(groups, order) for order in everybodys]


def test_orders_for_groups_byte_by_byte() -> None:
    assert orders.set_groups(0b101).hex() == "8c0005"
    assert orders.only_for(0b101, orders.stop()).hex() == "8c0305"
    takeoff = orders.only_for(0x80, orders.takeoff(0.5, 2.0))
    assert takeoff.hex() == "8c07800000003f000000000100000040"


@pytest.mark.filterwarnings("ignore:The supervisor subsystem requires:UserWarning")
@pytest.mark.parametrize("version", [11, 12])
def test_arming_and_emergency_stops(version: int) -> None:
    cflib = Client(version)
    supervisor = Supervisor(cflib)
    supervisor.send_arming_request(do_arm=True)
    supervisor.send_emergency_stop()
    supervisor.send_emergency_stop_watchdog()
    assert cflib.sent == [
        orders.arm(version),
        orders.emergency_stop(version),
        orders.keep_alive(version),
    ]


@given(POINT, QUATERNION)
def test_what_estimators_are_told(
    point: tuple[float, float, float], quaternion: tuple[float, ...]
) -> None:
    cflib = Client()
    seen = Localization(cflib)
    seen.send_extpos(point)
    seen.send_extpose(point, quaternion)
    assert cflib.sent == [orders.seen_at(point), orders.seen_as(point, quaternion)]


def test_a_packet_that_is_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match="expected at most 30 bytes of payload, got 31"):
        packets.packet(5, 1, bytes(31))


@given(st.floats(0.01, 3.0))
def test_periods_are_whole_steps_of_ten_milliseconds(period: float) -> None:
    steps = packets.start_block(1, period)[-1]
    assert steps == min(255, round(period * 100))
