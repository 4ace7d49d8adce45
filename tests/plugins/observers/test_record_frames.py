"""The cameras' images are kept when that is asked for."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from star_core import Flight, Frames, Image, Registry, load
from star_core.commands.main import main
from star_record.recorder import Recorder

pytestmark = pytest.mark.ideal_world

WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
landmarks: {mark: {tags: [3], at: [0.8, 0, 0]}}
"""
MISSION = """\
star: 1
name: look
world: room.yaml
cameras: {slow: {rate: 4}}
swarm:
  cf1: {start: [0, 0, 0], camera: slow}
  cf2: {start: [0, 1, 0]}
transport: {use: sim, camera: {latency: 0.1, latency_std: 0}}
localizer: flow
planner: straight
avoider: none
mission:
  - takeoff: {height: 0.3, speed: 0.5}
  - land: {speed: 0.5}
"""


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("m.yaml").write_text(MISSION)
    Path("room.yaml").write_text(WORLD)


def test_every_image_is_a_file_named_by_the_time_it_was_taken() -> None:
    assert main(["run", "m.yaml", "--json", "--out", "out", "--save-frames"]) == 0
    files = sorted(Path("out/frames").rglob("*.png"))
    assert {file.parent.name for file in files} == {"cf1"}
    assert [file.stem for file in files[:3]] == ["0000250", "0000500", "0000750"]
    image = cv2.imread(str(files[0]), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.shape == (244, 324)


def test_an_image_of_before_the_flight_is_not_kept(tmp_path: Path) -> None:
    scene = load("m.yaml", Registry()).scene
    recorder = Recorder(Flight("look", scene, {}, tmp_path, save_frames=True), tmp_path)
    image: Image = np.zeros((4, 4), np.uint8)
    times = np.array([-0.978, 0.0])
    recorder._save_images(Frames(np.zeros(2, np.int64), times, times, (image, image)))
    assert [file.name for file in Path("frames/cf1").iterdir()] == ["0000000.png"]
    recorder._events.close()
    recorder.log.finish({"outcome": "completed", "reason": ""})


def test_no_image_is_kept_unless_asked_for() -> None:
    assert main(["run", "m.yaml", "--json", "--out", "out"]) == 0
    assert not Path("out/frames").exists()


@pytest.mark.parametrize("obstacle", ["a file in the way", "an image that is not written"])
def test_unsaved_images_cost_one_warning_and_no_record(
    obstacle: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    if obstacle == "a file in the way":
        Path("out").mkdir()
        Path("out/frames").write_text("")
    else:
        monkeypatch.setattr(cv2, "imwrite", lambda *_: False)
    assert main(["run", "m.yaml", "--json", "--out", "out", "--save-frames"]) == 1
    (warning,) = [
        record.getMessage() for record in caplog.records if "images" in record.getMessage()
    ]
    assert warning.startswith("saving of images stopped: ")
    with np.load("out/trajectory.npz") as file:
        assert len(file["time"]) > 20
