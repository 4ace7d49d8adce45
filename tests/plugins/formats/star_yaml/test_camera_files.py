"""Cameras from files of their own: put in, overruled by the mission, kept with the flight."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from star_core import Camera, InputError, Registry, load
from star_core.commands.main import main
from star_core.records.manifest import manifest
from star_yaml import schema
from star_yaml.editor_schema import for_editors
from tests.commands import position_and_code

FILE = """\
star: 1
name: lens
width: 320
height: 240
matrix: [190, 191, 160, 120]
pitch_deg: 20
"""
OWN = {"width": 320, "height": 240, "matrix": [190, 191, 160, 120], "pitch_deg": 20}
CAMERAS = "cameras: {mine: {file: cameras/lens.yaml, rate: 8, pitch_deg: 30}}\n"


@pytest.fixture(autouse=True)
def _seeing(hop: Path) -> None:
    """The mission hop.yaml, whose first agent has the camera of a file."""
    (hop / "cameras").mkdir()
    (hop / "cameras/lens.yaml").write_text(FILE)
    text = (hop / "hop.yaml").read_text().replace("0, 0]}", "0, 0], camera: mine}", 1)
    (hop / "hop.yaml").write_text(text + CAMERAS)


def camera(*assignments: str) -> Camera:
    """What the first agent sees with."""
    sensor = load("hop.yaml", Registry(), assignments).scene.agents[0].camera
    assert sensor is not None
    return sensor


def refusal(*assignments: str) -> str:
    with pytest.raises(InputError) as caught:
        load("hop.yaml", Registry(), assignments)
    return str(caught.value)


def test_an_agent_sees_as_in_the_file() -> None:
    sensor = camera()
    assert (sensor.width, sensor.height) == (320, 240)
    assert sensor.matrix == (190.0, 191.0, 160.0, 120.0)


def test_values_of_the_mission_itself_win() -> None:
    sensor = camera()
    assert sensor.rate == 8
    assert sensor.pitch == pytest.approx(0.5236, abs=1e-4)


def test_what_neither_sets_is_an_ai_deck_s() -> None:
    assert camera().distortion == Camera().distortion


def test_what_is_set_on_the_command_line_wins_over_both() -> None:
    assert camera("cameras.mine.rate=5", "cameras.mine.width=324").width == 324
    assert camera("cameras.mine.rate=5").rate == 5


def test_another_file_may_be_set_on_the_command_line() -> None:
    Path("other.yaml").write_text(FILE.replace("190", "200"))
    assert camera("cameras.mine.file=other.yaml").matrix[0] == 200
    assert camera("cameras={mine: {file: other.yaml}}").pitch == pytest.approx(0.3491, abs=1e-4)


def test_two_cameras_may_be_of_one_file() -> None:
    Path("hop.yaml").write_text(
        Path("hop.yaml")
        .read_text()
        .replace("cameras: {", "cameras: {low: {file: cameras/lens.yaml}, ")
    )
    assert camera("swarm.cf1.camera=low").pitch == pytest.approx(0.3491, abs=1e-4)


def test_a_file_that_is_set_and_not_there_is_reported_as_set() -> None:
    refused = refusal("cameras.mine.file=cameras/lans.yaml")
    assert refused.startswith("--set cameras.mine.file=cameras/lans.yaml: ")
    assert refused.endswith(" [file-not-found]")


def test_problems_of_shared_camera_files_are_reported_once() -> None:
    Path("cameras/lens.yaml").write_text(FILE.replace("width", "widht").replace("1\n", "2\n", 1))
    two = "cameras={mine: {file: cameras/lens.yaml}, low: {file: cameras/lens.yaml}}"
    assert [*map(position_and_code, refusal(two).splitlines())] == [
        "cameras/lens.yaml:1:7 [unsupported-version]",
        "cameras/lens.yaml:3:1 [unknown-option]",
    ]


def test_a_mission_is_kept_with_the_contents_of_its_camera_files() -> None:
    kept = manifest(load("hop.yaml", Registry()), Registry())["mission"]
    assert kept["cameras"] == {"mine": {**OWN, "rate": 8, "pitch_deg": 30}}


def test_manifests_restore_cameras_without_their_file() -> None:
    before = camera()
    mission = manifest(load("hop.yaml", Registry()), Registry())["mission"]
    Path("cameras/lens.yaml").unlink()
    Path("hop.yaml").write_text(json.dumps(mission))
    assert camera() == before


@pytest.mark.parametrize("command", ["check", "explain"])
def test_commands_read_a_mission_with_the_camera_of_a_file(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "hop.yaml"]) == 0
    assert "hop" in capsys.readouterr().out


def test_a_camera_in_a_file_has_what_one_in_a_mission_has() -> None:
    in_file = schema.load("camera")["properties"]
    in_mission = schema.load("mission")["$defs"]["camera"]["properties"]
    assert {key: in_file[key] for key in in_file.keys() - {"star", "name"}} == {
        key: in_mission[key] for key in in_mission.keys() - {"file"}
    }


def test_the_schema_knows_every_key_of_a_camera_and_its_default() -> None:
    properties: dict[str, Any] = schema.load("camera")["properties"]
    usual = Camera()
    names = {field.name for field in fields(Camera)}
    assert {key.removesuffix("_deg") for key in properties} == names | {"star", "name"}
    for key in names & properties.keys():
        assert properties[key]["default"] == pytest.approx(getattr(usual, key)), key


def test_the_schema_of_a_camera_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", "camera"]) == 0
    assert json.loads(capsys.readouterr().out) == for_editors(schema.load("camera"))
