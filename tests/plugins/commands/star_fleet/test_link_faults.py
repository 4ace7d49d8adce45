"""Packet loss, duplicates, delay, jitter and cuts of simulated links."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from functools import partial
from typing import Any

import pytest

from star_core import InputError
from star_core.testing import scene
from star_faults.fault_file import faults_of
from star_fleet.link_faults import Direction, FaultyLinks, LinkFaults
from star_fleet.packet import Port, join
from tests.plugins.commands.star_fleet.conftest import place
from tests.simulators import ideal_fleet

UP, DOWN = Direction.TO_VEHICLE, Direction.TO_CLIENT
N = 2000


def carried(faults: LinkFaults, *, seed: int = 1, direction: Direction = UP) -> list[list[float]]:
    """Send a packet every 10 ms; return the times at which each arrives, s."""
    links = FaultyLinks(1, seed)
    links.faults[0] = faults
    arrived: list[list[float]] = [[] for _ in range(N)]
    now = 0.0

    def arrive(i: int) -> None:
        arrived[i].append(now)

    for i in range(N):
        now = i / 100
        links.deliver(now)
        links.send(0, direction, now, partial(arrive, i))
    now = N / 100 + 10
    links.deliver(now)
    return arrived


def test_packets_without_faults_arrive_at_once() -> None:
    assert carried(LinkFaults()) == [[i / 100] for i in range(N)]


def test_packets_are_lost_with_their_probability() -> None:
    lost = sum(not times for times in carried(LinkFaults(loss=0.2)))
    assert 0.16 * N < lost < 0.24 * N


def test_packets_are_duplicated_with_their_probability() -> None:
    twice = sum(len(times) == 2 for times in carried(LinkFaults(duplicates=0.3)))
    assert 0.26 * N < twice < 0.34 * N


def test_a_delay_keeps_the_order_of_packets() -> None:
    late = [times[0] - i / 100 for i, times in enumerate(carried(LinkFaults(delay=0.05)))]
    assert late[: N - 10] == pytest.approx([0.05] * (N - 10))


def test_jitter_lets_packets_overtake_each_other() -> None:
    arrived = [times[0] for times in carried(LinkFaults(delay=0.02, jitter=0.1))[: N - 20]]
    late = [time - i / 100 for i, time in enumerate(arrived)]
    assert min(late) >= 0.02 - 1e-9
    assert 0.1 < max(late) <= 0.13 + 1e-9
    assert arrived != sorted(arrived)


def test_packets_that_are_sent_during_a_cut_are_lost() -> None:
    arrived = carried(LinkFaults(cuts=((1.0, 2.0), (3.0, 3.5))))
    assert {i for i, times in enumerate(arrived) if not times} == {
        *range(100, 200),
        *range(300, 350),
    }


def test_faults_are_reproducible_per_seed_and_direction() -> None:
    faults = LinkFaults(loss=0.2, jitter=0.1)
    assert carried(faults) == carried(faults)
    assert carried(faults) != carried(faults, seed=2)
    assert carried(faults) != carried(faults, direction=DOWN)


def test_a_fleet_delays_packets_in_both_directions() -> None:
    with ideal_fleet(scene(1)) as fleet, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        fleet.links.faults[0] = LinkFaults(delay=0.1)
        client.settimeout(5.0)
        ping, began = join(Port.LINK, 0, b"ping"), fleet.time
        client.sendto(ping, place(fleet.addresses[0]))
        assert client.recv(64) == ping
        assert fleet.time - began >= 0.2 - 0.011


def test_the_links_of_a_fleet_are_cut_while_it_serves() -> None:
    with ideal_fleet(scene(1)) as fleet, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        fleet.links.faults[0] = LinkFaults(loss=1.0)
        client.settimeout(0.2)
        client.sendto(join(Port.LINK, 0, b"lost"), place(fleet.addresses[0]))
        with pytest.raises(TimeoutError):
            client.recv(64)
        fleet.links.faults[0] = LinkFaults()
        ping = join(Port.LINK, 0, b"ping")
        client.sendto(ping, place(fleet.addresses[0]))
        assert client.recv(64) == ping


def test_the_faults_of_a_file_come_and_go() -> None:
    swarm = scene(2)
    first, second = swarm.names
    link = {"component": "link", "agents": first}
    faults: list[Mapping[str, Any]] = [
        {**link, "mode": "intermittent", "loss": 0.2, "duplicates": 0.1, "at": 0.02},
        {**link, "mode": "delayed", "delay": 0.1, "jitter": 0.05, "at": 0.02, "for": 0.02},
        {**link, "mode": "off", "at": 0.06, "agents": second},
        {"component": "firmware", "mode": "off", "at": 0.08, "agents": first},
        {"component": "motor", "mode": "off", "agents": second},
    ]
    fleet = ideal_fleet(swarm, noise=False)
    try:
        fleet.inject(faults_of(faults, swarm))
        history, vehicle = [], fleet.vehicles[0]
        for _ in range(10):
            fleet.advance()
            history.append(tuple(fleet.links.faults))
        perfect, lossy = LinkFaults(), LinkFaults(loss=0.2, duplicates=0.1)
        late = LinkFaults(loss=0.2, duplicates=0.1, delay=0.1, jitter=0.05)
        assert history[0] == (perfect, perfect)
        assert history[2] == (late, perfect)
        assert history[4] == (lossy, perfect)
        assert history[6] == (lossy, LinkFaults(loss=1.0))
        assert fleet.vehicles[0] is not vehicle
        assert fleet.simulator.drones["motor_share"][1].tolist() == [0, 1, 1, 1]
        with pytest.raises(InputError, match="no fault 'off' of 'camera'"):
            fleet.inject(faults_of([{"component": "camera", "mode": "off"}], swarm))
    finally:
        fleet.close()
