"""The page of `star view`: what it shows at each time, and that only this machine can see it."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from star_core import Agent, Camera, Detections, Registry, load, read_run
from star_core.commands.main import main
from star_view.command import FileWatch, simulate
from star_view.drone_mesh import ARM, frame_and_rear, front
from star_view.footprints import MAX_DISTANCE, footprint
from star_view.gate import SCHEME
from star_view.names import Name, uncovered
from star_view.page import LOOPBACK, Page, open_page
from star_view.plan_scene import PlannedStep, add_plan, planned_steps
from star_view.replay import Replay
from star_view.swarm_scene import DASH, Footprint
from tests.commands import Printed
from tests.conftest import ROOM
from tests.plugins.commands.star_view.browser import Browser
from tests.waiting import eventually

FIRST_FLIGHT = Path(__file__).parents[4] / "missions" / "first_flight.yaml"


@pytest.fixture(scope="module")
def viewer() -> Iterator[Replay]:
    mission = load(FIRST_FLIGHT, registry := Registry())
    shown = Replay(simulate(mission, registry), 0.25, port=18230)
    yield shown
    shown.server.close()


def test_the_page_is_served_on_this_machine_only(viewer: Replay) -> None:
    assert viewer.server.address.startswith(f"http://{LOOPBACK}:")
    with urllib.request.urlopen(viewer.server.address, timeout=5) as page:  # noqa: S310 -- http
        assert page.status == 200


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_the_page_is_dark_if_the_browser_prefers_that(viewer: Replay, scheme: str) -> None:
    page = f"http://{LOOPBACK}:{viewer.server.get_port()}/"
    request = urllib.request.Request(page, headers={SCHEME: f'"{scheme}"'})
    with urllib.request.urlopen(request, timeout=5) as answer:  # noqa: S310 -- http
        assert answer.headers["Accept-CH"] == answer.headers["Critical-CH"] == SCHEME
    controls = viewer.server.gui._gui_input_handle_from_uuid.values()
    (dark,) = [control for control in controls if control.label == "dark"]
    assert dark.value is (scheme == "dark")


def test_agents_are_where_they_were_at_the_time_of_the_slider(viewer: Replay) -> None:
    position = viewer._run.arrays["truth_position"]
    for tick in (0, 150, 400):
        viewer.show(tick)
        for i, agent in enumerate(viewer.swarm.agents):
            assert agent.position == pytest.approx(position[tick, i], abs=1e-6)
    viewer.timeline.value = 7.5
    expected = position[150, 0]
    target = pytest.approx(expected, abs=1e-6)
    assert eventually(lambda: viewer.swarm.agents[0].position == target)
    assert "flying" in viewer.status.content
    assert "goto cf1" in viewer.status.content


@pytest.mark.parametrize("width", [400, 1400])
def test_a_phone_shows_the_room_above_the_panel(viewer: Replay, width: int) -> None:
    def away() -> list[float]:
        """How far each browser is from what it looks at, m; one that has closed lingers."""
        cameras = [client.camera for client in viewer.server.get_clients().values()]
        return [math.dist(camera.position.tolist(), camera.look_at.tolist()) for camera in cameras]

    with Browser(viewer.server.address, image_width=width, image_height=800):
        assert eventually(lambda: [distance > 6.0 for distance in away()] == [width < 800])


def test_a_name_that_covers_a_nearer_one_is_hidden() -> None:
    names = [Name(f"/{y}", "a landmark", (0.0, y, 0.0)) for y in (0.0, -0.2, 3.0)]
    for away, expected in ((10.0, [False, True, True]), (1.0, [True, True, True])):
        camera: Any = SimpleNamespace(
            position=np.array([0.0, -away, 0.5 * away]), image_height=800, fov=0.9,
            wxyz=np.array([math.cos(1.0), -math.sin(1.0), 0.0, 0.0]),  # along y, and down
        )  # fmt: skip
        assert uncovered(names, camera).tolist() == expected


def test_ellipsoids_are_two_standard_deviations(viewer: Replay) -> None:
    viewer.show(300)
    std = viewer._run.arrays["estimate_position_std"][300, 1]
    assert sorted(viewer.swarm.ellipsoids[1].scale) == pytest.approx(sorted(2 * std))


def test_planned_paths_lead_from_the_estimate_to_the_goal(viewer: Replay) -> None:
    viewer.show(150)
    arrays = viewer._run.arrays
    line = viewer.swarm._lines["planned"][0]._segments
    estimate, goal = arrays["estimate_position"][150, 0], arrays["goal_position"][150, 0]
    dashes = np.linalg.norm(line[:, 1] - line[:, 0], axis=1)
    assert line[0, 0] == pytest.approx(estimate, abs=1e-6)
    assert np.linalg.norm(line[-1, 1] - goal) <= DASH + 1e-6
    assert dashes[:-1] == pytest.approx(DASH, abs=1e-6)
    assert dashes.sum() == pytest.approx(np.linalg.norm(goal - estimate) / 2, abs=DASH)
    viewer.show(len(arrays["time"]) - 1)
    assert len(viewer.swarm._lines["planned"][0]._segments) == 0


def test_a_replay_plays_from_the_first_browser_on(viewer: Replay) -> None:
    viewer.timeline.value = end = float(viewer._time[-1])
    viewer._begin()
    assert (viewer._playing, viewer._play.label, viewer.timeline.value) == (True, "pause", 0.0)
    with Browser(viewer.server.address) as browser:
        browser.set("pause", value=True)
        assert eventually(lambda: viewer._play.label == "play")
    viewer._begin()  # of another browser
    assert not viewer._playing
    viewer.show(len(viewer._time) - 1)
    assert "land all agents done" in viewer.status.content
    assert viewer.timeline.value < end


def test_drones_are_quadrotors_of_their_size() -> None:
    for mesh, rotors in ((frame_and_rear(), (3, 5)), (front(), (1, 7))):
        assert mesh.faces.max() == len(mesh.vertices) - 1
        for eighth in rotors:
            middle = ARM * np.array(
                [math.cos(eighth * math.pi / 4), math.sin(eighth * math.pi / 4)]
            )
            assert np.isclose(mesh.vertices[:, :2], middle).all(axis=1).any()


def test_footprints_are_areas_within_their_outline(viewer: Replay) -> None:
    area = Footprint(viewer.server.scene, "/test", row=2)
    assert not area.area.visible
    area.draw(np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [0, 0, 0]], float))
    corners = area.area.vertices[area.area.faces]
    sides = corners[:, 1:, :2] - corners[:, :1, :2]
    assert area.area.visible
    assert abs(np.linalg.det(sides)).sum() / 2 == pytest.approx(2.0)
    area.draw(np.zeros((0, 3)))
    assert not area.area.visible


def test_previous_and_next_jump_from_event_to_event(viewer: Replay) -> None:
    times = [event["time"] for event in viewer._run.summary["events"]]
    second = next(time for time in times if time > 0)
    viewer.timeline.value = second / 2
    with Browser(viewer.server.address) as browser:
        browser.set("event", value="next ▶")
        browser.wait_for(f"**{second:.2f} s**")
        assert viewer.timeline.value == pytest.approx(second)
        browser.set("event", value="◀ previous")
        browser.wait_for("**0.00 s**")
    assert times[0] == 0
    assert times[-1] == pytest.approx(viewer._time[-1])


def test_missions_are_shown_with_pads_and_rehearsed_steps() -> None:
    mission = load(FIRST_FLIGHT, registry := Registry())
    steps = planned_steps(mission, registry)
    assert [step.verb for step in steps] == [
        "takeoff", "goto", "goto", "goto", "hold", "goto", "goto", "land",
    ]  # fmt: skip
    assert re.fullmatch(r"goto cf1, about \d\.\d s", steps[1].text)
    assert steps[0].paths["cf1"] == pytest.approx(np.array([[-1.2, 0, 0], [-1.2, 0, 0.8]]))
    server = open_page(mission.scene.world, 18235, mission.name)
    try:
        add_plan(server, mission.scene.agents, steps)
        above = {"position": (0.0, 0.0, 6.0), "wxyz": (0.0, 1.0, 0.0, 0.0)}
        with Browser(server.address, **above) as browser:
            browser.wait_for(f"2. {steps[1].text}")
            assert {"/pads/start/cf1", "/pads/landing/cf3", "/plan/2/cf1"} <= browser.nodes
            browser.wait_for("visible: /plan/labels/0")
    finally:
        server.close()


def test_camera_footprints_are_shown_where_agents_first_hover() -> None:
    start = (1.0, 0.0, 0.0)
    agents = [Agent(name, start, camera=Camera()) for name in ("cf1", "cf2")]
    agents.append(Agent("cf3", start))
    rise = np.array([start, (1.0, 0.0, 0.8)])
    hop = {"cf1": rise, "cf2": rise[[0, 0]], "cf3": rise}
    world = load(FIRST_FLIGHT, Registry()).scene.world
    server = open_page(world, 18236, "hop")
    try:
        add_plan(server, agents, [PlannedStep("1", "takeoff", hop), PlannedStep("2", "hold", {})])
        with Browser(server.address) as browser:
            browser.wait_for("1. 1")
            shown = {node for node in browser.nodes if node.startswith("/plan/footprints/")}
    finally:
        server.close()
    assert shown == {"/plan/footprints/cf1"}


def test_a_replay_shows_the_saved_images_with_the_detected_tags(
    viewer: Replay, tmp_path: Path
) -> None:
    frames = tmp_path / "frames" / "cf2"
    frames.mkdir(parents=True)
    for moment in 1000, 1250, 2000:
        cv2.imwrite(str(frames / f"{moment:07d}.png"), np.full((244, 324), 128, np.uint8))
    corners = np.array([[[100.0, 180.0], [200.0, 180.0], [200.0, 80.0], [100.0, 80.0]]])
    detections = Detections(
        np.array([1]), np.array([7]), corners, np.array([1.25]), np.array([1.4])
    )
    replay = Replay(replace(viewer._run, folder=tmp_path, detections=detections), None, port=18237)
    try:
        green = {}
        for tick in 10, 22, 26, 45:
            replay.show(tick)
            visible = replay._cameras.visible
            green[tick] = visible and (replay._cameras.image == (0, 220, 90)).all(axis=2).any()
    finally:
        replay.server.close()
    assert not viewer._cameras.visible
    assert green == {10: False, 22: False, 26: True, 45: False}


def test_unrehearsed_missions_are_shown_without_a_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STAR_BLOCK_PLUGINS", "explain")
    registry = Registry()
    assert planned_steps(load(FIRST_FLIGHT, registry), registry) == []


def test_a_camera_that_looks_down_sees_the_floor_below_it() -> None:
    camera = Camera(pitch=math.pi / 2, position=(0.0, 0.0, 0.0), distortion=(0.0,) * 5)
    level = np.array([0.0, 0.0, 0.0, 1.0])
    outline = footprint(camera, np.array([1.0, 2.0, 0.9]), level)
    fx, fy, cx, cy = camera.matrix
    assert outline[:, 2] == pytest.approx(0.0)
    assert np.ptp(outline[:, 1]) == pytest.approx(0.9 * (camera.width - 1) / fx)
    assert np.ptp(outline[:, 0]) == pytest.approx(0.9 * (camera.height - 1) / fy)
    assert outline[0] == pytest.approx(outline[-1])
    assert outline[:, 1].max() - 2.0 == pytest.approx(0.9 * cx / fx)
    assert outline[:, 0].max() - 1.0 == pytest.approx(0.9 * cy / fy)
    assert len(footprint(camera, np.full(3, np.nan), level)) == 0
    ahead = footprint(Camera(pitch=0.0), np.array([0.0, 0.0, 1.0]), level)
    assert np.linalg.norm(ahead[:, :2], axis=1).max() < MAX_DISTANCE + 0.1


def test_a_world_is_shown_anew_when_it_is_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    world = tmp_path / "room.yaml"
    pillar = "obstacles: {pillar: {box: {centre: [1, 0], size: [1, 1]}, height: [0, 2]}}\n"
    texts = [ROOM, ROOM.replace("fence", "fense"), ROOM + pillar]
    shown: list[Page] = []
    titles: list[list[str]] = []

    def open_world(*arguments: Any) -> Page:
        shown.append(open_page(*arguments))
        titles.append([obstacle.name for obstacle in arguments[0].obstacles])
        return shown[-1]

    class Saved(FileWatch):
        """Saves the next text whenever it is asked whether a file was saved."""

        def changed(self) -> bool:
            if not texts:
                raise KeyboardInterrupt
            world.write_text(texts.pop(0))
            return True

    monkeypatch.setattr("star_view.page.open_page", open_world)
    monkeypatch.setattr("star_view.command.FileWatch", Saved)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    world.write_text(texts.pop(0))
    assert main(["view", str(world), "--port", "18260"]) == 0
    out, err = capsys.readouterr()
    assert titles == [[], ["pillar"]]
    assert shown[0].gate.token == shown[1].gate.token
    assert out.startswith("http://127.0.0.1:")
    (problem,) = [line for line in err.splitlines() if "room.yaml:3:1: " in line]
    assert problem.endswith(" [unknown-option]")


def test_saved_files_are_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("star_view.command.PERIOD", 0.0)
    file = tmp_path / "a.yaml"
    file.touch()
    watch = FileWatch([file])
    assert not watch.changed()
    os.utime(file, (1, 1))
    assert watch.changed()
    assert not watch.changed()
    file.unlink()
    assert not watch.changed()


def test_ctrl_c_ends_it(hop: Path) -> None:
    run = hop / "run"
    assert main(["run", "hop.yaml", "--out", str(run)]) == 0
    star = Path(sys.executable).with_name("star")
    command = [str(star), "view", str(run), "--port", "18240"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as view:
        assert view.stdout is not None
        assert b"Ctrl-C" in view.stdout.readline()
        os.kill(view.pid, signal.SIGINT)
        try:
            assert view.wait(10) == 0
        finally:
            view.kill()
        assert view.stderr is not None
        assert b"Traceback" not in view.stderr.read()


def test_what_holds_no_flight_is_refused(tmp_path: Path, capsys: Printed) -> None:
    assert main(["view", str(tmp_path)]) == 2
    assert "[no-record]" in capsys.readouterr().err
    with pytest.raises(Exception, match="no-record"):
        read_run(tmp_path)
