"""Launch folders of the original STAR: all missions at once, and files that are none of its."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from star_core import Registry, load
from star_core.commands.main import main as star
from star_core.toolkit import actions
from star_import.import_log import Note, Severity, table
from tests.plugins.formats.star_import.conftest import ROBOTS, Import, refusals, remark
from tests.plugins.formats.star_import.originals import launch_folder

LAB = """\
april_tags:
  pair_position: [0, 0, 0, -0.2]
  pair_paper_size: [0.297, 0.420]
  tags:
    id000 id001: {alignment: top-left, location: [1, 1], purpose: relocalization}
    id009: {location: [0.5, 0.5], purpose: eliminate}
"""
UP = 'command_sequence: ["takeoff", "wait", "all", "", ""{}]\n'
CAMERA = """\
image_width: 320
image_height: 240
camera_name: cf2
camera_matrix: {rows: 3, cols: 3, data: [180, 0, 160, 0, 181, 120, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.01, 0, 0, 0]}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a launch folder with two missions, one of them for an agent that there is not."""
    for name, text in {
        "launch/mission/up.yaml": UP.format(""),
        "launch/mission/out.yaml": UP.format(', "land", "wait", "cf9", "", ""'),
        "launch/environment/lab.yaml": LAB,
        "launch/environment/hall.yaml": "april_tags: {tags: {}}\n",
        "launch/crazyflies.yaml": ROBOTS,
        "launch/config.yaml": "environment_file: lab.yaml\n",
        "launch/calibration/cf2.yaml": CAMERA,
        "launch/README.md": "not read",
        "launch/broken.yaml": "colour: [",
    }.items():
        Path(name).parent.mkdir(exist_ok=True, parents=True)
        Path(name).write_text(text)
    return tmp_path / "launch"


def imported(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    status = star(["import", *arguments, "--json"])
    return status, json.loads(capsys.readouterr().out)


@pytest.mark.usefixtures("folder")
def test_missions_that_can_be_imported_are_beside_refused_ones(
    capsys: pytest.CaptureFixture[str],
) -> None:
    status, answer = imported(capsys, "launch")
    assert status == 2
    assert answer["written"] == ["imported/worlds/lab.yaml", "imported/up.yaml"]
    refused = [note for note in answer["notes"] if note["severity"] == "refused"]
    assert [(note["file"], note["line"], note["code"]) for note in refused] == [
        ("launch/mission/out.yaml", 1, "invalid-input")
    ]
    ignored = [note["about"] for note in answer["notes"] if "no files of" in note["message"]]
    assert ignored == ["README.md", "broken.yaml"]
    status, answer = imported(capsys, "launch", "--agent", "cf9=2,0", "--force")
    assert (status, len(answer["written"])) == (0, 3)


@pytest.mark.usefixtures("folder")
def test_a_file_with_a_misspelt_key_is_not_just_ignored(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "mission/out.yaml").write_text("# of two\ncomand_sequence: []\n")
    (folder / "mine.yaml").write_text("star: 1\nrobotz: {}\n")
    status, answer = imported(capsys, "launch")
    assert status == 0
    (note,) = (note for note in answer["notes"] if "did you mean" in note["message"])
    assert (note["severity"], note["file"], note["line"]) == (
        "changed",
        "launch/mission/out.yaml",
        2,
    )
    assert note["message"].endswith("'comand_sequence'; did you mean 'command_sequence'?")


@pytest.mark.usefixtures("folder")
def test_the_list_is_a_table_by_severity(capsys: pytest.CaptureFixture[str]) -> None:
    assert star(["import", "launch", "--environment", "hall"]) == 2
    *rows, written, summary = capsys.readouterr().out.splitlines()
    order = ["refused", "changed", "assumed", "ignored"]
    words = [row.split()[0] for row in rows if not row.startswith(" ")]
    assert words == sorted(words, key=order.index)
    assert len(rows) <= 20
    assert written == "written: imported/worlds/hall.yaml, imported/up.yaml"
    assert summary == "1 of 2 missions cannot be imported"


def test_a_terminal_has_messages_below_their_locations() -> None:
    notes = [Note(Severity.IGNORED, "launch/crazyflies.yaml:16:5", "is not enabled " * 4, "cf3")]
    location, *message = table(notes, 50).splitlines()
    assert location == "ignored  launch/crazyflies.yaml:16:5"
    assert message == [
        "         cf3: is not enabled is not enabled is not",
        "         enabled is not enabled",
    ]


@pytest.mark.usefixtures("folder")
def test_a_broken_file_that_is_named_is_refused(take: Import) -> None:
    refused = refusals("launch/mission/up.yaml", "launch/broken.yaml")
    assert refused == ["launch/broken.yaml:1:9 [invalid-yaml]"]
    Path("launch/broken.yaml").write_text("colour: blue\n")
    take("launch/mission/up.yaml", "launch/crazyflies.yaml", "launch/broken.yaml")


@pytest.mark.usefixtures("folder")
def test_calibrations_are_the_cameras_of_their_agents(take: Import) -> None:
    files = ["launch/mission/up.yaml", "launch/crazyflies.yaml", "launch/environment/lab.yaml",
             "launch/calibration/cf2.yaml"]  # fmt: skip
    notes = take(*files)
    first, second = load(Path("imported/up.yaml"), Registry()).scene.agents
    assert first.camera is not None
    assert first.camera == second.camera
    assert (first.camera.width, first.camera.matrix) == (320, (180, 181, 160, 120))
    assert "this calibration serves cf1 too" in "\n".join(notes)
    Path("cf1.yaml").write_text(CAMERA.replace("cf2", "cf1").replace("180,", "190,"))
    take(*files, "cf1.yaml", "--force")
    agents = load(Path("imported/up.yaml"), Registry()).scene.agents
    assert [agent.camera.matrix[0] for agent in agents if agent.camera] == [190, 180]


@pytest.mark.usefixtures("folder")
def test_the_first_agent_that_sees_a_target_lands_there(take: Import) -> None:
    config = "environment_file: lab.yaml\napril_tag_parameters: {observation_threshold: 1.5}\n"
    Path("launch/config.yaml").write_text(config)
    take("launch/mission/up.yaml", "launch")
    mission = load(Path("imported/up.yaml"), Registry())
    (reaction,) = mission.reactions
    assert reaction.first
    assert str(reaction.when) == ("('target_9' is found and all are within 1.5 m of [0.5, 0.5, 0])")
    goto, land = [*actions(reaction.steps)][:2]
    assert (goto.verb, goto.written["to"], land.verb) == ("goto", [0.5, 0.5, 0.8], "land")


@pytest.mark.usefixtures("folder")
def test_agents_fly_to_the_corners_of_a_grid_as_executed(take: Import) -> None:
    flight = ', "goto_velocity", "wait", "{}", "", "1 2 1 0"'
    text = "robots:\n" + "".join(
        f"  {name}: {{uri: radio://0/80/2M/E7, initial_position: [{i}, -1, 0]}}\n"
        for i, name in enumerate(("cf2", "cf10", "cf1"))
    )
    Path("launch/crazyflies.yaml").write_text(text)
    goals = {}
    for names in ("all", "cf1 cf2"):
        Path("m.yaml").write_text(UP.format(flight.format(names)))
        take("m.yaml", "launch/crazyflies.yaml", "--as-executed", "--force")
        mission = load(Path("imported/m.yaml"), Registry())
        steps = [step for step in actions(mission.steps) if step.verb == "goto"]
        goals[names] = {mission.scene.names[step.rows[0]]: step.written["to"][:2] for step in steps}
    # three agents: d = 2, in the order of their names cf1, cf10, cf2
    assert goals["all"] == {"cf1": [0.6, 1.6], "cf10": [0.6, 2.0], "cf2": [1.0, 1.6]}
    assert goals["cf1 cf2"] == {"cf1": [0.6, 1.6], "cf2": [0.6, 2.0]}


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.extended) for seed in range(1, 4))]
)
def test_drawn_launch_folders_are_imported(
    tmp_path: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is refused is so for a reason of the file: an agent that is commanded twice at once."""
    folder = launch_folder(tmp_path / "drawn", seed)
    for flags in ((), ("--as-executed",)):
        arguments = (str(folder), "--environment", f"room{seed % 3}", "--force", *flags)
        status, answer = imported(capsys, *arguments)
        refused = [note for note in answer["notes"] if note["severity"] == "refused"]
        assert {note.get("code") for note in refused} <= {"agent-conflict"}, [
            remark(note) for note in refused
        ]
        assert status == (2 if refused else 0)
        for name in answer["written"][1:]:
            load(Path(name), Registry())


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff{}",
        '"command_sequence": {}',
        "{{command_sequence: {}}}",
        "# as indented as\n  # its list\n  command_sequence: {}",
    ],
)
def test_missions_of_a_folder_are_found_however_written(
    folder: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    (folder / "mission/out.yaml").unlink()
    flown = UP.format("").strip()
    content = text.format(flown if text.startswith("\ufeff") else flown.split(": ")[1])
    (folder / "mission/up.yaml").write_text(content, encoding="utf-8")
    status, answer = imported(capsys, "launch")
    assert (status, answer["written"][1]) == (0, "imported/up.yaml")


def test_missions_of_a_folder_share_a_fence_around_all(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, x in (("up", 8), ("out", 1)):
        goal = f', "goto_velocity", "wait", "cf1", "", "{x} 0 1 0"'
        (folder / f"mission/{name}.yaml").write_text(UP.format(goal))
    status, answer = imported(capsys, "launch")
    assert status == 0
    for name in ("up", "out"):
        high = load(Path(f"imported/{name}.yaml"), Registry()).scene.world.fence.high
        assert high[0] == 9
    fences = [note["message"] for note in answer["notes"] if note["file"] == "fence"]
    assert fences == ["from [-2, -1, 0] to [9, 2, 2.2] m, around everything"]


def test_a_second_mission_of_one_name_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "mission/old").mkdir()
    (folder / "mission/out.yaml").unlink()
    (folder / "mission/old/up.yaml").write_text("command_sequence: []\n")
    status, answer = imported(capsys, "launch")
    (refused,) = (note for note in answer["notes"] if note["severity"] == "refused")
    assert (status, refused["file"], refused["code"]) == (
        2,
        "launch/mission/old/up.yaml",
        "duplicate-name",
    )


@pytest.mark.parametrize(
    ("numbers", "problem"),
    [
        ("height_range: [2.0, 0.5]", "launch/config.yaml:3:17 [empty-range]"),
        ("max_velocity: 30", "launch/config.yaml:3:3 [out-of-range]"),
    ],
)
def test_numbers_that_no_flight_has_are_located(folder: Path, numbers: str, problem: str) -> None:
    text = f"environment_file: lab.yaml\ntrajectory_parameters:\n  {numbers}\n"
    (folder / "config.yaml").write_text(text)
    assert problem in refusals("launch")


def test_the_fence_is_as_high_as_agents_may_fly(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "environment_file: lab.yaml\ntrajectory_parameters: {height_range: [0.5, 3]}\n"
    (folder / "config.yaml").write_text(text)
    goal = ', "goto_velocity", "wait", "cf1", "", "1 0 3 0"'
    (folder / "mission/out.yaml").write_text(UP.format(goal))
    assert imported(capsys, "launch")[0] == 0
    assert load(Path("imported/out.yaml"), Registry()).scene.world.fence.high[2] == 3.2


def test_misspelt_keys_of_numbers_are_not_just_ignored(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "environment_file: lab.yaml\ntrajectory_parameters: {max_velocty: 0.3, other: 1}\n"
    (folder / "config.yaml").write_text(text)
    rows = [remark(note) for note in imported(capsys, "launch")[1]["notes"]]
    assert (
        "changed launch/config.yaml:2:38: trajectory_parameters.max_velocty: has no effect: "
        "unknown key; did you mean 'max_velocity'?"
    ) in rows
    assert any("trajectory_parameters.other: has no counterpart" in row for row in rows)


@pytest.mark.usefixtures("folder")
def test_robots_with_a_misspelt_key_are_named_in_a_refusal(folder: Path) -> None:
    (folder / "crazyflies.yaml").write_text(ROBOTS.replace("robots:", "robot:", 1))
    refused = refusals("launch/mission/up.yaml", "launch")
    assert "launch/crazyflies.yaml:1:1 [invalid-input]" in refused


@pytest.mark.usefixtures("folder")
def test_files_beyond_the_most_are_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("star_import.sources.MOST", 8)
    _, answer = imported(capsys, "launch", "--agent", "cf9=2,0")
    assert answer["written"] == ["imported/worlds/lab.yaml", "imported/out.yaml"]
    rows = [remark(note) for note in answer["notes"]]
    assert [row for row in rows if row.startswith("changed launch: only ")]
