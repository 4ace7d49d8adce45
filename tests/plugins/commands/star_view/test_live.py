"""`star run --view`: what the page shows of a flight, and what the operator does on it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import star_view
from star_core import Operator, Registry, Tick, fly, hookimpl, load
from star_core.cli.main import main
from star_core.registry import Source
from star_view.camera_images import TAG, mosaic
from star_view.live_view import LiveView
from tests.plugins.commands.star_view.browser import PATIENCE, Browser

FIRST_FLIGHT = Path(__file__).parents[4] / "missions" / "first_flight.yaml"
PORT = 18260
WALL = ("wall_time_s", "realtime_factor", "compute_us", "compute_s")


def flown(view: LiveView | None, operator: Operator | None = None, speed: str = "40") -> Any:
    """Fly a mission, watched or not; return its summary without what depends on wall time."""
    registry = Registry()
    mission = load(FIRST_FLIGHT, registry, [f"transport.speed={speed}"])
    if view is not None:
        registry.add(view, Source("star-swarm:view:view"))
    summary = fly(mission, registry, operator=operator)
    return {key: value for key, value in summary.items() if key not in WALL}


def watched(act: Callable[[Browser], None], operator: Operator | None = None) -> Any:
    """Fly a mission in real time, and use its page; return its summary."""
    view = LiveView(0.3, port=PORT)
    with ThreadPoolExecutor() as pool:
        flight = pool.submit(flown, view, operator, "null")
        deadline = time.monotonic() + PATIENCE
        while not view.address:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        with Browser(view.address) as browser:
            act(browser)
            return flight.result(PATIENCE)


def test_a_watched_flight_is_the_same_flight() -> None:
    assert flown(LiveView(0.3, port=PORT)) == flown(None)


def test_the_page_shows_agents_steps_and_events_and_lands_all_agents() -> None:
    operator = Operator()

    def act(browser: Browser) -> None:
        browser.wait_for("takeoff all agents begins")
        browser.wait_for("taking off")
        browser.wait_for("times real time")
        assert {"/agents/cf3", "/estimates/cf1/ellipsoid", "/radii/cf2"} <= browser.nodes
        assert operator.stops == 0
        browser.set("land all", value=True)
        browser.wait_for("**aborted**: interrupted by the operator")

    summary = watched(act, operator)
    assert operator.stops == 1
    assert summary["reason"] == "interrupted by the operator"
    assert summary["flight_time_s"] < 15.0
    assert "stops the motors" not in str(summary["events"])


def test_the_page_stops_the_motors() -> None:
    def act(browser: Browser) -> None:
        browser.wait_for("taking off")
        browser.set("stop motors", value=True)

    summary = watched(act)
    assert summary["reason"] == "interrupted by the operator; stopped, motors off"


def test_the_page_changes_the_speed_of_the_simulation_and_nothing_else() -> None:
    operator = Operator()

    def act(browser: Browser) -> None:
        assert operator.simulation is not None
        assert operator.simulation.speed == 1.0
        browser.set("speed", value=9.5)
        browser.wait_for("**completed**")
        assert any("| cf1 | landed |" in text for text in browser.texts.values())
        assert operator.simulation.speed == 9.5

    assert watched(act, operator) == flown(None)


class Watcher:
    """An observer that looks at the view in flight."""

    def __init__(self, look: Callable[[float], None]) -> None:
        self._look = look

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self._look(tick.time)


def test_a_page_that_fails_does_not_disturb_the_flight(
    caplog: pytest.LogCaptureFixture,
) -> None:
    view, registry = LiveView(None, port=PORT), Registry()
    mission = load(FIRST_FLIGHT, registry, ["transport.speed=40"])

    def fail(moment: float) -> None:
        if moment > 3.0:
            view._process.kill()

    registry.add(view, Source("star-swarm:view:view"))
    registry.add(Watcher(fail), Source("star-swarm:watcher"))
    summary = fly(mission, registry)
    assert summary["outcome"] == "completed"
    assert "is dropped" not in str(summary["events"])
    assert "the view is closed: its process ended" in caplog.text


def test_without_viser_the_run_ends_before_the_flight_with_the_command_to_install_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(star_view, "find_spec", lambda _name: None)
    assert main(["run", str(FIRST_FLIGHT), "--view", "--no-record"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("star run --view needs viser: pip install 'star-swarm[view]' [missing")


def test_a_flight_that_is_not_watched_does_not_import_the_view(hop: Path) -> None:
    program = "import sys; from star_core.cli.main import main; main(); print(*sys.modules)"
    command = [sys.executable, "-c", program, "run", "hop.yaml", "--no-record"]
    modules = subprocess.run(command, capture_output=True, check=True, text=True, cwd=hop).stdout
    assert "star_view" in modules.split()
    assert not {"viser", "star_view.live_view", "star_view.messages"} & {*modules.split()}


def test_tags_in_images_are_outlined() -> None:
    import cv2

    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    image = np.full((244, 324), 255, np.uint8)
    image[80:180, 100:200] = cv2.aruco.generateImageMarker(family, 7, 100)
    blank = np.full((244, 324), 128, np.uint8)
    shown = mosaic({"cf1": image, "cf2": blank, "cf3": blank})
    outlined = (shown == TAG).all(axis=2)
    assert outlined[: 244 * 480 // 324, :480].sum() > 300
    assert not outlined[:, 490:].any()
