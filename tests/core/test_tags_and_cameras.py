"""Tags in the world and cameras on agents, from the files to what plugins receive."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from star_core.errors import InputError
from star_core.mission import Mission
from star_core.plugin_support.registry import Registry
from star_core.world.camera import Camera
from star_core.world.quaternions import moved, product, turned
from star_yaml.mission_loader import load
from tests.commands import position_and_code

WORLD = """\
star: 1
name: lab
fence: {low: [-3, -3, 0], high: [3, 3, 3]}
landmarks:
  floor: {tags: [0, 1], at: [1.0, 2.0, 0.0], yaw_deg: 90}
  wall: {tags: [7], at: [0.0, 2.5, 1.0], roll_deg: 90, size: 0.1}
targets:
  survivor: {tags: [200], at: [-1.0, 0.0, 0.0]}
"""
MISSION = """\
star: 1
name: look
world: world.yaml
cameras: {front: {pitch_deg: 0, rate: 5, matrix: [100, 100, 80, 60], width: 160, height: 120}}
swarm:
  cf1: {start: [0, 0, 0], camera: front}
  cf2: {start: [1, 0, 0], camera: aideck}
  cf3: {start: [2, 0, 0]}
transport: sim
localizer: flow
planner: straight
avoider: none
mission: [{land: {}}]
"""
ANGLE = st.floats(-math.pi, math.pi)


def mission(folder: Path, *changes: tuple[str, str]) -> Mission:
    """The mission in its world, with some changes to either text."""
    texts = {"world.yaml": WORLD, "m.yaml": MISSION}
    for old, new in changes:
        assert any(old in text for text in texts.values())
        texts = {name: text.replace(old, new) for name, text in texts.items()}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return load(folder / "m.yaml", Registry())


def refusal(folder: Path, *changes: tuple[str, str]) -> str:
    with pytest.raises(InputError) as raised:
        mission(folder, *changes)
    (problem,) = raised.value.problems
    return problem.rpartition("/")[2]


def test_cameras_defined_twice_are_listed_once(tmp_path: Path) -> None:
    wrong = refusal(
        tmp_path, ("cameras: {front:", "cameras: {aideck:"), ("camera: front", "camera: xyz")
    )
    assert position_and_code(wrong) == "m.yaml:6:35 [unknown-camera]"


def test_the_tags_of_a_sheet_stand_in_a_row_along_its_own_x_axis(tmp_path: Path) -> None:
    first, second, wall = mission(tmp_path).scene.world.landmarks
    assert (first.id, second.id, wall.id) == (0, 1, 7)
    assert first.position == pytest.approx((1.0, 2.0 - 0.105, 0.0))  # x of the sheet is y here
    assert second.position == pytest.approx((1.0, 2.0 + 0.105, 0.0))
    assert (first.size, wall.size) == (0.168, 0.1)
    assert (first.of, wall.of) == ("floor", "wall")


def test_sheets_rolled_by_a_quarter_stand_up_and_face_south(tmp_path: Path) -> None:
    *_, wall = mission(tmp_path).scene.world.landmarks
    assert moved(wall.rotation, (0.0, 0.0, 1.0)) == pytest.approx((0.0, -1.0, 0.0))
    assert moved(wall.rotation, (0.0, 1.0, 0.0)) == pytest.approx((0.0, 0.0, 1.0))


def test_the_tags_of_a_sheet_may_stand_anywhere_on_it(tmp_path: Path) -> None:
    offsets = "yaw_deg: 90, offsets: [[0.1, 0.2], [-0.1, 0.3]]}"
    first, second, _ = mission(tmp_path, ("yaw_deg: 90}", offsets)).scene.world.landmarks
    assert first.position == pytest.approx((1.0 - 0.2, 2.0 + 0.1, 0.0))
    assert second.position == pytest.approx((1.0 - 0.3, 2.0 - 0.1, 0.0))


def test_targets_are_kept_apart_from_landmarks(tmp_path: Path) -> None:
    (target,) = mission(tmp_path).scene.world.targets
    assert (target.id, target.of) == (200, "survivor")


def test_each_agent_has_the_camera_that_the_mission_names(tmp_path: Path) -> None:
    front, aideck, none = (agent.camera for agent in mission(tmp_path).scene.agents)
    assert front == Camera(160, 120, (100.0, 100.0, 80.0, 60.0), pitch=0.0, rate=5)
    assert aideck == Camera()
    assert none is None


def test_a_camera_without_a_turn_looks_ahead_the_right_way_up() -> None:
    camera = Camera(pitch=0.0)
    assert moved(camera.rotation, (0.0, 0.0, 1.0)) == pytest.approx((1.0, 0.0, 0.0))
    assert moved(camera.rotation, (1.0, 0.0, 0.0)) == pytest.approx((0.0, -1.0, 0.0))


def test_a_camera_that_is_pitched_looks_down() -> None:
    ahead = moved(Camera(pitch=math.radians(30)).rotation, (0.0, 0.0, 1.0))
    assert ahead == pytest.approx((math.cos(math.pi / 6), 0.0, -0.5))


@given(ANGLE, ANGLE, ANGLE)
def test_a_turn_is_roll_then_pitch_then_yaw(roll: float, pitch: float, yaw: float) -> None:
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    columns = [moved(turned(roll, pitch, yaw), axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    assert np.allclose(np.array(columns).T, expected, atol=1e-12)


@given(ANGLE, ANGLE, ANGLE)
def test_a_product_of_turns_does_one_after_the_other(a: float, b: float, c: float) -> None:
    first, second = turned(a, b, c), turned(c, a, b)
    both = moved(second, moved(first, (0.3, -0.2, 1.0)))
    assert moved(product(second, first), (0.3, -0.2, 1.0)) == pytest.approx(both)
