"""The transport against the firmware of simulated Crazyflies, on a virtual clock."""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import star_radio
from star_core import (
    Order,
    Registry,
    Scene,
    Setpoint,
    Supervisor,
    Telemetry,
    Tick,
    fly,
    hookimpl,
    load,
)
from star_core.testing import scene
from star_fleet.aideck import CrtpOverTcp
from star_fleet.link_faults import LinkFaults
from star_radio.transport import Radio
from tests.end_to_end.virtual_air import LINK_LOST, WORLD, Air, flown
from tests.plugins.tasks.test_tracking import zigzag
from tests.plugins.transports.star_radio.conftest import command
from tests.plugins.transports.star_radio.conftest import options as defaults
from tests.plugins.transports.star_radio.virtual import virtual
from tests.simulators import ideal_fleet

TICK = 0.05  # s


class Flight:
    """A radio to a fleet, and its ticks."""

    def __init__(self, uris: Sequence[str], room: Scene, cache: Path, **options: object) -> None:
        agents = (
            dataclasses.replace(agent, uri=uri)
            for agent, uri in zip(room.agents, uris, strict=True)
        )
        reached = dataclasses.replace(room, agents=tuple(agents), realtime=True)
        self.radio = star_radio.make(reached, **defaults(cache=str(cache), **options))
        assert isinstance(self.radio, Radio)
        self.vehicles = self.radio.vehicles
        self.n = len(room.agents)
        self._tick = 0
        self.radio.connect()
        self.now = self.tick()

    def tick(self, velocity: Sequence[float] | None = None) -> Telemetry:
        self.radio.wait(self._tick * TICK)
        self._tick += 1
        self.now = self.radio.receive()
        if velocity is not None:
            n = self.n
            self.radio.send(Setpoint(np.tile(velocity, (n, 1)), np.zeros(n), np.ones(n, np.bool_)))
        return self.now

    def until(self, done: Callable[[Telemetry], object], within: float = 6.0) -> bool:
        return any(done(self.tick()) for _ in range(round(within / TICK)))

    def order(self, order: Order, z: float = 0.0) -> None:
        self.radio.command(command(order, range(self.n), (0.0, 0.0, z)))


def finished(now: Telemetry) -> bool:
    return bool((now.state & int(Supervisor.COMMANDER_FINISHED)).all())


def high(now: Telemetry) -> bool:
    return bool((now.position[:, 2] > 0.4).all()) and finished(now)


@pytest.fixture
def air() -> Iterator[Air]:
    """One simulated drone, and its virtual link and clock."""
    air = Air(scene(1), noise=False)
    with virtual(air), closing(air.fleet):
        yield air


STEPS = """\
  - takeoff: {agents: cf1, height: 0.3}
  - takeoff: {agents: cf2, height: 0.5, LET}
  - goto: {agents: cf1, by: [0.4, 0, 0], yaw_deg: 30}
  - land: {}
"""


@pytest.mark.parametrize(
    ("let", "changes", "outcome"),
    [
        ("on_failure: continue, timeout: 1", [], "completed"),
        ("timeout: 1", [LINK_LOST], "completed"),
        ("timeout: 1", [], "failed"),
    ],
)
def test_absent_agents_are_left_out_where_a_mission_allows_it(
    tmp_path: Path, let: str, changes: list[str], outcome: str
) -> None:
    def lose(air: Air, _operator: object) -> None:
        air.links.faults[1] = LinkFaults(loss=1.0)

    steps = STEPS.replace("LET", let)
    changes = [*changes, "transport.absent=fly-without"]
    flight = flown(tmp_path, n=2, steps=steps, changes=changes, watch=lose)
    assert flight.summary["outcome"] == outcome, flight.summary["reason"]
    if outcome == "completed":
        moved = flight.air.drones["position"] - flight.air.drones["origin"]
        assert moved == pytest.approx(np.array([[0.4, 0, 0], [0, 0, 0]]), abs=0.15)


def test_drones_fly_again_after_the_link_closed_at_touchdown(air: Air, tmp_path: Path) -> None:
    first = Flight(air.uris, scene(1), tmp_path)
    first.order(Order.TAKEOFF, 0.5)
    assert first.until(high)
    assert first.until(lambda _now: first.tick([0.3, 0.0, 0.0]).position[0, 0] > 0.2)
    assert first.now.velocity[0, 0] > 0.15
    assert first.now.age[0] < 0.3
    first.order(Order.LAND)
    assert first.until(finished)
    first.radio.close()
    air.sleep(2.5)
    second = Flight(air.uris, scene(1), tmp_path)
    assert not second.now.state[0] & int(Supervisor.LOCKED)
    second.order(Order.TAKEOFF, 0.5)
    assert second.until(lambda now: now.position[0, 2] > 0.2)
    second.radio.close()


