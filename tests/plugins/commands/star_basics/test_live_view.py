"""How a flight is shown while it goes, and summed up when it is over."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_basics.live_view import FlightProgress
from star_basics.summary_text import format_summary
from star_core import (
    AgentPhase,
    Corrected,
    Event,
    Flight,
    Goals,
    Operator,
    Paths,
    Plan,
    Setpoint,
    Telemetry,
    Tick,
    hookimpl,
)
from star_core.commands.main import main
from star_core.discovery import Source
from star_core.plugin_support.registry import Registry
from star_core.runner import fly
from star_core.testing import estimate, health, scene
from star_core.toolkit.progress import REFRESH_PERIOD
from star_yaml.mission_loader import load
from tests.commands import Printed
from tests.core.conftest import a_pipe

HIDE_CURSOR, SHOW_CURSOR = "\x1b[?25l", "\x1b[?25h"
pytestmark = pytest.mark.usefixtures("hop")


class Screen(io.StringIO):
    """A terminal."""

    def isatty(self) -> bool:
        return True


def a_screen(monkeypatch: pytest.MonkeyPatch) -> Screen:
    """Return what is written to stderr, a terminal, from now on; work is shown at once."""
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("star_core.toolkit.progress.SHOW_AFTER", 0.0)
    text = Screen()
    monkeypatch.setattr(sys, "stderr", text)
    return text


def shown(progress: FlightProgress, *ticks: Tick, agents: int) -> None:
    """Show ticks of a flight, long enough to be drawn."""
    progress.star_mission_started(flight(agents), Operator())
    for tick in ticks:
        progress.star_ticked(tick)
    time.sleep(5 * REFRESH_PERIOD)
    progress.star_mission_ended({})


def flown(*plugins: object) -> list[str]:
    """Fly the mission and return its events, a line each."""
    registry = Registry()
    registry.add(FlightProgress(lambda: None), Source("star-swarm:progress"))
    for number, plugin in enumerate(plugins):
        registry.add(plugin, Source(f"their-dist:{number}"))
    return lines(fly(load(Path("hop.yaml"), registry), registry))


def lines(summary: Mapping[str, Any]) -> list[str]:
    """The events of a flight as they should be printed."""
    return [f"{event['time']:8.2f} s  {event['text']}" for event in summary["events"]]


def events_in(text: str) -> list[str]:
    """The lines that are events; on a slow machine there are also those of long work."""
    return [line for line in text.splitlines() if re.match(r" *[0-9.]+ s  ", line)]


def flight(n: int) -> Flight:
    return Flight("hop", scene(n), manifest={}, folder=None)


def tick(n: int, **changes: float) -> Tick:
    """A tick of `n` agents that hover at z = 1 m."""
    position = np.array([[row, -row, 1.0] for row in range(n)], np.float64)
    nothing, zero = np.zeros((n, 3)), np.zeros(n)
    still = Setpoint(nothing, zero, np.ones(n, np.bool_))
    return Tick(
        time=changes.get("time", 1.25),
        telemetry=Telemetry(0.0, nothing, nothing, np.zeros((n, 4)), zero, zero.astype(int), zero),
        estimate=estimate(position),
        health=health(n, AgentPhase.TAKING_OFF),
        goals=Goals.none(n),
        plan=Plan(still, Paths(np.zeros(0, np.int64), nothing[:0]), np.zeros(n, np.bool_)),
        sent=still,
        truth=None,
        doing="takeoff cf1",
        corrected=Corrected(*[np.zeros(n, np.bool_)] * 4),
    )


# Into a file or a pipe


def test_off_a_terminal_every_event_is_one_plain_line(monkeypatch: pytest.MonkeyPatch) -> None:
    paper = a_pipe(monkeypatch)
    events = flown()
    assert events_in(paper.getvalue()) == events
    assert events[0] == "    0.00 s  hop.yaml:13 takeoff cf1, cf2 begins"


def test_what_looks_like_markup_is_shown_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = a_screen(monkeypatch)
    progress = FlightProgress(lambda: None)
    progress.star_mission_started(flight(1), Operator())
    time.sleep(5 * REFRESH_PERIOD)
    progress.star_event(Event(1.0, "step", "[red]stop[/red] [1, 2] 'cf1'"))
    progress.star_mission_ended({})
    assert "    1.00 s  [red]stop[/red] [1, 2] 'cf1'\n" in screen.getvalue()


def test_a_short_flight_writes_nothing_but_its_events(monkeypatch: pytest.MonkeyPatch) -> None:
    def estimate() -> float:
        raise AssertionError

    paper = a_pipe(monkeypatch)
    shown(FlightProgress(estimate), tick(2), agents=2)
    assert paper.getvalue() == ""


def test_a_long_flight_writes_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    paper = a_pipe(monkeypatch)
    monkeypatch.setattr("star_basics.live_view.ESTIMATE_AFTER", 0.0)
    progress = FlightProgress(lambda: 20.0)
    progress.star_mission_started(flight(1), Operator())
    progress.star_ticked(tick(1, time=12.4))
    text = str(progress._progress)
    progress.star_mission_ended({})
    assert re.fullmatch(r"hop: 12\.4 of ~20 s, [\d.]+ times real time", text)
    assert paper.getvalue() == ""


# On a terminal


def test_in_flight_every_agent_has_a_row_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = a_screen(monkeypatch)
    shown(FlightProgress(lambda: None), tick(2), agents=2)
    written = screen.getvalue()
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in written.splitlines()]
    assert ["cf1", "taking off", "0.00", "0.00", "1.00", "4.00"] in rows
    assert ["cf2", "taking off", "1.00", "-1.00", "1.00", "4.00"] in rows
    assert "1.2 s  takeoff cf1" in written
    assert "hop" in written
    assert written.count(HIDE_CURSOR) == written.count(SHOW_CURSOR) == 1
    assert written.rindex(SHOW_CURSOR) > written.rindex("agent")


def test_agents_that_are_not_shown_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = a_screen(monkeypatch)
    shown(FlightProgress(lambda: None), tick(25), agents=25)
    assert "and 5 more" in screen.getvalue()
    assert "cf21" not in screen.getvalue()


def test_on_a_terminal_events_stay_above_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = a_screen(monkeypatch)
    events = flown()
    assert [line for line in events if line in screen.getvalue()] == events


def test_a_flight_that_is_cut_short_gives_the_cursor_back(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = a_screen(monkeypatch)

    class Breaker:
        @hookimpl
        def star_ticked(self, tick: Tick) -> None:
            time.sleep(5 * REFRESH_PERIOD)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        flown(Breaker())
    written = screen.getvalue()
    assert written.count(HIDE_CURSOR) == written.count(SHOW_CURSOR) >= 1


# From the command line


def test_progress_goes_to_standard_error(capsys: Printed) -> None:
    assert main(["run", "hop.yaml", "--out", "out"]) == 0
    out, err = capsys.readouterr()
    assert events_in(err) == lines(json.loads(Path("out/summary.json").read_text()))
    assert "takeoff" not in out


def test_json_is_shown_no_progress(capsys: Printed) -> None:
    assert main(["run", "hop.yaml", "--no-record", "--json"]) == 0
    assert events_in(capsys.readouterr().err) == []


def test_a_summary_is_printed_though_nothing_reads_stderr() -> None:
    code = (
        "import sys; from star_core.commands.main import main; from star_core.toolkit import log\n"
        "log('a line'); sys.exit(main())"
    )
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as stderr:
        done = subprocess.run(
            [sys.executable, "-c", code, "run", "hop.yaml", "--no-record"],
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            check=False,
        )
    assert done.stdout.startswith("hop: completed\n")
    assert done.returncode == 0


# When it is over


def summary(**changes: Any) -> dict[str, Any]:
    return {
        "outcome": "completed",
        "reason": "",
        "mission": "hop",
        "agents": ["cf1"],
        "flight_time_s": 12.34,
        "wall_time_s": 0.0,
        "realtime_factor": None,
        "collisions": {"agent_agent": 0, "agent_obstacle": 2},
        "distances_from": "ground_truth",
        "corrected": {"fence": 0, "speed": 0, "separation": 0},
        "late_ticks": 0,
        "latest_tick_s": 0.0,
        "compute_s": {},
        "slow_ticks": {},
        "min_separation_m": None,
        "min_clearance_m": None,
        "position_rmse_m": None,
        "targets": {"found": 0, "total": 0},
        "path_length_m": {"total": 1.25},
    } | changes


def test_what_cannot_be_known_is_left_out() -> None:
    assert format_summary(summary(path_length_m={"total": None}), None).splitlines() == [
        "hop: completed",
        "  flight            12.3 s with 1 agent",
        "  collisions        0 between agents, 2 with obstacles",
    ]


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"outcome": "failed", "reason": "cf1 fell"}, "hop: failed: cf1 fell"),
        (
            {"corrected": {"fence": 3, "speed": 0, "separation": 12}},
            "  corrected         setpoints: 3 for fence, 12 for separation",
        ),
        ({"late_ticks": 3, "latest_tick_s": 0.1234}, "  late ticks        3, by 0.12 s at most"),
        (
            {"slow_ticks": {"planner 'far'": {"ticks": 3, "longest_s": 2.04}}},
            "  slow ticks        3 of planner 'far', the slowest took 2.0 s",
        ),
        (
            {"realtime_factor": 0.31, "wall_time_s": 40.0, "compute_s": {"a": 7.0, "b": 21.0}},
            "  slowest plugin    b, 21.0 of 40.0 s",
        ),
        ({"realtime_factor": 0.31}, "  flight            12.3 s with 1 agent, 0.3 times real time"),
        ({"realtime_factor": 41.7}, "  flight            12.3 s with 1 agent, 42 times real time"),
        ({"min_separation_m": 0.456}, "  closest approach  0.46 m"),
        ({"min_clearance_m": 0.0}, "  clearance         0.00 m at least"),
        (
            {"min_separation_m": 0.456, "distances_from": "estimate"},
            "  closest approach  0.46 m (estimated positions)",
        ),
        (
            {"distances_from": "mixed"},
            "  collisions        0 between agents, 2 with obstacles (estimated positions)",
        ),
        ({}, "  flown             1.2 m in all"),
        ({"targets": {"found": 1, "total": 2}}, "  targets           1 of 2 found"),
        ({"position_rmse_m": 0.0321}, "  position error    0.032 m RMS"),
    ],
)
def test_what_is_known_is_reported_with_its_unit(changes: Mapping[str, Any], line: str) -> None:
    assert line in format_summary(summary(**changes), None).splitlines()


def test_own_observers_are_not_the_slowest_plugin() -> None:
    spent = {"observer star-swarm:view:view": 30.0, "a": 21.0}
    changes = {"realtime_factor": 0.31, "wall_time_s": 40.0, "compute_s": spent}
    assert "  slowest plugin    a, 21.0 of" in format_summary(summary(**changes), None)


@pytest.mark.parametrize(
    "changes",
    [
        {"realtime_factor": 1.2, "wall_time_s": 10.0, "compute_s": {"a": 9.0}},
        {"realtime_factor": 0.8, "wall_time_s": 10.0, "compute_s": {"a": 4.0, "b": 4.0}},
        {"realtime_factor": 0.8, "wall_time_s": 10.0},
    ],
)
def test_plugins_are_not_blamed_unless_slower_than_real_time(changes: Mapping[str, Any]) -> None:
    assert "slowest plugin" not in format_summary(summary(**changes), None)


def test_a_dropped_observer_is_reported_once(capsys: Printed) -> None:
    progress = FlightProgress(lambda: None)
    progress.star_event(Event(0.0, "observer", "watch is dropped"))  # its log has a warning of that
    progress.star_event(Event(0.0, "step", "takeoff begins"))
    err = capsys.readouterr().err
    assert "dropped" not in err
    assert "takeoff begins" in err
