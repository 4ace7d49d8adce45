"""Trajectories that drones fly on their own: how they are uploaded, begun and ended."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import (
    Array,
    Command,
    ContractError,
    Mask,
    Operator,
    Order,
    PluginError,
    Setpoint,
    Trajectory,
)
from star_fleet.link_faults import LinkFaults
from star_radio import orders
from star_radio.transport import Radio
from tests.end_to_end.virtual_air import LINK_LOST, START_TRAJECTORY, Air, Flown, flown
from tests.plugins.transports.star_radio.conftest import UNSERVED, Open, Peers, command, ticks
from tests.plugins.transports.star_radio.peer import Peer

ACTIVE, FINISHED = 0x10F, 0x30F  # supervisor.info of one that is on the way, and of one that was


def trajectory(pieces: int = 2, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    return Trajectory(rng.uniform(1, 2, pieces), rng.uniform(-1, 1, (pieces, 4, 8)))


def told(flown: Trajectory, n: int = 1, *, yaw: float = 0.0, seconds: float = 6.0) -> Command:
    return command(
        Order.FOLLOW, range(n), (1.0, 2.0, 0.8), yaw=yaw, duration=seconds, trajectory=flown
    )


def begins(drone: Any) -> list[bytes]:
    """What it was commanded to fly."""
    return [payload for payload in drone.sent_to(8, 0) if payload[0] == 13]


def test_trajectories_share_the_memory_of_every_drone(peers: Peers, connect: Open) -> None:
    drones = peers(2)
    radio = connect(drones)
    first, second = trajectory(3), trajectory(2, seed=1)
    radio.upload((first, second))
    for drone in drones:
        assert drone.ordered == [
            orders.define_trajectory(0, 3, 0)[1:], orders.define_trajectory(1, 2, 3 * 132)[1:],
        ]  # fmt: skip
        numbers = np.frombuffer(drone.memory[: 5 * 132], "<f4").reshape(5, 33)
        assert numbers[:3, 32] == pytest.approx(first.duration)
        assert numbers[3:, :32] == pytest.approx(second.coefficients.reshape(2, 32))


def test_it_is_turned_into_the_odometry_frame_of_each_drone(drone: Peer, make: Open) -> None:
    radio = make([drone.uri])
    radio._scene = dataclasses.replace(
        radio._scene, agents=(dataclasses.replace(radio._scene.agents[0], yaw=math.pi / 2),)
    )
    radio.connect()
    flown = trajectory(1)
    radio.upload((flown,))
    x, y, z, yaw = np.frombuffer(drone.memory[:128], "<f4").reshape(4, 8)
    assert x == pytest.approx(flown.coefficients[0, 1], abs=1e-6)  # x of its frame is y of the map
    assert y == pytest.approx(-flown.coefficients[0, 0], abs=1e-6)
    assert z == pytest.approx(flown.coefficients[0, 2], abs=1e-6)
    assert yaw[0] == pytest.approx(flown.coefficients[0, 3, 0] - math.pi / 2, abs=1e-6)
    assert yaw[1:] == pytest.approx(flown.coefficients[0, 3, 1:], abs=1e-6)


def test_more_are_refused_with_the_arithmetic(drone: Peer, radio: Radio) -> None:
    radio.upload((trajectory(20), trajectory(11, seed=1)))
    uploaded = len(drone.sent_to(4, 2))
    with pytest.raises(PluginError) as raised:
        radio.upload((trajectory(20), trajectory(12, seed=1)))
    assert str(raised.value).startswith(
        "2 trajectories have 32 pieces of 132 bytes, 4224 bytes in all; a Crazyflie has 4096 bytes "
        "for them: 31 pieces at most"
    )
    with pytest.raises(PluginError, match="a Crazyflie stores 10 trajectories at most, got 11"):
        radio.upload([trajectory(1, seed=i) for i in range(11)])
    assert len(drone.sent_to(4, 2)) == uploaded


def test_every_drone_that_refuses_an_upload_is_named(peers: Peers, connect: Open) -> None:
    drones = peers(3)
    drones[0].errors[6], drones[2].errors[6] = [12], [12]
    with pytest.raises(PluginError) as raised:
        connect(drones).upload((trajectory(),))
    message = str(raised.value)
    assert message.startswith(
        "cannot upload trajectories to 2 of 3 agents: cf1 (trajectory 0 is ref"
    )
    assert "cf2" not in message
    assert "cf3 (trajectory 0 is refused: error '0c'" in message


def test_no_trajectory_is_uploaded_to_an_absent_agent(drone: Peer, make: Open) -> None:
    radio = make([UNSERVED, drone.uri], absent="fly-without")
    radio.connect()
    radio.upload((trajectory(),))
    radio.command(told(trajectory(), 2))
    assert drone.until(lambda: len(begins(drone)) == 1)


def test_it_begins_where_the_drone_is_and_takes_the_given_time(drone: Peer, radio: Radio) -> None:
    first, second = trajectory(3), trajectory(2, seed=1)
    radio.upload((first, second))
    before = len(drone.got)
    radio.send(Setpoint(np.zeros((1, 3)), np.zeros(1), np.ones(1, np.bool_)))
    radio.command(told(second, seconds=3.0 * float(second.duration.sum())))
    ticks(radio, 5)
    assert drone.until(lambda: bool(begins(drone)))
    assert [packet[0] for packet in drone.got[before : before + 3]] == [0x70, 0x80, 0x71]
    order = orders.start_trajectory(1, 12, stretch=3.0, relative=True)
    assert begins(drone) == [orders.only_for(orders.MISSION, order)[1:]]


def test_the_order_takes_no_time_of_the_tick(peers: Peers, connect: Open) -> None:
    drones = peers(2)
    radio = connect(drones)
    radio.upload((trajectory(),))
    for drone in drones:
        drone.mute.set()
    begun = time.monotonic()
    radio.command(told(trajectory(), 2))
    assert time.monotonic() - begun < 0.05


def test_one_that_was_not_uploaded_is_a_fault(radio: Radio) -> None:
    radio.upload((trajectory(),))
    with pytest.raises(ContractError, match=r"Command\.trajectory was not uploaded"):
        radio.command(told(trajectory(seed=1)))


@pytest.mark.parametrize(("yaw", "flies"), [(0.4, True), (math.pi / 2, False), (-1.0, False)])
def test_one_that_is_to_lie_otherwise_is_refused(
    peers: Peers, connect: Open, yaw: float, flies: bool  # noqa: FBT001 -- what is expected
) -> None:  # fmt: skip
    [drone] = peers()
    radio = connect([drone])
    radio.upload((trajectory(),))
    radio.command(told(trajectory(), yaw=yaw))
    refused = [refusal for telemetry in ticks(radio, 2) for refusal in telemetry.refusals]
    assert bool(begins(drone)) is flies
    words = f"rotated by {math.degrees(yaw):.0f}°: it was uploaded without rotation"
    assert refused == ([] if flies else [(0, f"refuses to follow a trajectory {words}")])


@pytest.mark.usefixtures("soon")
def test_a_refusal_is_reported(drone: Peer, connect: Open) -> None:
    drone.errors[13] = [8]
    radio = connect([drone])
    radio.upload((trajectory(),))
    radio.command(told(trajectory()))
    assert drone.until(lambda: bool(begins(drone)))
    refused = [refusal for telemetry in ticks(radio, 4) for refusal in telemetry.refusals]
    assert refused == [(0, "refuses the order to follow a trajectory: it does not know it")]


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize(("lost", "reports"), [(100, True), (3, False)])
def test_a_drone_is_commanded_again_until_it_reports_to_be_under_way(
    drone: Peer, connect: Open, caplog: pytest.LogCaptureFixture, *, lost: int, reports: bool
) -> None:
    drone.values["supervisor.info"] = FINISHED
    radio = connect([drone])
    radio.upload((trajectory(),))
    ticks(radio, 2)
    drone.lose[b"\x80"] = lost
    radio.command(told(trajectory()))
    ticks(radio, 2)
    if reports:
        drone.values["supervisor.info"] = ACTIVE
    ticks(radio, 5)
    count = len(begins(drone))
    assert reports or count == lost + 1
    ticks(radio, 10)
    assert len(begins(drone)) == count
    assert caplog.text == ""


@pytest.mark.usefixtures("soon")
def test_one_that_setpoints_took_over_is_not_commanded_again(drone: Peer, radio: Radio) -> None:
    radio.upload((trajectory(),))
    drone.lose[b"\x80"] = 100
    radio.command(told(trajectory()))
    radio.send(Setpoint(np.zeros((1, 3)), np.zeros(1), np.ones(1, np.bool_)))
    ticks(radio, 6)
    assert len(begins(drone)) == 1


# Missions, over links to simulated drones that have their own firmware's ways, on a virtual clock


SET_OUT = 120  # records of `Track`: 1.2 s
STEPS = """\
  - takeoff: {height: 0.4, speed: 0.4}
  - follow: {file: hook.csv, format: poly7, timescale: 1.25, on_board: true}
  - land: {speed: 0.4}
