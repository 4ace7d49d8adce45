"""`star run --view`: what the page shows of a flight, and what the operator does on it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import star_view
from star_core import Detections, Operator, Registry, Telemetry, Tick, fly, hookimpl, load
from star_core.commands.main import main
from star_core.discovery import Source
from star_core.testing import estimate
from star_view.camera_images import CameraStream, Picture, mosaic
from star_view.live_view import LiveView
from tests.commands import Printed
from tests.plugins.commands.star_view.browser import PATIENCE, Browser
from tests.waiting import eventually

FIRST_FLIGHT = Path(__file__).parents[4] / "missions" / "first_flight.yaml"
STEPS = ["takeoff: {height: 0.5}", "goto: {agents: cf1, by: [0.2, 0, 0]}", "land: {speed: 0.5}"]
SHORT = f"mission=[{', '.join(f'{{{step}}}' for step in STEPS)}]"
PORT = 18260
WALL = ("wall_time_s", "realtime_factor", "compute_us", "compute_s")


def flown(view: LiveView | None, operator: Operator | None = None, speed: str = "40") -> Any:
    """Fly a mission, watched or not; return its summary without what depends on wall time."""
    registry = Registry()
    mission = load(FIRST_FLIGHT, registry, [f"transport.speed={speed}", SHORT])
    if view is not None:
        registry.add(view, Source("star-swarm:view:view"))
    summary = fly(mission, registry, operator=operator)
    return {key: value for key, value in summary.items() if key not in WALL}


def watched(
    act: Callable[[Browser], None], operator: Operator | None = None, view: LiveView | None = None
) -> Any:
    """Fly a mission in real time, and use its page; return its summary."""
    view = view or LiveView(0.3, port=PORT)
    with ThreadPoolExecutor() as pool:
        flight = pool.submit(flown, view, operator, "null")
        assert eventually(lambda: view.address)
        with Browser(view.address) as browser:
            act(browser)
            return flight.result(PATIENCE)


def test_page_shows_the_flight_and_lands_agents_with_its_token() -> None:
    operator, view = Operator(), LiveView(0.3, port=PORT)

    def act(browser: Browser) -> None:
        browser.wait_for("takeoff all agents begins")
        browser.wait_for("taking off")
        browser.wait_for("times real time")
        assert {"/agents/cf3", "/estimates/cf1/ellipsoid", "/radii/cf2"} <= browser.nodes
        browser.set("land all", value=True)
        browser.wait_for("**aborted**: interrupted by the operator")

    summary = watched(act, operator, view)
    assert operator.stops == 1
    assert operator.simulation is not None
    assert operator.simulation.speed == 1.0
    assert summary["reason"] == "interrupted by the operator"
    assert summary["flight_time_s"] < 15.0
    assert "stops the motors" not in str(summary["events"])


def test_the_page_stops_the_motors() -> None:
    def act(browser: Browser) -> None:
        browser.wait_for("taking off")
        browser.set("stop motors", value=True)

    summary = watched(act)
    assert summary["reason"] == "interrupted by the operator; stopped, motors off"


@pytest.mark.extended
def test_page_changes_simulation_speed_and_nothing_else() -> None:
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


def test_a_page_that_fails_does_not_disturb_the_flight(caplog: pytest.LogCaptureFixture) -> None:
    view, registry = LiveView(None, port=PORT), Registry()
    mission = load(FIRST_FLIGHT, registry, ["transport.speed=40", SHORT])

    def fail(moment: float) -> None:
        if moment > 3.0:
            view._process.kill()

    registry.add(view, Source("star-swarm:view:view"))
    registry.add(Watcher(fail), Source("star-swarm:watcher"))
    summary = fly(mission, registry)
    assert summary["outcome"] == "completed"
    assert "is dropped" not in str(summary["events"])
    assert "the view is closed: its process ended" in caplog.text


def test_missing_viser_is_reported_before_the_flight(
    monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.setattr(star_view, "find_spec", lambda _name: None)
    assert main(["run", str(FIRST_FLIGHT), "--view", "--no-record"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("star run --view needs viser: pip install 'star-swarm[view]' [missing")


@pytest.mark.extended
def test_a_flight_that_is_not_watched_does_not_import_the_view(hop: Path) -> None:
    program = "import sys; from star_core.commands.main import main; main(); print(*sys.modules)"
    command = [sys.executable, "-c", program, "run", "hop.yaml", "--no-record"]
    modules = subprocess.run(command, capture_output=True, check=True, text=True, cwd=hop).stdout
    assert "star_view" in modules.split()
    assert not {"viser", "star_view.live_view", "star_view.messages"} & {*modules.split()}


GREEN, ORANGE = (0, 220, 90), (255, 140, 0)
BLANK = np.full((244, 324), 128, np.uint8)


def tags(*numbers: int, time: float = 0.0, rejected: str = "") -> Detections:
    """Return tags at the same pixels of an image of the first agent."""
    n = len(numbers)
    square = np.array([[100.0, 180.0], [200.0, 180.0], [200.0, 80.0], [100.0, 80.0]])
    times, row = np.full(n, time), np.zeros(n, np.int64)
    return Detections(row, np.array(numbers), np.tile(square, (n, 1, 1)), times, times,
                      (rejected,) * n)  # fmt: skip


@pytest.mark.parametrize(("rejected", "color"), [("", GREEN), ("too far", ORANGE)])
def test_tags_of_the_localizer_are_outlined(rejected: str, color: tuple[int, int, int]) -> None:
    none = Detections.none()
    shown = mosaic({
        "cf1": Picture(BLANK, tags(7, rejected=rejected)),
        "cf2": Picture(BLANK, none),
        "cf3": Picture(BLANK, replace(tags(7), corners=np.full((1, 4, 2), np.nan))),
    })  # fmt: skip
    outlined = (shown == color).all(axis=2)
    assert outlined[: 244 * 480 // 324, :480].sum() > 300
    assert not outlined[:, 490:].any()
    assert not outlined[380:].any()


def test_an_image_is_shown_with_its_own_tags_which_come_later() -> None:
    stream = CameraStream()
    assert stream.picture() is None
    for k in range(3):
        stream.add(0.1 * k, BLANK + np.uint8(k))
    picture = stream.picture()
    assert picture is not None
    assert (picture.image[0, 0], len(picture.tags.tag)) == (130, 0)
    stream.add_tags(tags(7, time=0.1))
    picture = stream.picture()
    assert picture is not None
    assert (picture.image[0, 0], picture.tags.tag.tolist()) == (129, [7])
    stream.add(0.9, BLANK)
    picture = stream.picture()
    assert picture is not None
    assert (picture.image[0, 0], len(picture.tags.tag)) == (128, 0)


def test_a_view_receives_the_detections_of_every_tick() -> None:
    view, zero, row = LiveView(None), np.zeros((1, 3)), np.zeros(1)
    board = Telemetry(0.0, zero, zero, np.zeros((1, 4)), row, np.zeros(1, np.int64), row)
    other: list[Any] = [None] * 7
    for number in 7, 8:
        tick = Tick(0.0, board, replace(estimate(zero), detections=tags(number)), *other)
        view.star_ticked(tick)
    news = view._news(tick, 1.0)
    assert [batch.tag.tolist() for batch in news.detections] == [[7], [8]]
    assert view._news(tick, 1.0).detections == ()
