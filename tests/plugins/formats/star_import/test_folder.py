"""Folders of the original STAR and of Crazyswarm2, checked and flown as they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core import InputError, Mission, Problem, Registry, fly, load
from star_core.formats import check_file
from star_core.toolkit import Action, actions
from tests.plugins.formats.star_import.conftest import ROBOTS

MISSION = """\
command_sequence: [
  "takeoff", "wait", "all", "", "",
  "goto_velocity", "conc", "cf1", "", "-1 1 0.7 0",
  "hold", "wait", "cf2", "0.2", "",
  "land", "wait", "all", "", ""
]
"""
LAB = """\
environment:
  obstacles:
    post: {use_key_point: false, height: [0, 2], thickness: 0.2, points: [3, 0, 3, 1]}
"""
CONFIG = """\
environment_file: lab.yaml
external_timeout: 3.0
trajectory_parameters:
  {max_velocity: 0.25, takeoff_height: 0.6, takeoff_land_velocity: 0.3, reached_threshold: 0.1,
  protected_zone: 0.15, height_range: [0.4, 1.8], planning_rate: 8.0}
"""
HEADER = ["duration", *(f"{axis}^{i}" for axis in ("x", "y", "z", "yaw") for i in range(8))]
EIGHT = ",".join(HEADER) + "\n" + ",".join(["1.0", *["0"] * 32]) + "\n"
IDEAL = ["transport.profile=ideal"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder as the original has them; it is the current one too."""
    for name, text in {
        "mission/up.yaml": MISSION,
        "environment/lab.yaml": LAB,
        "environment/hall.yaml": LAB.replace("post", "pillar"),
        "crazyflies.yaml": ROBOTS,
        "config.yaml": CONFIG,
        "server.yaml": "/crazyflie_server: {ros__parameters: {sim: {backend: np}}}\n",
    }.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text)
    return tmp_path


def loaded(path: str | Path, *assignments: str) -> Mission:
    return load(path, Registry(), assignments)


def checked(path: str | Path, *assignments: str) -> tuple[str, list[str]]:
    text, warnings = check_file(Path(path), Registry(), assignments)
    return text, [*warnings]


def problems(path: str | Path, *assignments: str) -> list[str]:
    with pytest.raises(InputError) as error:
        loaded(path, *assignments)
    return list(error.value.problems)


def verbs(mission: Mission) -> list[str]:
    return [action.verb for action in actions(mission.steps)]


def test_a_folder_of_the_original_flies(folder: Path) -> None:
    mission = loaded(folder, *IDEAL)
    assert verbs(mission) == ["takeoff", "goto", "hold", "land"]
    assert [obstacle.name for obstacle in mission.scene.world.obstacles] == ["post"]
    summary = fly(mission, Registry())
    assert summary["outcome"] == "completed"


@pytest.mark.usefixtures("folder")
def test_a_mission_is_flown_with_the_files_around_it() -> None:
    mission = loaded("mission/up.yaml")
    assert mission.scene.names == ("cf1", "cf2")
    takeoff, goto, *_ = actions(mission.steps)
    assert takeoff.written == {"height": 0.6, "speed": 0.3}
    assert (goto.written["within"], goto.written["speed"]) == (0.1, 0.25)
    assert mission.scene.limits.height == (0.4, 1.8)
    assert mission.plugins["avoider"].options["radius"] == 0.15


@pytest.mark.usefixtures("folder")
def test_steps_and_problems_have_the_locations_of_the_files() -> None:
    mission = loaded("mission/up.yaml")
    goto: Action = [*actions(mission.steps)][1]
    assert (goto.location, goto.label) == ("mission/up.yaml:3:3", "up.yaml:3 goto")
    text = "mission/up.yaml:3:3: as STAR reads it: too far [invalid-option]"
    assert mission.file.problem(goto.at, "too far") == text
    assert mission.file.located([Problem(goto.at, "too far")]) == [text]
    assert (mission.file.path, mission.world_file.path) == (
        Path("mission/up.yaml"),
        Path("environment/lab.yaml"),
    )


@pytest.mark.usefixtures("folder")
def test_goals_outside_the_limits_are_reported_in_the_mission() -> None:
    Path("mission/up.yaml").write_text(MISSION.replace("0.7 0", "3.0 0"))
    (problem,) = problems("mission/up.yaml")
    assert problem.startswith("mission/up.yaml:3:3: as STAR reads it: ")


@pytest.mark.usefixtures("folder")
def test_unknown_agents_can_be_added_by_their_start() -> None:
    Path("mission/up.yaml").write_text(MISSION.replace('"cf2"', '"cf9"'))
    assert problems("mission/up.yaml") == [
        "mission/up.yaml:4:19: no agent named 'cf9' among cf1, cf2; add its position: "
        "--set swarm.cf9.start=[X, Y, 0] [invalid-input]"
    ]
    mission = loaded("mission/up.yaml", "swarm.cf9.start=[2, 0, 0]", "seed=5")
    assert (mission.scene.names, mission.scene.seed) == (("cf1", "cf2", "cf9"), 5)


