"""Unmodified cflib, over UDP: what the firmware's own client library sees."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from star_core.testing import scene
from star_fleet.server import Fleet
from tests.simulators import ideal_fleet
from tests.waiting import eventually

crtp = pytest.importorskip("cflib.crtp")
SPEED = 5.0  # simulated seconds per second


@pytest.fixture(scope="module")
def fleet() -> Iterator[Fleet]:
    crtp.init_drivers()
    with ideal_fleet(scene(3), noise=False, speed=SPEED) as made:
        yield made


@pytest.fixture
def link(fleet: Fleet, tmp_path: Path) -> Iterator[Callable[[int], Any]]:
    """Opens the link to the vehicle in a row."""
    from cflib.crazyflie import Crazyflie

    opened = []

    def connect(row: int) -> Any:
        vehicle = Crazyflie(rw_cache=str(tmp_path / "cache"))
        done: list[bool] = []
        vehicle.fully_connected.add_callback(lambda _uri: done.append(True))
        vehicle.connection_failed.add_callback(lambda _uri, _why: done.append(False))
        vehicle.open_link(fleet.addresses[row])
        opened.append(vehicle)
        assert eventually(lambda: bool(done))
        assert done == [True]
        return vehicle

    yield connect
    for vehicle in opened:
        vehicle.close_link()


def logged(vehicle: Any, *names: str) -> dict[str, float]:
    """Return the values of variables, as a log block of cflib's brings them."""
    from cflib.crazyflie.log import LogConfig

    samples: list[dict[str, float]] = []
    config = LogConfig("values", period_in_ms=20)
    for name in names:
        config.add_variable(name)
    vehicle.log.add_config(config)
    config.data_received_cb.add_callback(lambda _time, values, _config: samples.append(values))
    config.start()
    assert eventually(lambda: len(samples) >= 2)
    config.stop()
    config.delete()
    assert eventually(lambda: not config.added)
    return samples[-1]


def height(fleet: Fleet, row: int) -> float:
    return float(fleet.simulator.drones["position"][row, 2])


def test_it_takes_off_goes_and_lands(fleet: Fleet, link: Callable[[int], Any]) -> None:
    vehicle = link(0)
    acknowledged: list[bytes] = []
    vehicle.add_port_callback(8, lambda packet: acknowledged.append(bytes(packet.data)))
    vehicle.commander.send_notify_setpoint_stop()
    vehicle.high_level_commander.takeoff(0.7, 2.0)
    assert eventually(lambda: height(fleet, 0) > 0.65)
    vehicle.high_level_commander.go_to(0.4, 0.2, 0.7, 0.0, 2.0)
    place = fleet.simulator.drones[0]["believed_position"]
    assert eventually(lambda: abs(place[0] - 0.4) < 0.02 and abs(place[1] - 0.2) < 0.02)
    vehicle.high_level_commander.land(0.0, 2.0)
    assert eventually(lambda: not fleet.simulator.drones["mode"][0])
    assert height(fleet, 0) < 0.05
    assert eventually(lambda: not vehicle.supervisor.is_flying)
    assert [answer[3] for answer in acknowledged] == [0, 0, 0]


def test_it_writes_and_reads_a_parameter(link: Callable[[int], Any]) -> None:
    vehicle = link(1)
    assert float(vehicle.param.get_value("locSrv.extPosStdDev")) == pytest.approx(0.01)
    written: list[str] = []
    vehicle.param.add_update_callback("locSrv", "extPosStdDev", lambda _n, v: written.append(v))
    vehicle.param.set_value("locSrv.extPosStdDev", 0.5)
    assert eventually(lambda: bool(written))
    assert float(written[-1]) == 0.5
    with pytest.raises(AttributeError, match="read-only"):
        vehicle.param.set_value("deck.bcFlow2", 0)


def test_it_reads_stores_and_clears_a_persistent_parameter(link: Callable[[int], Any]) -> None:
    vehicle = link(1)
    got: list[Any] = []
    vehicle.param.persistent_get_state("ring.effect", lambda _name, state: got.append(state))
    assert eventually(lambda: len(got) == 1)
    assert (got[0].is_stored, got[0].default_value) == (False, 6)
    vehicle.param.persistent_store("ring.effect", lambda _name, done: got.append(done))
    assert eventually(lambda: len(got) == 2)
    assert got[1] is True


def test_it_logs(link: Callable[[int], Any]) -> None:
    values = logged(link(1), "pm.vbat", "stateEstimate.z", "supervisor.info", "stateEstimateZ.quat")
    assert values["pm.vbat"] == pytest.approx(4.19, abs=0.02)
    assert values["supervisor.info"] == 0b1110


def test_it_reads_the_supervisor(link: Callable[[int], Any]) -> None:
    vehicle = link(1)
    assert vehicle.supervisor.read_state_list() == ["Is armed", "Is auto armed", "Can fly"]
    assert vehicle.platform.get_protocol_version() == 12


def test_it_uploads_a_trajectory_and_starts_it(fleet: Fleet, link: Callable[[int], Any]) -> None:
    from cflib.crazyflie.mem import MemoryElement
    from cflib.crazyflie.mem.trajectory_memory import Poly4D

    vehicle = link(2)
    vehicle.commander.send_notify_setpoint_stop()
    vehicle.high_level_commander.takeoff(0.7, 1.5)
    assert eventually(lambda: height(fleet, 2) > 0.65)
    (memory,) = vehicle.mem.get_mems(MemoryElement.TYPE_TRAJ)
    zero = [0.0] * 8
    memory.trajectory = [
        Poly4D(
            2.0,
            Poly4D.Poly([0.0, 0.25, *zero[2:]]),
            Poly4D.Poly(zero),
            Poly4D.Poly([0.7, *zero[1:]]),
            Poly4D.Poly(zero),
        )
    ]
    assert memory.write_data_sync()
    vehicle.high_level_commander.define_trajectory(1, 0, 1)
    vehicle.high_level_commander.start_trajectory(1, 1.0)
    place = fleet.simulator.drones[2]["believed_position"]
    assert eventually(lambda: abs(place[0] - 0.5) < 0.02)
    assert place[2] == pytest.approx(0.7, abs=0.05)
    vehicle.high_level_commander.land(0.0, 1.5)
    assert eventually(lambda: not vehicle.supervisor.is_flying)


def test_it_flies_setpoints_and_hands_over(fleet: Fleet, link: Callable[[int], Any]) -> None:
    vehicle = link(2)
    vehicle.commander.send_notify_setpoint_stop()
    vehicle.high_level_commander.takeoff(0.7, 1.5)
    assert eventually(lambda: height(fleet, 2) > 0.65)
    drone = fleet.simulator.drones[2]

    def push() -> bool:
        vehicle.commander.send_velocity_world_setpoint(0.0, 0.3, 0.0, 0.0)
        return bool(drone["believed_velocity"][1] > 0.25)

    assert eventually(push)
    vehicle.high_level_commander.land(0.0, 1.5)
    vehicle.commander.send_notify_setpoint_stop()
    assert eventually(lambda: not vehicle.supervisor.is_flying)
    assert not vehicle.supervisor.is_locked
