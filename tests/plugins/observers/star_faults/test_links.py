"""What faults make of single reports, setpoints, commands, calls and landmarks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from star_core import Agent, Command, Fence, Order, Scene, Setpoint, Tag, Telemetry, World
from star_core.toolkit import Fault
from star_faults.injector import FaultInjector
from star_faults.links import ReportFaults, SendFaults
from star_faults.outputs import OutputFaults
from star_faults.tables import Passing

N = 3
SCENE = Scene(
    agents=tuple(Agent(f"cf{i}", (float(i), 0.0, 0.0)) for i in range(N)),
    world=World("room", Fence((-5.0, -5.0, 0.0), (5.0, 5.0, 3.0))),
    seed=3,
    period=0.05,
)
MOVED = {"offset": [0.0, 0.3, 0.0]}  # m
TIMES = np.arange(41) * 0.05  # s


def fault(component: str, mode: str, **values: Any) -> Fault:
    """Return a fault of the second agent, from 0.5 s to 1.5 s."""
    return Fault(component, mode, 0.5, {1: 1.5}, values, 0)


def random() -> np.random.Generator:
    return np.random.default_rng(3)


def setpoint(speed: float) -> Setpoint:
    return Setpoint(np.full((N, 3), speed), np.zeros(N), np.ones(N, np.bool_))


def test_rows_of_a_slow_link_pass_at_its_rate() -> None:
    passing = Passing(fault("telemetry", "slow", rate=4.0), random(), N)
    fresh = np.array([passing.fresh(time) for time in TIMES])
    passed = TIMES[fresh[:, 1] & (TIMES >= 0.5) & (TIMES < 1.5)]
    assert passed == pytest.approx([0.5, 0.75, 1.0, 1.25])
    assert fresh[:, [0, 2]].all()


def test_delayed_reports_are_at_least_the_delay_old() -> None:
    reports = ReportFaults(fault("telemetry", "delayed", delay=0.24), random(), SCENE)
    for time in TIMES:
        position, row = np.full((N, 3), time), np.zeros(N)
        state = np.zeros(N, np.int64)
        telemetry = Telemetry(time, position, position, np.zeros((N, 4)), row, state, row + 0.01)
        report = reports.report(telemetry, time)
        late = 0.25 if 0.5 <= time < 1.5 else 0.0
        assert report.position[:, 0] == pytest.approx([time, time - late, time])
        assert report.age == pytest.approx([0.01, 0.01 + late, 0.01])


@pytest.mark.parametrize(
    ("mode", "values", "arrives"),
    [("off", {}, None), ("slow", {"rate": 4.0}, 0.85), ("delayed", {"delay": 0.28}, 0.9)],
)
def test_commands_of_a_bad_link_arrive_late_or_never(
    mode: str, values: dict[str, float], arrives: float | None
) -> None:
    faulty = SendFaults(fault("link", mode, **values), random(), SCENE)
    received: list[tuple[float, list[int]]] = []
    now = 0.0

    def receive(command: Command) -> None:
        received.append((now, command.agent.tolist()))

    _, command = faulty.wrap(lambda setpoint: setpoint, receive)
    rows = np.arange(N)
    for time in TIMES:
        now = float(time)
        faulty.deliver(now)
        if time == TIMES[12]:
            command(Command(Order.LAND, rows, np.zeros((N, 3)), np.zeros(N), np.ones(N)))
    assert received[0] == (TIMES[12], [0, 2])
    assert [arrival for arrival in received[1:] if arrival[1] != [1]] == []
    late = [time for time, _ in received[1:]]
    assert late == ([] if arrives is None else pytest.approx([arrives]))


def test_setpoints_are_not_sent_while_the_link_is_off() -> None:
    faulty = SendFaults(fault("link", "off"), random(), SCENE)
    arrived: list[Setpoint] = []

    def receive(setpoints: Setpoint) -> Setpoint:
        arrived.append(setpoints)
        return setpoints

    send, _ = faulty.wrap(receive, lambda _command: None)
    for time in TIMES:
        faulty.deliver(float(time))
        assert send(setpoint(time)).active.all()
    off = (TIMES >= 0.5) & (TIMES < 1.5)
    np.testing.assert_array_equal([arrival.active[1] for arrival in arrived], ~off)
    assert all(arrival.active[[0, 2]].all() for arrival in arrived)


def test_a_plugin_fails_in_the_given_fraction_of_its_calls() -> None:
    now = 0.0
    broken = fault("plugin", "intermittent", loss=0.3)
    call = OutputFaults(broken, random(), lambda: "output", lambda: now)
    outputs = []
    for time in [0.2] * 50 + [1.0] * 400:
        now = time
        try:
            outputs.append(call())
        except RuntimeError:
            outputs.append("failed")
    assert outputs[:50].count("failed") == 0
    assert outputs[50:].count("failed") / 400 == pytest.approx(0.3, abs=0.06)


def test_exchanged_landmarks_are_at_the_positions_of_each_other() -> None:
    level = (0.0, 0.0, 0.0, 1.0)
    tags = [Tag(i, 0.1, (float(i), 0.0, 1.0), level, name) for i, name in enumerate("abc")]
    world = World("room", SCENE.world.fence, landmarks=tuple(tags))
    swapped = Fault("tags", "wrong", 0.0, {}, {"swap": True, "tags": ["a", "c"]} | MOVED, 0)
    landmarks = FaultInjector(SCENE, [swapped])._world(world).landmarks
    assert [tag.position[0] for tag in landmarks] == [2.0, 1.0, 0.0]
    moved = Fault("tags", "wrong", 0.0, {}, {"swap": False, "tags": ["b"]} | MOVED, 0)
    landmarks = FaultInjector(SCENE, [moved])._world(world).landmarks
    assert [tag.position for tag in landmarks] == [
        (0.0, 0.0, 1.0),
        (1.0, 0.3, 1.0),
        (2.0, 0.0, 1.0),
    ]
    gone = Fault("tags", "off", 0.0, {}, {"tags": ["b"]}, 0)
    assert [tag.of for tag in FaultInjector(SCENE, [gone])._world(world).landmarks] == ["a", "c"]
