"""Trajectories that agents fly on board: uploaded before take-off, and not steered."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import (
    Command,
    ContractError,
    Operator,
    Order,
    PluginError,
    Scene,
    TaskOutput,
    TaskSpec,
    Trajectory,
    Transform,
    hookimpl,
)
from star_core.discovery import Source
from star_core.toolkit import Refusal
from tests.core.conftest import Lab, Script
from tests.core.robots import Robots

SECONDS = 3.0
TRACE = "\n  - climb: {}\n  - trace: {agents: cf1}\n  - wait: {seconds: 1}\n"


def line(speed: float = 0.1) -> Trajectory:
    coefficients = np.zeros((2, 4, 8))
    coefficients[:, 0, 1] = speed
    coefficients[1, 0, 0] = speed
    return Trajectory([1.0, 1.0], coefficients)  # type: ignore[arg-type]


class Tracer:
    """Offers the verb ``trace``, whose agents fly `line` on board from the map's [1, 2, 1].

    Attributes:
        offers: What the task says that it may order.
    """

    def __init__(self) -> None:
        self.offers: Any = None

    @hookimpl
    def star_tasks(self) -> Iterable[TaskSpec]:
        schema = {"type": "object", "properties": {"speed": {}}}
        yield TaskSpec(name="trace", summary="Flies on board.", make=self._make, options=schema)

    def _make(self, _scene: Scene, rows: tuple[int, ...], speed: float = 0.1) -> Script:
        k = len(rows)
        command = Command(
            Order.FOLLOW,
            np.array(rows),
            np.tile([1.0, 2.0, 1.0], (k, 1)),
            np.zeros(k),
            np.full(k, SECONDS),
            line(speed),
        )
        task = Script(TaskOutput(commands=(command,)), lambda _e, _h, since: since >= SECONDS)
        offers = (line(speed),) if self.offers is None else self.offers
        task.trajectories = offers  # type: ignore[attr-defined]
        return task


@pytest.fixture
def tracer(lab: Lab) -> Tracer:
    tracer = Tracer()
    lab.registry.add(tracer, Source("their-dist:tracer", "1.0"))
    return tracer


@pytest.fixture
def uploads(tracer: Tracer, lab: Lab) -> list[tuple[Trajectory, ...]]:  # noqa: ARG001 -- it offers the verb
    """What the robots were given, and when: a transport that flies trajectories."""
    uploaded: list[tuple[Trajectory, ...]] = []

    class TrajectoryRobots(Robots):
        def upload(self, trajectories: tuple[Trajectory, ...]) -> None:
            assert not self.commands
            uploaded.append(trajectories)

    lab.robots_class = TrajectoryRobots
    return uploaded


def steered(lab: Lab, row: int = 0) -> list[float]:
    """Mission times at which an agent was sent a setpoint, s."""
    return [round(time, 6) for time, sent in lab.robots.sent if sent.active[row]]


def began(lab: Lab) -> float:
    """Mission time at which the trajectory was ordered, s."""
    return next(time for time, command in lab.robots.commands if command.order is Order.FOLLOW)


def test_every_trajectory_is_uploaded_once_before_anything_moves(
    lab: Lab, uploads: list[tuple[Trajectory, ...]]
) -> None:
    steps = "\n  - climb: {}\n  - repeat: {times: 2, steps: [trace: {}, trace: {agents: cf2}]}"
    assert lab.fly(f"{steps}\n  - trace: {{speed: 0.2}}\n")["outcome"] == "completed"
    assert uploads == [(line(), line(0.2))]


def test_nothing_is_uploaded_if_nothing_is_flown_on_board(
    lab: Lab, uploads: list[tuple[Trajectory, ...]]
) -> None:
    lab.fly()
    assert uploads == []


@pytest.mark.usefixtures("tracer")
def test_transports_without_trajectories_are_refused_unconnected(lab: Lab) -> None:
    lab.spoil("transport", "connect", RuntimeError("opened"))
    with pytest.raises(PluginError) as raised:
        lab.fly(TRACE)
    assert str(raised.value) == (
        "transport 'robots' (their-dist 1.2:lab): flies no trajectories on board [plugin-failed]"
    )
    assert lab.closed["transport"] == 1


@pytest.mark.usefixtures("uploads")
def test_nothing_moves_when_an_upload_fails(lab: Lab) -> None:
    lab.spoil("transport", "upload", PluginError("no room"))
    with pytest.raises(PluginError, match=r"transport 'robots' .*: no room"):
        lab.fly(TRACE)
    assert lab.robots.commands == []


@pytest.mark.usefixtures("uploads")
def test_a_trajectory_is_ordered_in_each_odometry_frame(lab: Lab) -> None:
    lab.frames = Transform(np.full(2, math.pi / 2), np.array([[1.0, 2.0, 0.3], [1.0, 4.0, 0.3]]))
    lab.fly("\n  - climb: {}\n  - trace: {}\n")
    command = next(c for _, c in lab.robots.commands if c.order is Order.FOLLOW)
    assert command.position == pytest.approx(np.array([[0.0, 0.0, 0.7], [-2.0, 0.0, 0.7]]))
    assert command.yaw == pytest.approx([-math.pi / 2] * 2)
    assert command.trajectory == line()


@pytest.mark.usefixtures("uploads")
def test_on_board_flight_suspends_steering_until_its_end(lab: Lab) -> None:
    assert lab.fly(TRACE)["outcome"] == "completed"
    begin, times = began(lab), np.array(steered(lab))
    assert not ((times >= begin) & (times < begin + SECONDS - 1e-6)).any()
    assert (times >= begin + SECONDS - 1e-6).sum() >= 9
    assert set(lab.went("cf1")) == {"taking_off", "flying", "landing", "landed"}
    others = np.array(steered(lab, 1))
    assert ((others >= begin) & (others < begin + SECONDS)).sum() >= 29


@pytest.mark.usefixtures("uploads")
def test_an_agent_is_steered_again_when_its_step_ends_early(lab: Lab) -> None:
    early = "\n  - climb: {}\n  - trace: {until: {elapsed: 1}}\n  - wait: {seconds: 1}\n"
    assert lab.fly(early)["outcome"] == "completed"
    times = np.array(steered(lab))
    assert times[times >= began(lab)].min() == pytest.approx(began(lab) + 1.0, abs=0.11)


@pytest.mark.usefixtures("uploads")
def test_an_agent_is_steered_again_when_its_step_fails(lab: Lab) -> None:
    late = "{agents: cf1, timeout: 1, on_failure: continue}"
    lab.fly(f"\n  - climb: {{}}\n  - trace: {late}\n  - wait: {{seconds: 1}}\n")
    times = np.array(steered(lab))
    assert times[times >= began(lab)].min() == pytest.approx(began(lab) + 1.0, abs=0.11)


@pytest.mark.usefixtures("uploads")
def test_agents_removed_by_a_safety_rule_are_steered_again(lab: Lab) -> None:
    def receive(right: Any) -> Any:
        telemetry = right()
        follows = any(command.order is Order.FOLLOW for _, command in lab.robots.commands)
        return replace(telemetry, battery=np.array([3.0 if follows else 4.0, 4.0]))

    lab.spoil("transport", "receive", receive)
    lab.fly(f"{TRACE}safety: {{battery_low: {{below: 3.5, then: hold}}}}\n")
    first = min(time for time in steered(lab) if time >= began(lab))
    assert "cf1 holds its position: battery" in "".join(lab.said("safety"))
    assert first < began(lab) + SECONDS - 0.5


@pytest.mark.usefixtures("uploads")
def test_operator_stop_lands_agents_out_of_a_trajectory(lab: Lab) -> None:
    operator = Operator()

    def end(right: Any, command: Command) -> None:
        right(command)
        if command.order is Order.FOLLOW:
            operator.stops += 1

    lab.spoil("transport", "command", end)
    assert lab.fly(TRACE, operator)["outcome"] == "aborted"
    assert sorted(lab.ordered(Order.LAND)) == [0, 1]
    assert lab.went("cf1")[-2:] == ["landing", "landed"]


@pytest.mark.usefixtures("uploads")
def test_a_step_fails_when_an_agent_refuses_its_trajectory(lab: Lab) -> None:
    def receive(right: Any) -> Any:
        orders = [command.order for _, command in lab.robots.commands]
        said = (Refusal(0, "refuses it"),) if orders[-1:] == [Order.FOLLOW] else ()
        return replace(right(), refusals=said)

    lab.spoil("transport", "receive", receive)
    summary = lab.fly(TRACE)
    assert summary["outcome"] == "failed"
    assert summary["reason"].endswith("trace cf1 failed: cf1 refuses it")


@pytest.mark.usefixtures("uploads")
def test_a_task_that_orders_what_was_not_uploaded_is_named(lab: Lab, tracer: Tracer) -> None:
    tracer.offers = (line(0.7),)
    reason = lab.fly(TRACE)["reason"]
    assert reason.startswith("task 'trace' (their-dist 1.0:tracer): orders a trajectory that no ")


@pytest.mark.usefixtures("uploads")
def test_a_task_with_something_else_for_a_trajectory_is_named(lab: Lab, tracer: Tracer) -> None:
    tracer.offers = (3,)
    with pytest.raises(PluginError, match=r"task 'trace' .*: trajectories has int, expected Traj"):
        lab.fly(TRACE)


numbers = st.lists(st.floats(-2, 2), min_size=32, max_size=32)


@given(numbers, st.floats(0.1, 9))
def test_trajectories_with_the_same_numbers_are_one(terms: list[float], duration: float) -> None:
    trajectory, same = (Trajectory([duration], np.reshape(terms, (1, 4, 8))) for _ in range(2))  # type: ignore[arg-type]
    assert trajectory == same
    assert len({trajectory, same, Trajectory([2 * duration], same.coefficients)}) == 2  # type: ignore[arg-type]
    assert trajectory != "another"


@pytest.mark.parametrize(
    ("duration", "coefficients", "message"),
    [
        ([], np.zeros((0, 4, 8)), r"duration is \[\], expected one or more numbers above 0"),
        ([1.0, 0.0], np.zeros((2, 4, 8)), r"duration is \[1.0, 0.0\], expected one or more"),
        ([math.inf], np.zeros((1, 4, 8)), r"duration is \[inf\], expected one or more"),
        ([1.0], np.zeros((1, 3, 8)), r"coefficients has shape \(1, 3, 8\), expected \(1, 4, 8\)"),
        ([1.0], np.full((1, 4, 8), np.nan), r"Trajectory.coefficients are not all finite"),
    ],
)
def test_what_is_no_trajectory_is_refused(
    duration: Sequence[float], coefficients: Any, message: str
) -> None:
    with pytest.raises(ContractError, match=message):
        Trajectory(duration, coefficients)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("order", "numbers", "message"),
    [
        (Order.FOLLOW, {"trajectory": None}, "of the order 'follow' is NoneType, expected a Traj"),
        (Order.GOTO, {"trajectory": line()}, "of the order 'goto' is Trajectory, expected None"),
        (Order.FOLLOW, {"trajectory": line(), "duration": 0.0}, "duration is [0.0], expected more"),
        (Order.TAKEOFF, {"duration": math.inf}, "Command.duration is [inf], expected more than 0"),
        (Order.LAND, {"z": math.nan}, "position is [[0.0, 0.0, nan]], expected numbers"),
        (Order.GOTO, {"x": math.nan}, "position is [[nan, 0.0, 0.0]], expected numbers"),
        (Order.GOTO, {"yaw": math.nan}, "Command.yaw is [nan], expected numbers"),
        ("up", {}, "Command.order is 'up', expected an Order"),
    ],
)
def test_an_order_that_makes_no_sense_is_refused(
    order: Order, numbers: dict[str, Any], message: str
) -> None:
    with pytest.raises(ContractError, match=re.escape(message)):
        reported(order, **numbers)


@pytest.mark.parametrize(
    ("order", "numbers"),
    [
        (Order.ARM, {"z": math.nan, "yaw": math.nan, "duration": 0.0}),
        (Order.STOP, {"z": math.nan, "yaw": math.nan, "duration": 0.0}),
        (Order.TAKEOFF, {"x": math.nan, "yaw": math.nan}),
        (Order.LAND, {"x": math.nan, "yaw": math.nan}),
    ],
)
def test_what_an_order_does_not_use_need_not_be_a_number(
    order: Order, numbers: dict[str, Any]
) -> None:
    assert reported(order, **numbers).order is order


def reported(
    order: Order,
    *,
    x: float = 0.0,
    z: float = 0.0,
    yaw: float = 0.0,
    duration: float = 1.0,
    trajectory: Trajectory | None = None,
) -> Command:
    return Command(order, [0], [[x, 0.0, z]], [yaw], [duration], trajectory)  # type: ignore[arg-type]
