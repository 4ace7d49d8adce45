"""Every bad behavior of every kind of plugin: it is named, and all agents end on the ground."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
import pytest

import star_core as star
import star_yaml
from star_core.discovery import Source
from star_core.plugin_support import watchdog
from star_core.plugin_support.guard import Strikes
from tests.core.conftest import Lab
from tests.core.robots import Robots

Right: TypeAlias = Callable[..., Any]
Change: TypeAlias = Callable[[np.ndarray], np.ndarray]

STEPS = """
  - climb: {}
  - visit: {agents: cf1, to: [0.2, -0.2, 1]}
  - descend: {}
"""
METHODS = {
    "transport": "send",
    "localizer": "locate",
    "planner": "plan",
    "avoider": "avoid",
    "visit": "step",
}
NAMED = {
    "transport": "transport 'robots' (their-dist 1.2:lab)",
    "localizer": "localizer 'seer' (their-dist 1.2:lab)",
    "planner": "planner 'dash' (their-dist 1.2:lab)",
    "avoider": "avoider 'idle' (their-dist 1.2:lab)",
    "visit": "task 'visit' (their-dist 1.2:lab)",
}
FIELDS = {
    "transport": "Setpoint.velocity",
    "localizer": "Estimate.position",
    "planner": "Setpoint.velocity",
    "avoider": "Setpoint.velocity",
    "visit": "Goals.position",
}
PERIOD = 0.1  # s
IN_FLIGHT = {role: range(14, 10**6) for role in METHODS} | {"visit": range(2, 10**6)}  # calls


def changed(table: Any, change: Change) -> Any:
    """Return a table with another velocity, or another position if it has one."""
    match table:
        case star.Plan():
            return replace(table, setpoint=changed(table.setpoint, change))
        case star.TaskOutput(goals=star.Goals() as goals):
            return replace(table, goals=changed(goals, change))
        case star.Setpoint():
            return replace(table, velocity=change(table.velocity))
        case star.Estimate() | star.Goals():
            return replace(table, position=change(table.position))
    return table


def returns(change: Change) -> Right:
    return lambda right, *inputs: changed(right(*inputs), change)


def mutates(right: Right, first: Any, *rest: Any) -> Any:
    array = first.velocity if isinstance(first, star.Setpoint) else first.position
    array[:] = 0.0
    return right(first, *rest)


def exits(_right: Right, *_inputs: Any) -> None:
    sys.exit("bye")


def raises(_right: Right, *_inputs: Any) -> None:
    raise RuntimeError("boom")


def panics(_right: Right, *_inputs: Any) -> None:
    raise asyncio.CancelledError("panic")


LASTING: Mapping[str, tuple[Right, str]] = {  # from the flight's begin on; words of the message
    "raises": (raises, "RuntimeError: boom ("),
    "sys.exit": (exits, "SystemExit: bye ("),
    "panics": (panics, "CancelledError: panic ("),
    "NaN": (returns(lambda a: a * np.nan), " is [nan, nan, nan], expected numbers"),
    "inf": (returns(lambda a: a + np.inf), " is [inf, inf, inf], expected numbers"),
    "wrong shape": (returns(lambda a: a[:, :2]), " has shape (2, 2), expected (2, 3)"),
    "wrong dtype": (
        returns(lambda a: a.astype(str) + "m"),
        " is an array of str, expected float64",
    ),
    "None": (lambda *_: None, "returned NoneType, expected "),
    "mutates its input": (mutates, "ValueError: assignment destination is read-only ("),
}


def down(lab: Lab) -> bool:
    """Return whether all agents are on the ground, and were landed rather than dropped."""
    position = Robots.receive(lab.robots).position
    landed = set(lab.ordered(star.Order.LAND)) == {0, 1} and not lab.ordered(star.Order.STOP)
    return landed and np.allclose(position[:, 2], 0.0)


@pytest.mark.parametrize("role", METHODS)
@pytest.mark.parametrize("behavior", LASTING)
def test_lasting_failures_brake_twice_then_land_all_agents(
    lab: Lab, behavior: str, role: str
) -> None:
    wrong, words = LASTING[behavior]
    lab.spoil(role, METHODS[role], wrong, IN_FLIGHT[role])
    summary = lab.fly(STEPS)
    assert summary["outcome"] == "failed"
    assert summary["reason"].startswith(f"{NAMED[role]}: ")
    expected = words if words[0] != " " else FIELDS[role] + words.replace(" is [", " of row 0 is [")
    if role == "visit" and behavior in {"NaN", "inf"}:  # goals are merged, without rows
        expected = f"{FIELDS[role]} is [["
    assert expected in summary["reason"]
    first, second = lab.said("plugin")
    assert first.startswith(f"all agents brake: {NAMED[role]}: ")
    assert second.endswith("(failure 2; at 3 all land)")
    times = [event.time for event in lab.events if event.kind == "plugin"]
    sent = [np.abs(setpoint.velocity).max() for at, setpoint in lab.robots.sent if at in times]
    assert role == "transport" or (sent and max(sent) == 0)
    assert down(lab)


@pytest.mark.parametrize("role", METHODS)
def test_a_single_failure_does_not_end_the_flight(lab: Lab, role: str) -> None:
    first = IN_FLIGHT[role].start
    lab.spoil(role, METHODS[role], raises, range(first, first + 1))
    summary = lab.fly(STEPS)
    assert summary["outcome"] == "completed"
    (told,) = lab.said("plugin")
    assert NAMED[role] in told
    assert down(lab)


def test_the_mission_sets_how_many_failures_end_the_flight(lab: Lab) -> None:
    lab.spoil("planner", "plan", raises, IN_FLIGHT["planner"])
    assert lab.fly(STEPS, more="plugin_strikes: 5\n")["outcome"] == "failed"
    assert len(lab.said("plugin")) == 4


@pytest.mark.parametrize("role", ["transport", "localizer", "planner", "avoider"])
def test_on_the_ground_the_first_failure_ends_the_mission(lab: Lab, role: str) -> None:
    lab.spoil(role, METHODS[role], raises)
    reason = lab.fly("\n  - wait: {seconds: 1}" + STEPS)["reason"]
    assert reason.startswith(f"{NAMED[role]}: RuntimeError: boom (")
    assert lab.robots.commands == []


@pytest.mark.parametrize("role", METHODS)
def test_tenfold_speeds_are_limited_before_they_are_sent(lab: Lab, role: str) -> None:
    def tenfold(right: Right, *inputs: Any) -> Any:
        match table := right(*inputs):
            case star.TaskOutput(goals=star.Goals() as goals):
                return replace(table, goals=replace(goals, speed=10 * goals.speed))
            case star.Estimate():
                return replace(table, velocity=10 * table.velocity)
        return changed(table, lambda velocity: 10 * velocity)

    lab.spoil(role, METHODS[role], tenfold)
    lab.fly(STEPS)
    fastest = max(
        np.linalg.norm(setpoint.velocity, axis=1).max() for _, setpoint in lab.robots.sent
    )
    assert fastest <= star.Limits().speed + 1e-9
    assert down(lab)


@pytest.mark.parametrize("role", METHODS)
def test_time_that_a_plugin_takes_is_its_own_in_the_summary(
    lab: Lab, role: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    for name in ("perf_counter", "thread_time"):
        monkeypatch.setattr(f"star_core.plugin_support.compute_time.{name}", lambda: clock[0])

    def slow(right: Right, *inputs: Any) -> Any:
        clock[0] += 0.05
        return right(*inputs)

    lab.spoil(role, METHODS[role], slow)
    summary = lab.fly(STEPS)
    assert summary["outcome"] == "completed"
    assert {plugin: took for plugin, took in summary["compute_s"].items() if took} == {
        NAMED[role]: pytest.approx(clock[0])
    }


@pytest.mark.parametrize("role", METHODS)
def test_a_buffer_that_a_plugin_uses_again_changes_nothing(lab: Lab, role: str) -> None:
    buffer = np.zeros((2, 3))

    def reuse(array: np.ndarray) -> np.ndarray:
        buffer[:] = array
        return buffer

    def wrong(right: Right, *inputs: Any) -> Any:
        buffer[:] = 99.0
        return changed(right(*inputs), reuse)

    lab.fly(STEPS)
    normal, lab.ticks = [tick.sent.velocity for tick in lab.ticks], []
    lab.spoil(role, METHODS[role], wrong)
    assert lab.fly(STEPS)["outcome"] == "completed"
    assert np.array_equal([tick.sent.velocity for tick in lab.ticks], normal)


@pytest.fixture
def release() -> Iterator[threading.Event]:
    event = threading.Event()
    yield event
    event.set()


@pytest.mark.parametrize("role", METHODS)
def test_threads_that_a_plugin_leaves_behind_are_reported(
    lab: Lab, role: str, release: threading.Event
) -> None:
    def leaks(right: Right, *inputs: Any) -> Any:
        threading.Thread(target=release.wait, name="their-worker").start()
        return right(*inputs)

    lab.spoil(role, METHODS[role], leaks, range(1, 3))
    assert lab.fly(STEPS)["outcome"] == "completed"
    assert lab.said("plugin") == ["2 threads still run after the flight: their-worker"]


def in_python(*lines: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", "\n".join(lines)], check=False, capture_output=True, text=True
    )


def test_leftover_plugin_threads_do_not_block_exit() -> None:
    done = in_python(
        "import sys, threading",
        "from star_core.commands.main import main",
        "threading.Thread(target=threading.Event().wait).start()",
        "sys.argv = ['star', '--version']",
        "sys.exit(main())",
    )
    assert (done.returncode, done.stdout.split()[0]) == (0, "star")


def test_endless_native_code_ends_the_process_with_its_line() -> None:
    done = in_python(
        "import os, collections, itertools, time",
        "from star_core.plugin_support import compute_time, watchdog",
        "watchdog.MAX_NATIVE_TIME = 0.1 / os.cpu_count()",
        "with watchdog.Watchdog(0.1, realtime=False, brake=lambda: None) as watched:",
        "    with compute_time.Stopwatch(time.perf_counter, watched):",
        "        collections.deque(itertools.repeat(None), maxlen=0)",
    )
    assert done.returncode == -signal.SIGVTALRM
    assert 'File "<string>", line 6' in done.stderr


def loops(*_: Any) -> None:
    while True:
        try:
            time.sleep(0.001)
        except Exception:  # noqa: BLE001, S112 -- as careless plugins do
            continue


def waits(*_: Any) -> None:
    threading.Event().wait()


@pytest.mark.parametrize(
    ("role", "hangs"), [*((role, waits) for role in METHODS), ("planner", loops)]
)
def test_a_plugin_that_hangs_is_interrupted_and_all_agents_land(
    lab: Lab, role: str, hangs: Right, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "MAX_CALL_TIME", 0.5)
    lab.spoil(role, METHODS[role], hangs, IN_FLIGHT[role])
    summary = lab.fly(STEPS)
    assert summary["outcome"] == "failed"
    assert summary["reason"].startswith(f"{NAMED[role]}: PluginTimeout: no result after ")
    assert "watchdog.py" not in summary["reason"]
    assert down(lab)


def test_in_real_time_the_agents_hover_while_a_plugin_hangs(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "MAX_REALTIME_CALL_TIME", 0.5)
    lab.realtime = True
    lab.registry = star.Registry(star_yaml, lab, installed=False)
    lab.spoil("planner", "plan", waits, IN_FLIGHT["planner"])
    assert "PluginTimeout" in lab.fly(STEPS)["reason"]
    times = [at for at, _ in lab.robots.sent]
    braked = [
        setpoint for at, setpoint in lab.robots.sent if times.count(at) > 1 and at == times[-1]
    ][1:]
    assert len(braked) >= 2
    assert all(setpoint.active.all() and not setpoint.velocity.any() for setpoint in braked)
    assert down(lab)


def test_a_hanging_observer_is_dropped(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    class Hangs:
        @star.hookimpl
        def star_ticked(self, tick: star.Tick) -> None:
            if tick.time > 1.0:
                waits()

    monkeypatch.setattr(watchdog, "MAX_CALL_TIME", 0.5)
    lab.registry.add(Hangs(), Source("their-dist:hangs", "1.2"))
    assert lab.fly(STEPS)["outcome"] == "completed"
    (dropped,) = lab.said("observer")
    assert dropped.startswith("their-dist:hangs is dropped: star_ticked raised PluginTimeout")


def test_on_the_ground_no_failure_is_tolerated() -> None:
    strikes = Strikes(3)
    assert not strikes.tolerates("planner", star.PluginError("boom"))
