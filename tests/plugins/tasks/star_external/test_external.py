"""The verb ``external``, step by step, with a client on the loopback."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import monotonic
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from star_core import Estimate, Goals, Scene, Status, TaskOutput
from star_core.testing import estimate, health
from star_external.external import External
from star_external.process_source import MAX_LINES, ProcessSource
from star_external.tcp_server import TcpServer

AIR = np.array([[-1.0, 0.0, 0.8], [0.0, 0.0, 0.8], [1.0, 0.0, 0.8]])
SOMEWHERE = {"goals": {"cf1": {"position": [0.5, 0.5, 1.0]}}}
ALIVE: dict[str, Any] = {"goals": {}}
SOON = 5.0  # s

Connect = Callable[[], Any]
Make = Callable[..., External]


def at(time: float) -> Estimate:
    return estimate(AIR, time=time)


def door_of(task: External) -> TcpServer:
    assert isinstance(task._source, ProcessSource)
    return task._source.server


def begun(task: External) -> External:
    assert task.begin(at(0.0), health(3)) == 60.0
    return task


def step(task: External, time: float = 0.0) -> TaskOutput:
    return task.step(at(time), health(3))


def flying(task: External, client: Any, *lines: Any, time: float = 0.0) -> TaskOutput:
    """Send what is to be lines, and step until it is heard."""
    client.send(*lines)
    server, until = door_of(task), monotonic() + SOON
    while server._client is None or b"\n" not in server._received:
        server.receive(0, 0.01)
        assert monotonic() < until
    return step(task, time)


def goals(of: TaskOutput) -> Goals:
    assert of.goals is not None
    return of.goals


@pytest.fixture
def client(connect: Connect) -> Any:
    return connect()


@pytest.fixture
def task(external: Make, client: Any) -> External:  # noqa: ARG001 -- which is connected first
    """Return a task without lock step, that has begun."""
    return begun(external(lockstep=False))


def test_the_client_is_greeted(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(lockstep=False, rate=10))
    step(task)
    assert client.receive() == {
        "star": 1,
        "agents": ["cf1", "cf2"],
        "rate": 10.0,
        "lockstep": False,
        "limits": {
            "speed": 0.5,
            "acceleration": 2.0,
            "height": [0.2, 1.8],
            "separation": 0.2,
            "vertical_separation": 0.6,
        },
        "fence": {"low": [-10.0, -10.0, 0.0], "high": [10.0, 10.0, 3.0]},
    }


def test_the_client_receives_the_state_of_its_agents(client: Any, task: External) -> None:
    step(task, 1.25)
    client.receive()
    agent = {"velocity": [0.0, 0.0, 0.0], "yaw": 0.0, "phase": "flying", "battery": 4.0}
    assert client.receive() == {
        "time": 1.25,
        "agents": {
            "cf1": {"position": [-1.0, 0.0, 0.8], **agent},
            "cf2": {"position": [0.0, 0.0, 0.8], **agent},
        },
    }


def test_what_is_not_known_of_an_agent_is_null(client: Any, task: External) -> None:
    lost = replace(at(0.0), valid=np.array([False, True, True]))
    task.step(lost, replace(health(3), battery=np.array([np.nan, 4.0, 4.0])))
    client.receive()
    assert client.receive()["agents"]["cf1"] == {
        "position": None, "velocity": None, "yaw": None, "phase": "flying", "battery": None,
    }  # fmt: skip


def test_state_lines_come_at_the_rate(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(lockstep=False, rate=5))
    for tick in range(9):
        step(task, tick * 0.05)
    client.receive()
    assert [client.receive()["time"] for _ in range(3)] == [0.0, 0.2, 0.4]


def test_agents_keep_what_they_do_until_they_are_given_goals(
    external: Make, connect: Connect
) -> None:
    connect()
    assert step(begun(external(lockstep=False))) == TaskOutput()


def test_agents_are_sent_to_the_goals(client: Any, task: External) -> None:
    goal = {"position": [0.5, 0.5, 1.0], "velocity": [0.1, 0, 0], "yaw": 1.0, "speed": 0.3}
    targets = goals(flying(task, client, {"goals": {"cf2": goal}}))
    assert targets.active.tolist() == [False, True, False]
    assert targets.position[1].tolist() == [0.5, 0.5, 1.0]
    assert targets.velocity[1].tolist() == [0.1, 0.0, 0.0]
    assert (targets.yaw[1], targets.speed[1]) == (1.0, 0.3)
    flying(task, client, SOMEWHERE)
    kept = goals(step(task, 0.05))  # a goal stays until there is another
    assert kept.position[0].tolist() == [0.5, 0.5, 1.0]
    assert kept.speed[0] == 0.5  # the mission's limit


def test_a_step_ends_when_the_client_is_done(client: Any, task: External) -> None:
    assert flying(task, client, {"done": True}).status is Status.SUCCESS
    assert client.receive()["star"] == 1
    client.receive()
    assert client.receive() is None


def test_a_step_fails_when_the_client_gives_up(client: Any, task: External) -> None:
    ended = flying(task, client, {"fail": "no way"})
    assert (ended.status, ended.reason) == (
        Status.FAILURE, "the other process gave up: no way",
    )  # fmt: skip


def test_a_wrong_line_is_answered_and_changes_nothing(client: Any, task: External) -> None:
    both = {"goals": {"cf1": {"position": [0, 0, 1]}, "cf3": {"position": [0, 0, 1]}}}
    assert flying(task, client, both).goals is None
    client.receive()
    client.receive()
    assert client.receive() == {
        "error": "no agent named 'cf3' in this step; there are: cf1, cf2 [invalid-message]",
        "line": 1,
    }  # fmt: skip


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.binary(min_size=1, max_size=80), max_size=9))
def test_the_step_continues_and_answers_every_invalid_line(
    external: Make, connect: Connect, noise: list[bytes]
) -> None:
    lines = [line.replace(b"\n", b"?") for line in noise]
    wrong = [i for i, line in enumerate(lines, start=1) if line.strip()]
    task, client = begun(external(lockstep=False)), connect()
    door_of(task).disconnect()
    door_of(task).holder = None
    assert door_of(task).accept(SOON)
    client.send(*(line + b"\n" for line in lines), SOMEWHERE)
    until = monotonic() + SOON
    while step(task).goals is None:
        assert monotonic() < until
    door_of(task).disconnect()
    received = iter(client.receive, None)
    assert [line["line"] for line in received if "error" in line] == wrong


def test_a_line_that_is_too_long_is_answered(client: Any, task: External) -> None:
    step(task)
    client.receive()
    client.receive()
    client.send(70000 * b"x" + b"\n")
    for tick in range(1, 10):
        door_of(task).receive(0, 0.05)
        step(task, tick * 0.05)
    lines = [client.receive() for _ in range(9)]
    assert {"error": "the line is longer than 65536 bytes", "line": 1} in lines


def test_so_many_lines_are_heard_in_a_tick(client: Any, task: External) -> None:
    lines = [{"goals": {"cf1": {"position": [i / 100, 0, 1]}}} for i in range(2 * MAX_LINES)]
    client.send(*lines)
    door_of(task).accept(SOON)
    door_of(task).receive(0, 0.2)
    assert goals(step(task)).position[0, 0] == (MAX_LINES - 1) / 100
    assert goals(step(task)).position[0, 0] == (2 * MAX_LINES - 1) / 100


def test_waiting_for_a_client_is_logged_once(
    external: Make, connect: Connect, caplog: pytest.LogCaptureFixture
) -> None:
    task = begun(external(lockstep=False))
    step(task)
    step(task, 0.05)
    host, port = door_of(task).address
    assert caplog.messages == [f"external: listening on {host}:{port}, waiting for a client"]
    client, task = connect(), begun(external(lockstep=False))
    flying(task, client, SOMEWHERE)


def test_rejected_lines_are_reported_once_per_kind_and_counted(client: Any, task: External) -> None:
    flying(task, client, ALIVE)
    said: list[str] = []
    for i in range(10):
        said += flying(task, client, {"goals": {"cf1": {"position": [90 + i, 0, 1]}}}).messages
    said += flying(task, client, {"go": 1}).messages
    assert [text.partition(":")[0] for text in said] == [
        "rejected line 2",
        "rejected 10 such lines so far, the last",
        "rejected line 12",
    ]
    assert "90" in said[0]
    assert "99" in said[1]
    assert step(task).messages == ()


def test_agents_hold_when_the_client_is_silent(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(lockstep=False, max_silence=1.0))
    flying(task, client, SOMEWHERE)
    assert goals(step(task, 0.95)).position[0].tolist() == [0.5, 0.5, 1.0]
    held = step(task, 1.0)
    assert held.status is Status.RUNNING
    assert goals(held).position[:2].tolist() == AIR[:2].tolist()
    assert goals(held).active.tolist() == [True, True, False]


def test_it_flies_on_when_it_is_heard_again(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(lockstep=False, max_silence=1.0))
    flying(task, client, ALIVE)
    step(task, 5.0)
    again = flying(task, client, SOMEWHERE, time=5.05)
    assert goals(again).position[0].tolist() == [0.5, 0.5, 1.0]
    assert goals(step(task, 6.0)).position[0].tolist() == [0.5, 0.5, 1.0]


def test_silence_can_fail_the_step(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(lockstep=False, max_silence=1.0, on_silence="fail"))
    flying(task, client, ALIVE)
    ended = step(task, 1.0)
    assert (ended.status, ended.reason) == (
        Status.FAILURE, "the other process sent nothing for 1 s",
    )  # fmt: skip


def test_a_wrong_line_is_no_sign_of_life(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(lockstep=False, max_silence=1.0, on_silence="fail"))
    flying(task, client, ALIVE)
    assert flying(task, client, b"nonsense\n", time=1.0).status is Status.FAILURE


def test_a_client_that_comes_back_is_greeted_and_flies_on(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(lockstep=False, max_silence=1.0))
    flying(task, client, ALIVE)
    client.close()
    while door_of(task).connected:
        step(task, 0.05)
    client = connect()
    output = flying(task, client, SOMEWHERE, time=0.5)
    assert client.receive()["star"] == 1
    assert goals(output).position[0].tolist() == [0.5, 0.5, 1.0]


def test_the_step_fails_if_no_client_connects(external: Make) -> None:
    task = begun(external(lockstep=False, response_timeout=3.0))
    step(task)
    assert step(task, 2.95).status is Status.RUNNING
    ended = step(task, 3.0)
    host, port = door_of(task).address
    assert ended.reason == f"no client connected to {host}:{port} within 3 s"


def test_in_lock_step_the_computers_time_counts(external: Make) -> None:
    ended = step(begun(external(response_timeout=0.05)))
    assert ended.status is Status.FAILURE
    assert ended.reason.endswith("within 0.05 s")


def test_in_lock_step_each_state_has_one_answer(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(response_timeout=SOON))
    client.send(*({"goals": {"cf1": {"position": [i, 0, 1]}}} for i in range(4)))
    positions = [goals(step(task, tick * 0.05)).position[0, 0] for tick in range(4)]
    assert positions == [0.0, 1.0, 2.0, 3.0]


def test_in_lock_step_a_wrong_line_is_an_answer(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(response_timeout=SOON))
    client.send(b"nonsense\n", SOMEWHERE)
    assert step(task).goals is None
    assert goals(step(task, 0.05)).position[0].tolist() == [0.5, 0.5, 1.0]


def test_in_lock_step_only_states_are_answered(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(response_timeout=SOON, rate=10))
    client.send(*({"goals": {"cf1": {"position": [i, 0, 1]}}} for i in range(2)))
    positions = [goals(step(task, tick * 0.05)).position[0, 0] for tick in range(4)]
    assert positions == [0.0, 0.0, 1.0, 1.0]


def test_lockstep_does_not_wait_twice_for_a_late_answer(external: Make, connect: Connect) -> None:
    client, task = connect(), begun(external(response_timeout=0.05, max_silence=1.0))
    assert step(task) == TaskOutput()
    for tick in range(1, 20):
        step(task, tick * 0.05)
    assert client.receive()["star"] == 1
    assert client.receive()["time"] == 0.0
    late = flying(task, client, SOMEWHERE, time=1.0)
    assert goals(late).position[0].tolist() == [0.5, 0.5, 1.0]
    client.send(ALIVE)
    step(task, 1.05)
    assert client.receive()["time"] == 1.05  # no state stood between without an answer


def test_on_hardware_nothing_waits(
    external: Make, server: TcpServer, room: Scene, connect: Connect
) -> None:
    connect()
    server.accept(SOON)
    hardware = replace(room, realtime=True)
    task = begun(external(scene=hardware, response_timeout=1000.0))
    assert step(task) == TaskOutput()


def test_goals_of_a_removed_agent_are_dropped_and_refused(client: Any, task: External) -> None:
    flying(task, client, SOMEWHERE)
    task.on_agents_removed((1,))
    assert step(task, 0.05).goals is None
    assert flying(task, client, SOMEWHERE, time=0.1).goals is None
    lines = [client.receive() for _ in range(6)]
    assert [line["agents"] for line in lines if "star" in line] == [["cf1", "cf2"], ["cf2"]]
    assert lines[-1]["error"] == (
        "no agent named 'cf1' in this step; there are: cf2 [invalid-message]"
    )


def test_a_replacement_inherits_the_goal(client: Any, task: External) -> None:
    flying(task, client, SOMEWHERE)
    task.on_agent_replaced(0, 2)
    targets = goals(step(task, 0.05))
    assert targets.active.tolist() == [False, False, True]
    assert targets.position[2].tolist() == [0.5, 0.5, 1.0]


def test_an_agent_that_joins_can_be_given_goals(client: Any, task: External) -> None:
    task.on_agents_added((0, 1, 2))
    targets = goals(flying(task, client, {"goals": {"cf3": {"position": [0, 0, 1]}}}))
    assert targets.active.tolist() == [False, False, True]


def test_a_step_takes_the_port_over_from_one_that_was_ended(
    client: Any, task: External, external: Make, connect: Connect
) -> None:
    step(task)
    following = begun(external(lockstep=False))
    assert step(following) == TaskOutput()
    step(following, 0.05)
    client.receive()
    client.receive()
    assert client.receive() is None
    client = connect()
    assert flying(following, client, SOMEWHERE, time=0.1).goals is not None


def test_two_steps_at_once_cannot_have_one_port(external: Make, connect: Connect) -> None:
    connect()
    first, second = begun(external(lockstep=False)), begun(external(lockstep=False))
    step(first)
    step(second)
    step(first, 0.05)
    ended = step(second, 0.05)
    host, port = door_of(first).address
    assert ended.status is Status.FAILURE
    assert ended.reason == (
        f"another running step listens on {host}:{port}; give each step its own 'port'"
    )
    assert step(first, 0.1).status is Status.RUNNING


@pytest.mark.parametrize("rate", [None, 10])
def test_external_steps_follow_one_that_ended_itself_at_once(
    external: Make, connect: Connect, rate: float | None
) -> None:
    client, task = connect(), begun(external(lockstep=False, rate=rate))
    flying(task, client, {"done": True})
    client = connect()
    assert flying(begun(external(lockstep=False)), client, SOMEWHERE).goals is not None
