"""Base stations and anchors, as cflib and the Crazyflie client save them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from star_core import Registry, World, load
from star_core.toolkit import rotation_from_quaternion
from tests.plugins.formats.star_import.conftest import ROBOTS, Import, place, refusals

ANCHORS = "".join(
    f"{k}:\n  x: {x}\n  y: {y}\n  z: 0.2\n" for k, (x, y) in enumerate([(0, 0), (4, 0), (4, 5)])
)
GEOMETRY = """\
type: lighthouse_system_configuration
version: '1'
geos:
  0: {origin: [-1.9, -1.9, 2.1], rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}
  1: {origin: [1.9, 1.9, 2.1], rotation: [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]}
"""


def flown_in(world: str) -> World:
    """Return a world, by a mission that is flown in it."""
    Path("probe.yaml").write_text(
        f"star: 1\nname: probe\nworld: {world}\nswarm: {{a: {{start: [0, 0, 0]}}}}\n"
        "transport: sim\nlocalizer: flow\nplanner: straight\navoider: none\nmission: [hold: {}]\n",
        encoding="utf-8",
    )
    return load(Path("probe.yaml"), Registry()).scene.world


@pytest.mark.parametrize("angles", [(2.0, 30.0, 45.0), (-1.0, 29.5, -135.0), (0.0, 90.0, 20.0)])
def test_base_stations_of_cflib_keep_their_poses(angles: Sequence[float], take: Import) -> None:
    localization = pytest.importorskip("cflib.localization")
    memory = pytest.importorskip("cflib.crazyflie.mem")
    matrix = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    stations = {}
    for channel in (0, 3):
        station = stations[channel] = memory.LighthouseBsGeometry()
        station.valid, station.origin = True, [channel, channel + 0.5, 2.1]
        station.rotation_matrix = matrix.astype(np.float32).tolist()  # as a drone keeps it
    calibrations = dict.fromkeys(stations, memory.LighthouseBsCalibration())
    calibrations[0].valid = True
    localization.LighthouseConfigFileManager.write("lab.yaml", stations, calibrations)
    log = take("lab.yaml", "--fence", "-1", "-1", "0", "1", "1", "2")
    assert "ignored lab.yaml:2:3: calibrations of base stations stay on board" in log
    first, second = flown_in("imported/worlds/lab.yaml").base_stations
    assert (first.name, second.name) == ("bs1", "bs4")
    assert second.position == pytest.approx((3.0, 3.5, 2.1))
    rotation = rotation_from_quaternion(np.array(first.rotation))
    assert rotation == pytest.approx(matrix, abs=1e-3)


def test_fence_of_a_world_is_between_its_anchors(take: Import) -> None:
    place("room.yaml", ANCHORS)
    text = "assumed room.yaml:2:3: the fence is from [0, 0, 0] to [4, 5, 2.2] m, between them"
    assert take("room.yaml") == [text]
    world = flown_in("imported/worlds/room.yaml")
    assert [anchor.name for anchor in world.anchors] == ["a0", "a1", "a2"]
    assert world.anchors[2].position == (4.0, 5.0, 0.2)
    assert world.fence.high == (4.0, 5.0, 2.2)


@pytest.mark.parametrize(
    ("file", "system"), [(GEOMETRY, "lighthouse"), (ANCHORS, "loco"), ("", "flow")]
)
def test_robots_are_flown_by_the_system_beside_them(file: str, system: str, take: Import) -> None:
    place("crazyflies.yaml", ROBOTS)
    place("lab.yaml", file or "camera_matrix: [1, 0, 1, 0, 1, 1, 0, 0, 1]\n"
          "distortion_coefficients: [0]\n")  # fmt: skip
    take("crazyflies.yaml", "lab.yaml")
    mission = load(Path("imported/crazyflies.yaml"), Registry())
    choice = mission.file.data["localizer"]
    assert (choice if system == "flow" else choice["system"]) == system
    assert mission.scene.onboard_system == (None if system == "flow" else system)


def test_anchor_without_height_is_refused() -> None:
    place("room.yaml", ANCHORS.replace("  z: 0.2\n", "", 1))
    assert refusals("room.yaml") == ["room.yaml:2:3 [missing-option]"]


def test_beacons_that_span_no_room_need_a_fence() -> None:
    place("lab.yaml", GEOMETRY.replace("1.9, 1.9", "-1.9, 1.9", 1))
    assert refusals("lab.yaml") == ["lab.yaml:4:6 [missing-option]"]
    assert not Path("imported").exists()
