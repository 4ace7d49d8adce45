"""The guardian and the flight that it serves, on a virtual clock."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import Array, Command, Obstacle, Order, Setpoint, Supervisor, Transform
from star_core.testing import scene
from star_fleet.link_faults import LinkFaults
from star_fleet.packet import Port
from star_radio.guarded import Answer
from star_radio.guardian import Guardian, Lines
from star_radio.options import RadioOptions
from star_radio.transport import Radio
from tests.end_to_end.virtual_air import MAX_IMPACT, ON_FLOOR, START_TRAJECTORY, TAKEOFF, Air
from tests.plugins.transports.star_radio.conftest import options, report_unknown_heights
from tests.plugins.transports.star_radio.virtual import virtual

PERIOD = 0.05  # s
STARTS = ((-1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))


class Flight:
    """Drones, their guardian, and the flight's end of the connection to it.

    Attributes:
        air: The drones.
        guardian: Serves the messages of `post` and `call`.
    """

    def __init__(self, folder: Path, air: Air, agents: Any, **how: Any) -> None:
        self.air = air
        self._posted: deque[tuple[int | None, str, Any]] = deque()
        self._answers: list[Answer] = []
        self._closed = False
        self._tick = 0
        room = dataclasses.replace(scene(len(agents)), agents=agents, realtime=True)
        self.radio = Radio(room, RadioOptions(**options(cache=str(folder), guardian=True, **how)))
        self.radio.connect()
        self.guardian = Guardian(room, self.radio, self, Lines())  # type: ignore[arg-type]
        self.post("record_in", folder)

    # The connection, as the guardian uses it.

    def poll(self, timeout: float) -> bool:
        if not self._posted and not self._closed:
            self.air.sleep(timeout)
        return bool(self._posted) or self._closed

    def recv(self) -> tuple[int | None, str, Any]:
        if not self._posted:
            raise EOFError
        return self._posted.popleft()

    def send(self, answer: Answer) -> None:
        self._answers.append(answer)

    # The flight.

    def post(self, name: str, argument: Any) -> None:
        self._posted.append((None, name, argument))
        self.guardian.step()

    def call(self, name: str, argument: Any = None) -> Answer:
        self._posted.append((1, name, argument))
        self.guardian.step()
        return self._answers[-1]

    def tick(self, velocity: Array | None = None) -> Answer:
        """Wait for the next tick, and steer all drones by a velocity, m/s."""
        began = self.air.now if self.radio.began is None else self.radio.began
        self._tick = max(self._tick + 1, round((self.air.now - began) / PERIOD))
        answer = self.call("wait", self._tick * PERIOD)
        if velocity is not None:
            n = len(self.radio.vehicles)
            setpoint = Setpoint(velocity, np.zeros(n), np.ones(n, np.bool_))
            self.post("send", (setpoint, frames(self.starts)))
        return answer

    def order(self, order: Order, position: Array, duration: float = 2.0) -> None:
        n = len(self.radio.vehicles)
        rows = np.arange(n)
        self.post("command", Command(order, rows, position, np.zeros(n), np.full(n, duration)))

    def fly(self, seconds: float, velocity: Array | None = None) -> None:
        for _ in range(round(seconds / PERIOD)):
            self.tick(velocity)

    def take_off(self, *heights: float) -> None:
        """Take off to some heights, m."""
        self.order(Order.TAKEOFF, np.array([[0.0, 0.0, height] for height in heights]))
        self.fly(3.0)

    def silence(self, seconds: float) -> None:
        """Send nothing."""
        for _ in range(round(seconds / PERIOD)):
            self.guardian.step()

    def cut(self, row: int, seconds: float = np.inf) -> None:
        """Cut the link of a drone."""
        self.air.links.faults[row] = LinkFaults(loss=1.0)
        if np.isfinite(seconds):
            self.air.later(seconds, lambda: self.air.links.faults.__setitem__(row, LinkFaults()))

    def lose_in_take_off(self, seconds: float = np.inf) -> None:
        """Cut the link of the second drone while all climb."""
        self.tick()
        self.order(Order.TAKEOFF, np.tile([0.0, 0.0, 0.5], (3, 1)))
        self.fly(0.8)
        self.cut(1, seconds)

    def die(self) -> None:
        """Close the connection, and let the guardian run to its end."""
        self._closed = True
        self.guardian.run()

    # The drones.

    @property
    def starts(self) -> Array:
        return np.array([agent.start for agent in self.guardian._scene.agents])

    @property
    def speed(self) -> float:
        """Of the fastest drone, m/s."""
        return float(np.linalg.norm(self.air.drones["velocity"], axis=1).max())

    @property
    def fallen(self) -> bool:
        """Whether a drone is locked, hit the floor at more than 1 m/s, or is not on it."""
        wrong = (self.air.drones["locked"] != 0) | (self.air.impact > MAX_IMPACT)
        return bool((wrong | (self.air.height > ON_FLOOR)).any())


def frames(starts: Array) -> Transform:
    return Transform(np.zeros(len(starts)), starts)


@contextmanager
def opened(
    folder: Path, starts: Sequence[tuple[float, float, float]], **how: Any
) -> Iterator[Flight]:
    """Open the links of drones that stand at some positions."""
    room = scene(len(starts))
    agents = tuple(
        dataclasses.replace(agent, start=start, yaw=0.0, uri=f"udp://air:{row + 1}")
        for row, (agent, start) in enumerate(zip(room.agents, starts, strict=True))
    )
    air = Air(dataclasses.replace(room, agents=agents), noise=False)
    with virtual(air), closing(air.fleet):
        yield Flight(folder, air, agents, **how)


@pytest.fixture
def flight(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Flight]:
    with opened(tmp_path, getattr(request, "param", STARTS)) as flight:
        yield flight


@pytest.fixture
def bounded(tmp_path: Path) -> Iterator[Flight]:
    """Drones whose take-offs come down by themselves."""
    with opened(tmp_path, STARTS, descent=True) as flight:
        yield flight


def log(folder: Path) -> str:
    return (folder / "guardian.log").read_text()


def test_agents_hover_during_silence_and_then_resume(flight: Flight, tmp_path: Path) -> None:
    east = np.tile([0.4, 0.0, 0.0], (3, 1))
    flight.take_off(0.5, 0.5, 0.5)
    flight.fly(1.0, east)
    assert flight.speed > 0.3
    flight.silence(0.9)
    assert flight.speed < 0.1
    answer = flight.tick(east)
    assert answer.problem is None
    flight.fly(1.0, east)
    assert flight.speed > 0.3
    assert "cf1, cf2, cf3 hover\n" in log(tmp_path)
    assert log(tmp_path).endswith("the flight answers again\n")


def test_agents_land_when_the_flight_stays_silent(flight: Flight, tmp_path: Path) -> None:
    still = np.zeros((3, 3))
    flight.take_off(0.5, 1.0, 0.5)
    flight.fly(1.0, still)
    flight.silence(8.0)
    assert not flight.fallen
    assert ": landing cf1, cf2, cf3\n" in log(tmp_path)
    assert "all agents have landed, after " in log(tmp_path)


def test_a_flight_that_comes_back_cannot_move_agents_that_land(flight: Flight) -> None:
    up = np.tile([0.0, 0.0, 0.5], (3, 1))
    flight.take_off(1.0, 1.0, 1.0)
    flight.fly(1.0, np.zeros((3, 3)))
    flight.silence(1.5)
    answer = flight.tick(up)
    assert answer.problem is not None
    assert answer.problem[0].startswith("the guardian lands all agents: no message of the flight")
    answer = flight.tick(up)
    assert answer.problem is None  # it is reported once
    assert answer.value is not None  # with telemetry, until all are down
    flight.fly(6.0, up)
    assert not flight.fallen


def test_a_stop_of_the_motors_is_obeyed_while_agents_land(flight: Flight) -> None:
    flight.take_off(1.0, 1.0, 1.0)
    flight.silence(1.5)
    flight.order(Order.STOP, np.zeros((3, 3)))
    flight.fly(1.0)
    assert (flight.air.height < ON_FLOOR).all()
    assert (flight.air.impact > MAX_IMPACT).all()


def test_agents_land_at_once_when_the_flight_has_ended(flight: Flight, tmp_path: Path) -> None:
    flight.take_off(0.5, 0.5, 0.5)
    flight.fly(1.0, np.tile([0.4, 0.0, 0.0], (3, 1)))
    flight.die()
    assert not flight.fallen
    assert "the flight has ended without closing its links: landing cf1, cf2, cf3" in log(tmp_path)


@pytest.mark.parametrize("seconds", [0.0, 0.2, 0.6])
def test_agents_land_that_had_just_been_commanded_to_take_off(
    flight: Flight, seconds: float
) -> None:
    flight.tick()
    flight.order(Order.TAKEOFF, np.tile([0.0, 0.0, 0.5], (3, 1)))
    flight.fly(seconds)
    flight.die()
    flight.air.sleep(3.0)
    assert not flight.fallen
    assert not (flight.air.fleet._info & int(Supervisor.FLYING)).any()


def test_agents_land_if_takeoff_arrives_after_the_flight_ended(flight: Flight) -> None:
    flight.tick()
    air, carry = flight.air, flight.air.carry
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(air, "carry", lambda *sent: air.later(1.0, lambda: carry(*sent)))
        flight.order(Order.TAKEOFF, np.tile([0.0, 0.0, 0.5], (3, 1)))
        flight.die()
        air.sleep(3.0)
    assert not flight.fallen
    assert not (flight.air.fleet._info & int(Supervisor.FLYING)).any()


@pytest.mark.parametrize("lost", [0, 1])
def test_no_takeoff_begins_after_the_flight_ended(bounded: Flight, lost: int) -> None:
    bounded.tick()
    for row in range(lost):
        bounded.cut(row, 0.5)
    bounded.order(Order.TAKEOFF, np.tile([0.0, 0.0, 0.5], (3, 1)))
    bounded.die()
    bounded.air.sleep(3.0)
    assert not bounded.fallen
    assert TAKEOFF not in bounded.air.ordered
    assert not (bounded.air.fleet._info & int(Supervisor.FLYING)).any()


def test_agents_land_whose_take_off_began_late(bounded: Flight) -> None:
    """Earlier commands to start were lost; the last one arrives after the flight has ended."""
    bounded.tick()
    air, began, carry = bounded.air, bounded.air.now, bounded.air.carry

    def carried(uri: str, packet: bytes) -> None:
        if packet[0] >> 4 != Port.HIGH_LEVEL or packet[1] != START_TRAJECTORY:
            carry(uri, packet)
        elif air.now > began + 1.8:
            bounded._closed = True
            air.later(0.4, lambda: carry(uri, packet))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(air, "carry", carried)
        bounded.order(Order.TAKEOFF, np.tile([0.0, 0.0, 0.5], (3, 1)))
        while not bounded._closed:
            bounded.tick()
        bounded.die()
        air.sleep(3.0)
    assert not bounded.fallen
    assert not (air.fleet._info & int(Supervisor.FLYING)).any()


def test_nothing_moves_when_a_flight_ends_on_the_ground(flight: Flight, tmp_path: Path) -> None:
    flight.fly(0.5)
    flight.silence(3.0)
    flight.die()
    assert not (tmp_path / "guardian.log").exists()
    assert not flight.air.impact.any()


def test_an_on_board_plan_is_not_interrupted_by_a_short_silence(flight: Flight) -> None:
    flight.take_off(0.5, 0.5, 0.5)
    flight.order(Order.GOTO, np.tile([1.0, 0.0, 0.5], (3, 1)), duration=3.0)
    flight.fly(1.0)
    flight.silence(0.9)
    flight.fly(2.0)
    away = flight.air.drones["position"][:, 0] - flight.starts[:, 0]
    np.testing.assert_allclose(away, 1.0, atol=0.05)


@pytest.mark.parametrize(
    "flight", [((0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (1.5, 0.0, 0.0))], indirect=True
)
def test_an_agent_above_another_lands_after_it_and_aside(flight: Flight, tmp_path: Path) -> None:
    flight.take_off(0.5, 1.4, 0.5)
    flight.order(Order.GOTO, np.array([[0.0, 0, 0.5], [-0.4, 0, 1.4], [0, 0, 0.5]]), duration=2.0)
    flight.fly(3.0)
    flight.fly(0.5, np.zeros((3, 3)))
    nearest: list[float] = []

    def watch() -> None:
        first, second, _third = flight.air.drones["position"]
        nearest.append(float(np.linalg.norm(first - second)))

    flight.air.watch = watch
    flight.die()
    assert not flight.fallen
    assert min(nearest) > 0.25
    assert "cf2 waits: an agent or an obstacle is below" in log(tmp_path)
    assert "cf2 lands 0." in log(tmp_path)


def test_an_agent_above_an_obstacle_lands_beside_it(flight: Flight, tmp_path: Path) -> None:
    """Not across a wall, though the nearest free position is there."""
    x, y = flight.starts[0, :2]
    table = tuple((x + dx, y + dy) for dx, dy in ((-1, -0.2), (0.1, -0.2), (0.1, 0.2), (-1, 0.2)))
    wall = tuple((x + dx, y + dy) for dx, dy in ((0.12, -1), (0.14, -1), (0.14, 0.6), (0.12, 0.6)))
    obstacles = Obstacle("table", (table,), (0.2, 0.4)), Obstacle("wall", (wall,), (0.0, 2.0))
    room = flight.guardian._scene
    world = dataclasses.replace(room.world, obstacles=obstacles)
    flight.guardian._scene = dataclasses.replace(room, world=world)
    flight.take_off(0.8, 0.5, 0.5)
    flight.die()
    assert not flight.fallen
    assert "cf1 waits: an agent or an obstacle is below" in log(tmp_path)
    landed = flight.air.drones["position"][0, :2] - (x, y)
    assert landed[0] < 0.12
    assert abs(landed[1]) > 0.2 + 0.1


def test_an_error_is_the_answer_and_the_guardian_goes_on(flight: Flight) -> None:
    flight.post("correct", "nonsense")
    answer = flight.tick()
    assert answer.problem == (
        "AttributeError: 'str' object has no attribute 'agent'",
        "plugin-failed",
    )
    assert flight.tick().problem is None


def test_closing_waits_for_the_landings(flight: Flight) -> None:
    flight.take_off(0.5, 0.5, 0.5)
    flight.silence(1.5)
    flight.call("close")
    assert not flight.fallen


def test_guardian_lands_a_drone_whose_link_returns_much_later(
    flight: Flight, tmp_path: Path
) -> None:
    flight.lose_in_take_off(15.0)
    flight.fly(2.0)
    flight.die()
    assert not flight.fallen
    assert "may be in the air: cf2 not heard for " in log(tmp_path)
    assert "cf2 hovers: it is commanded to land again" in log(tmp_path)
    assert log(tmp_path).endswith(" s\n")
    assert "all agents have landed, after 1" in log(tmp_path)


@pytest.mark.parametrize("seconds", [6.0, 12.0])
def test_motors_stop_of_a_drone_that_came_down_unheard(bounded: Flight, seconds: float) -> None:
    bounded.lose_in_take_off(seconds)
    bounded.fly(2.0)
    bounded.die()
    assert not bounded.fallen
    assert (bounded.air.drones["mode"] == 0).all()


def test_drones_of_unknown_height_land_and_stop_their_motors(
    flight: Flight, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    flight.guardian._landing_timeout = 20.0
    flight.take_off(0.4, 0.5, 0.6)
    report_unknown_heights(monkeypatch)
    died = flight.air.now
    flight.die()
    assert flight.air.now < died + 8.0
    assert not flight.fallen
    assert (flight.air.drones["mode"] == 0).all()
    assert caplog.text == ""


def test_closing_does_not_wait_for_a_link_and_the_guardian_stays(flight: Flight) -> None:
    flight.lose_in_take_off(15.0)
    flight.fly(2.0)
    closed = flight.air.now
    assert flight.call("close").value == [1]
    assert flight.air.now < closed + 10.0
    assert flight.air.height[1] > 0.3
    flight.guardian.run()  # until it ends by itself
    assert not flight.fallen
    assert flight._answers[-1] == Answer(None, value=[])


def test_the_guardian_gives_up_after_its_timeout(flight: Flight, tmp_path: Path) -> None:
    flight.guardian._landing_timeout = 20.0
    flight.lose_in_take_off()
    flight.die()
    assert flight.air.height[1] > 0.3
    last = log(tmp_path).splitlines()[-1]
    assert "given up 20 s after the flight, may be in the air: cf2 not heard for 2" in last


def test_signals_give_up_only_agents_that_are_not_heard(flight: Flight, tmp_path: Path) -> None:
    flight.lose_in_take_off()
    flight.air.later(0.5, flight.guardian.terminate)
    flight.die()
    assert (flight.air.height[[0, 2]] < ON_FLOOR).all()
    assert "given up" in log(tmp_path)


def test_guardian_does_not_wait_for_watchdog_stopped_drones(flight: Flight, tmp_path: Path) -> None:
    flight.take_off(0.5, 0.5, 0.5)
    flight.fly(1.0, np.zeros((3, 3)))
    flight.cut(1)
    flight.die()
    assert flight.air.drones["locked"].tolist() == [0, 1, 0]
    assert "down, at the latest by its own watchdog\n" in log(tmp_path)
    assert "all agents are down, after " in log(tmp_path)


def test_motors_are_stopped_again_when_the_link_returns(flight: Flight) -> None:
    flight.take_off(0.5, 0.5, 0.5)
    flight.cut(1, 10.0)
    flight.order(Order.STOP, np.zeros((3, 3)))
    flight.fly(3.0)
    assert flight.call("close").value == [1]
    assert flight.air.height[1] > 0.3
    flight.guardian.run()
    assert flight.air.height[1] < ON_FLOOR
    assert flight.air.impact[1] > MAX_IMPACT  # it is not landed: the operator stopped its motors