@pytest.mark.parametrize("steered", [True, False])
def test_drones_flying_at_the_end_land_and_are_not_locked(
    air: Air,
    tmp_path: Path,
    steered: bool,  # noqa: FBT001
) -> None:
    flight = Flight(air.uris, scene(1), tmp_path)
    flight.order(Order.TAKEOFF, 0.5)
    assert flight.until(high)
    if steered:
        flight.tick([0.0, 0.0, 0.0])
    flight.radio.close()
    assert air.until(lambda: air.height[0] < 0.1, 8)
    air.sleep(2.5)  # setpoints that end otherwise lock after 2 s
    assert not air.drones["locked"][0]


def test_a_drone_is_flown_over_tcp_until_the_connection_is_gone(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    caplog.set_level(logging.DEBUG)  # as `--verbose`
    with ideal_fleet(scene(1), noise=False) as fleet:  # in real time: the driver is cflib's
        server = CrtpOverTcp("127.0.0.1", 0, lambda packet: fleet.handle(0, packet))
        fleet.listen(0, server.push)
        uri = "tcp://{}:{}".format(*server.address)
        flight = Flight([uri], scene(1), tmp_path, landing_timeout=0.1)
        flight.order(Order.TAKEOFF, 0.5)
        assert flight.until(high)
        assert flight.now.age[0] < 0.3
        monkeypatch.setattr("star_radio.connection.cflib_link.TCP_TIMEOUT", 0.5)
        server.close()
        assert flight.until(lambda now: now.age[0] > 0.5)
        link = flight.vehicles[0].link
        assert flight.until(lambda _now: link.broken == "the connection is lost"), link.broken
        time.sleep(0.3)
        used = time.process_time()
        time.sleep(0.2)
        flight.radio.close()
        assert time.process_time() - used < 0.15  # nothing spins
    assert capfd.readouterr().out == ""
    assert "Traceback" not in caplog.text
    assert len(caplog.records) < 100


def test_the_watchdog_of_a_client_that_hangs_locks(air: Air, tmp_path: Path) -> None:
    flight = Flight(air.uris, scene(1), tmp_path, watchdog=True)
    for _ in range(30):
        flight.tick()
    assert not flight.now.state[0] & int(Supervisor.LOCKED)
    air.sleep(1.5)
    assert flight.until(lambda now: now.state[0] & int(Supervisor.LOCKED))
    flight.radio.close()


LAP = """\
star: 1
name: lap
world: room.yaml
limits: {speed: 1.4, acceleration: 3.0}
swarm: {cf1: {start: [0, 0, 0], uri: URI}}
transport: {use: radio, guardian: false, cache: CACHE, CONTROL}
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {height: 1.0}
  - hold: {for: 1}
  - follow: {file: path.csv, format: poly7}
  - land: {}
"""


@pytest.mark.extended
@pytest.mark.parametrize(
    ("controller", "control"),
    [
        ("pid", "setpoints: velocity"),
        ("mellinger", "setpoints: full-state, parameters: {stabilizer.controller: 2}"),
    ],
)
def test_drones_follow_trajectories_in_their_own_time(
    controller: str, control: str, tmp_path: Path
) -> None:
    (tmp_path / "room.yaml").write_text(WORLD)
    (tmp_path / "path.csv").write_text(zigzag())
    text = LAP.replace("URI", "'udp://air:1'").replace("CACHE", f"'{tmp_path / 'cache'}'")
    (tmp_path / "mission.yaml").write_text(text.replace("CONTROL", control))
    error: list[float] = []

    class Watch:
        @hookimpl
        def star_ticked(self, tick: Tick) -> None:
            if np.linalg.norm(tick.goals.velocity[0]) > 0:
                away = sky.drones["position"][0] - tick.goals.position[0]
                error.append(float(np.linalg.norm(away)))

    registry = Registry(Watch())
    mission = load(tmp_path / "mission.yaml", registry)
    sky = Air(mission.scene, noise=False, controller=controller)
    with virtual(sky), closing(sky.fleet):
        summary = fly(mission, registry)
    assert summary["outcome"] == "completed", summary["reason"]
    assert len(error) > 100
    assert np.sqrt(np.mean(np.square(error))) < 0.06
    assert max(error) < 0.15
