"""The operator ends a flight: once lands all agents, twice stops the motors."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Timer

import pytest

from star_core import Operator, Order, Tick, hookimpl
from star_core.discovery import Source
from tests.core.conftest import Lab

HANGS = 300.0  # s: a flight here takes a few, and compiling before it a minute or two
STAR_RUN = Path(sys.executable).with_name("star-run")
ACKNOWLEDGED = "star: SIGINT: landing; again stops the motors"


def interrupted(lab: Lab, *times: float) -> Operator:
    """Interrupts that are raised at these mission times, s, while the transport waits."""
    operator = Operator()

    def wait(right: Callable[[float], float], until: float) -> float:
        operator.stops = sum(time <= until for time in times)
        return right(until)

    lab.spoil("transport", "wait", wait)
    return operator


def test_one_interrupt_lands_all_agents_and_aborts(lab: Lab) -> None:
    summary = lab.fly(operator=interrupted(lab, 2.0))
    assert (summary["outcome"], summary["reason"]) == ("aborted", "interrupted by the operator")
    assert sorted(lab.ordered(Order.LAND)) == [0, 1]
    assert lab.ordered(Order.STOP) == []
    assert [lab.went(name)[-1] for name in lab.swarm] == ["landed", "landed"]
    assert lab.went(None) == ["flying", "aborted"]
    assert lab.said("interrupt") == ["the operator ends the flight: all agents land"]


def test_no_step_goes_on_after_an_interrupt(lab: Lab) -> None:
    lab.fly(operator=interrupted(lab, 2.0))
    assert lab.said("step")[-1].endswith("wait cf1, cf2 begins")
    assert max(time for time, _ in lab.robots.sent) == pytest.approx(2.0)


def test_an_interrupt_before_anybody_flies_orders_nothing(lab: Lab) -> None:
    summary = lab.fly("\n  - wait: {seconds: 1}\n  - climb: {}", operator=interrupted(lab, 0.5))
    assert summary["outcome"] == "aborted"
    assert lab.robots.commands == []


def test_an_interrupt_before_the_first_tick_starts_nothing(lab: Lab) -> None:
    class Waiting:
        @hookimpl
        def star_mission_started(self, operator: Operator) -> None:
            operator.land_all()

    lab.registry.add(Waiting(), Source("their-dist:waiting"))
    summary = lab.fly()
    assert summary["outcome"] == "aborted"
    assert summary["reason"] == "not started: interrupted by the operator"
    assert (lab.robots.commands, lab.robots.sent) == ([], [])
    assert lab.said("step") == []


def test_interrupts_during_landing_order_no_second_landing(lab: Lab) -> None:
    summary = lab.fly(operator=interrupted(lab, 3.5))
    assert summary["outcome"] == "aborted"
    assert sorted(lab.ordered(Order.LAND)) == [0, 1]


@pytest.mark.parametrize("times", [(2.0, 3.0), (2.0, 2.0)], ids=["while landing", "at once"])
def test_two_interrupts_stop_the_motors_and_abort(lab: Lab, times: tuple[float, ...]) -> None:
    summary = lab.fly(operator=interrupted(lab, *times))
    assert summary["outcome"] == "aborted"
    assert summary["reason"] == "interrupted by the operator; stopped, motors off"
    assert sorted(lab.ordered(Order.STOP)) == [0, 1]
    assert [lab.went(name)[-1] for name in lab.swarm] == ["emergency", "emergency"]
    assert lab.said("interrupt")[-1] == "the operator stops the motors of cf1, cf2"
    assert lab.closed["transport"] == 1


def test_landings_begun_by_a_step_are_awaited_to_their_end(lab: Lab) -> None:
    steps = "\n  - climb: {}\n  - descend: {seconds: 18}"
    summary = lab.fly(steps, operator=interrupted(lab, 3.0))
    assert summary["reason"] == "interrupted by the operator"
    assert all(lab.went(name)[-1] == "landed" for name in lab.swarm)


def test_the_motors_of_agents_that_are_down_are_not_stopped(lab: Lab) -> None:
    lab.fly(
        "\n  - climb: {}\n  - descend: {agents: cf1}\n  - wait: {seconds: 7, agents: cf2}",
        operator=interrupted(lab, 6.5, 7.0),
    )
    assert lab.ordered(Order.STOP) == [1]


def test_two_interrupts_stop_the_motors_despite_a_broken_plugin(lab: Lab) -> None:
    lab.spoil("planner", "plan", RuntimeError("boom"), range(20, 10**6))
    summary = lab.fly(operator=interrupted(lab, 3.0, 3.0))
    assert summary["outcome"] == "failed"
    assert summary["reason"].endswith("; stopped, motors off")
    assert sorted(lab.ordered(Order.STOP)) == [0, 1]


class StopButton:
    """An observer through which the operator ends a flight at a mission time, s."""

    def __init__(self, moment: float, press: Callable[[Operator], None]) -> None:
        self._moment, self._press = moment, press

    @hookimpl
    def star_mission_started(self, operator: Operator) -> None:
        self._operator = operator

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        if tick.time >= self._moment:
            self._press(self._operator)


@pytest.mark.parametrize(
    ("press", "order", "reason"),
    [
        (Operator.land_all, Order.LAND, "interrupted by the operator"),
        (Operator.stop_motors, Order.STOP, "interrupted by the operator; stopped, motors off"),
    ],
)
def test_an_observer_ends_the_flight_for_the_operator(
    lab: Lab, press: Callable[[Operator], None], order: Order, reason: str
) -> None:
    lab.registry.add(StopButton(2.0, press), Source("their-dist:button"))
    assert lab.fly()["reason"] == reason
    assert sorted(lab.ordered(order)) == [0, 1]


@contextmanager
def in_the_air(mission: Path) -> Iterator[subprocess.Popen[str]]:
    """Fly a mission in a process of its own, in real time, and go on once all agents hover."""
    command = [str(STAR_RUN), str(mission), "--speed", "1", "--no-record"]
    low = ["--set", "mission.0.takeoff.height=0.3"]  # soon up, soon down
    with subprocess.Popen(
        [*command, *low],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=mission.parent,
    ) as flight:
        watchdog = Timer(HANGS, flight.kill)
        watchdog.start()
        try:
            read_until(flight, "takeoff all agents done")
            yield flight
        finally:
            watchdog.cancel()
            flight.kill()


def read_until(flight: subprocess.Popen[str], text: str) -> None:
    """Wait for a line on standard error that holds a text."""
    assert flight.stderr is not None
    lines = []
    for line in flight.stderr:
        lines.append(line)
        if text in line:
            return
    pytest.fail(f"{text!r} is not in {lines!r}")


def test_ctrl_c_lands_all_agents_and_reports_it(missions: Path) -> None:
    with in_the_air(missions / "first_flight.yaml") as flight:
        flight.send_signal(signal.SIGINT)
        out, reported = flight.communicate()
    assert flight.returncode == 1
    assert ACKNOWLEDGED in reported
    assert out.startswith("first-flight: aborted: interrupted by the operator\n")
    assert "Traceback" not in reported


@pytest.mark.extended
def test_ctrl_c_again_stops_the_motors(missions: Path) -> None:
    with in_the_air(missions / "first_flight.yaml") as flight:
        flight.send_signal(signal.SIGINT)
        read_until(flight, "all agents land")
        flight.send_signal(signal.SIGINT)
        out, reported = flight.communicate()
    assert flight.returncode == 1
    assert out.startswith(
        "first-flight: aborted: interrupted by the operator; stopped, motors off\n"
    )
    assert "the operator stops the motors of cf1, cf2, cf3" in reported
    assert "Traceback" not in reported