def test_check_names_each_mission_run_needs_one(folder: Path) -> None:
    Path("mission/down.yaml").write_text(MISSION)
    text, warnings = checked(folder)
    assert text.splitlines() == [
        f"{folder}/mission/{name}.yaml: {name!r} can be flown, with 2 agents"
        for name in ("down", "up")
    ]
    assert any("`star import" in warning for warning in warnings)
    assert problems(folder) == [
        f"{folder}: has several missions; name one: {folder}/mission/down.yaml, "
        f"{folder}/mission/up.yaml [wrong-file]"
    ]


def test_check_reports_the_mistakes_of_every_mission(folder: Path) -> None:
    for name in "down", "up":
        Path(f"mission/{name}.yaml").write_text(MISSION.replace('"cf2"', '"cf9"'))
    with pytest.raises(InputError) as error:
        checked(folder)
    assert [problem.partition(": ")[0] for problem in error.value.problems] == [
        f"{folder}/mission/{name}.yaml:4:19" for name in ("down", "up")
    ]


@pytest.mark.usefixtures("folder")
def test_the_environment_is_that_of_the_configuration() -> None:
    choice = "--set environment_file=NAME chooses one of hall.yaml, lab.yaml"
    (pillar,) = loaded("mission/up.yaml", "environment_file=hall").scene.world.obstacles
    assert pillar.name == "pillar"
    assert problems("mission/up.yaml", "environment_file=attic.yaml") == [
        f"--set environment_file=attic.yaml: no environment 'attic.yaml'; {choice} [file-not-found]"
    ]
    Path("config.yaml").write_text(CONFIG.replace("lab.yaml", "attic.yaml"))
    assert problems("mission/up.yaml") == [
        f"config.yaml:1:19: no environment 'attic.yaml'; {choice} [file-not-found]"
    ]
    Path("config.yaml").unlink()
    (problem,) = problems("mission/up.yaml")
    assert problem.endswith(f": has several environments; {choice} [wrong-file]")


def test_a_folder_without_its_environment_gets_a_warning(folder: Path) -> None:
    for file in Path("environment").iterdir():
        file.unlink()
    mission = loaded(folder)
    assert mission.scene.world.obstacles == ()
    (warning,) = [text for text in mission.warnings if "environment" in text]
    assert warning.startswith(f"{folder}/config.yaml:1:19: warning: this environment is not among")


@pytest.mark.usefixtures("folder")
def test_tags_that_overlap_are_flown_smaller_with_a_warning() -> None:
    tags = """\
april_tags:
  pair_position: [0, 0, 0, -0.122]
  pair_paper_size: [0.297, 0.420]
  tags:
    id000 id001: {alignment: top-left, location: [1, 1], purpose: relocalization}
    id009: {location: [3, 0.5], purpose: eliminate}
"""
    Path("environment/lab.yaml").write_text(LAB + tags)
    Path("tags.yaml").write_text("family: 36h11\nsize: 0.13\n")
    mission = loaded("mission/up.yaml")
    assert {tag.size for tag in mission.scene.world.landmarks} == {0.097}
    assert [tag.id for tag in mission.scene.world.targets] == [9]
    assert [obstacle.name for obstacle in mission.scene.world.virtual] == ["post"]
    texts = [warning.partition(": ")[2] for warning in mission.warnings]
    overlap = "tags 0.122 m apart overlap at an edge of 0.13 m; their edges are 0.097 m"
    assert f"warning: tags_0_1: {overlap}" in texts
    assert any(text.startswith("warning: post: is virtual, since target_9") for text in texts)


def test_a_folder_of_trajectories_flies(folder: Path) -> None:
    for name in ("mission/up.yaml", "config.yaml", "environment/hall.yaml"):
        Path(name).unlink()
    Path("eight.csv").write_text(EIGHT)
    Path("log.csv").write_text("time,x\n0,0\n")
    mission = loaded(folder, *IDEAL)
    assert verbs(mission) == ["takeoff", "follow", "land"]
    assert mission.scene.folder == folder
    assert fly(mission, Registry())["outcome"] == "completed"


@pytest.mark.usefixtures("folder")
def test_an_environment_is_checked_and_not_flown() -> None:
    text, _ = checked("environment/lab.yaml")
    assert text == "environment/lab.yaml: an environment that missions can be flown in"
    assert problems("environment/lab.yaml") == [
        "environment/lab.yaml: is an environment, expected a mission or robots [wrong-file]"
    ]


def test_two_files_of_robots_are_ambiguous(folder: Path) -> None:
    Path("mission/robots.yaml").write_text(ROBOTS)
    (problem,) = problems(folder)
    assert problem.startswith(f"{folder}: has several files of robots: ")


@pytest.mark.parametrize("text", ["", "star: 1\nrobots: {}\n"])
def test_files_of_star_and_other_folders_are_left_to_star(tmp_path: Path, text: str) -> None:
    Path("mine.yaml").write_text(text)
    (problem,) = problems(tmp_path)
    assert problem == f"{tmp_path}: is a directory, expected a YAML file [unreadable-file]"
    assert "mine.yaml:1:1" in problems("mine.yaml")[0]


@pytest.mark.usefixtures("folder")
def test_an_empty_list_of_commands_is_a_mission_that_does_nothing() -> None:
    Path("mission/up.yaml").write_text("command_sequence: [\n  # nothing\n]\n")
    text, _ = checked("mission/up.yaml")
    assert text == "mission/up.yaml: 'up' can be flown, with 2 agents"