"""


def hook() -> str:
    """An L of 0.5 m along x and 0.3 m along y, 1.6 s each, that stands still at its ends."""
    lines = [
        ",".join(["duration", *(f"{a}^{p}" for a in ("x", "y", "z", "yaw") for p in range(8))])
    ]
    for x, y in ((0.5, 0.0), (0.0, 0.3)):
        axes = np.zeros((4, 8))
        for power, factor in ((3, 10), (4, -15), (5, 6)):
            axes[0, power], axes[1, power] = (factor * way / 1.6**power for way in (x, y))
        axes[0, 0] = 0.5 - x
        lines.append(",".join(map(repr, [1.6, *axes.ravel().tolist()])))
    return "\n".join(lines)


class Track(list[Array]):
    """(2, 3) how far the drones really are from their starts, m, every 10 ms since they set out.

    After 1.2 s of them, something happens.
    """

    flight: Flown

    def __init__(self, then: Callable[[Air, Operator], object]) -> None:
        super().__init__()
        self._then = then

    def __call__(self, air: Air, operator: Operator) -> None:
        if START_TRAJECTORY in air.ordered:
            self.append(air.drones["position"] - air.drones["origin"])
        if len(self) > SET_OUT:
            self._then(air, operator)


def fly_hook(folder: Path, then: Callable[[Air, Operator], object], *changes: str) -> Track:
    """Fly the trajectory on board, by two drones of which the second looks along y."""
    (folder / "hook.csv").write_text(hook())
    track = Track(then)
    own = ["limits={speed: 1.0}", "swarm.cf2.yaw_deg=90"]
    track.flight = flown(
        folder, n=2, steps=STEPS, changes=[*own, *changes], watch=track, after=12.0
    )
    return track


def test_drones_fly_it_in_the_map_and_land_in_the_middle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steered: list[Mask] = []
    send = Radio.send

    def record(radio: Radio, setpoint: Setpoint) -> Setpoint:
        steered.append(setpoint.active)
        return send(radio, setpoint)

    def interrupt(_air: Air, operator: Operator) -> None:
        if not operator.stops:
            operator.stops = 1
            assert not np.any(steered[-20:])  # no agent is steered

    monkeypatch.setattr(Radio, "send", record)
    track = fly_hook(tmp_path, interrupt)
    assert track.flight.summary["outcome"] == "aborted"
    assert track.flight.summary["reason"] == "interrupted by the operator"
    positions = track[SET_OUT]
    assert (positions[:, 0] > 0.1).all()  # the first one looks along x, the other one along y
    assert positions[:, 1:] == pytest.approx(np.tile([0.0, 0.4], (2, 1)), abs=0.08)
    assert track[-1][:, 0] == pytest.approx(positions[:, 0], abs=0.2)
    assert (track[-1][:, 2] == 0.0).all()


@pytest.mark.extended
def test_a_drone_without_a_link_comes_down_after_a_trajectory(tmp_path: Path) -> None:
    def cut(air: Air, _operator: Operator) -> None:
        air.links.faults[0] = LinkFaults(loss=1.0)

    track = fly_hook(tmp_path, cut, LINK_LOST)
    assert track[-1][0] == pytest.approx([0.5, 0.3, 0.0], abs=0.15)
    assert track.flight.air.impact[0] < 0.4


@pytest.mark.campaign
def test_a_mission_flies_a_trajectory_on_board_to_its_end(tmp_path: Path) -> None:
    track = fly_hook(tmp_path, lambda _air, _operator: None)
    summary = track.flight.summary
    assert summary["outcome"] == "completed", summary["reason"]
    assert track[-1][:, :2] == pytest.approx(np.tile([0.5, 0.3], (2, 1)), abs=0.12)
    corners = [[0.0, 0.0], [0.5, 0.0], [0.5, 0.3]]
    along = np.linspace(0, 2, 101)
    line = np.stack([np.interp(along, [0, 1, 2], axis) for axis in zip(*corners, strict=True)])
    off = np.linalg.norm(np.array(track)[:, :, None, :2] - line.T, axis=3).min(axis=2)
    assert off.max() < 0.1
    step = summary["steps"][1]
    assert 4.0 < step["ended_s"] - step["begun_s"] < 7.0  # one turns by 90° first
