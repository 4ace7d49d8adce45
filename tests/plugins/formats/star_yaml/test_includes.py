"""Steps from other files: values put in, places kept, mistakes located."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core.errors import InputError
from star_core.plugin_support.registry import Registry
from star_yaml import schema
from star_yaml.input_file import kind_of
from tests.core.conftest import Lab

PATROL = """\
star: 1
name: patrol
parameters: {who: all, seconds: 1, to: null}
mission:
  - visit: {agents: $who, to: $to}
  - wait: {seconds: $seconds}
"""
TOUR = """
  - climb: {}
  - include: {file: patrol.yaml, with: {who: cf1, to: [2, 0, 1]}}
  - descend: {}
"""


@pytest.fixture(autouse=True)
def _patrol(tmp_path: Path) -> None:
    (tmp_path / "patrol.yaml").write_text(PATROL)


def faults(lab: Lab, tour: str) -> list[str]:
    """What is wrong with a mission, without its folder."""
    with pytest.raises(InputError) as caught:
        lab.load(tour)
    return [problem.rpartition("/")[2] for problem in caught.value.problems]


def test_included_steps_are_flown_with_their_arguments(lab: Lab) -> None:
    summary = lab.fly(TOUR)
    assert [(step["verb"], step["agents"]) for step in summary["steps"]] == [
        ("climb", ["cf1", "cf2"]),
        ("visit", ["cf1"]),
        ("wait", ["cf1", "cf2"]),
        ("descend", ["cf1", "cf2"]),
    ]
    assert summary["outcome"] == "completed"


def test_a_value_that_is_not_given_is_the_one_of_the_file(lab: Lab) -> None:
    summary = lab.fly(TOUR)
    (wait,) = (step for step in summary["steps"] if step["verb"] == "wait")
    assert wait["ended_s"] - wait["begun_s"] == pytest.approx(1.0)


def test_a_step_is_located_in_its_own_file(lab: Lab) -> None:
    steps = lab.fly(TOUR)["steps"]
    assert [step["location"].rpartition("/")[2] for step in steps] == [
        "mission.yaml:11:5",
        "patrol.yaml:5:5",
        "patrol.yaml:6:5",
        "mission.yaml:13:5",
    ]
    (origin,) = steps[1]["included_from"]
    assert origin.endswith("mission.yaml:12:5")
    assert steps[0]["included_from"] == []
    begins = [text for text in lab.said("step") if " begins" in text]
    assert begins[1].startswith("patrol.yaml:5 (from mission.yaml:12) ")


def places(lab: Lab, tour: str) -> list[str]:
    """Where a mission's mistakes are, without its folder."""
    with pytest.raises(InputError) as caught:
        lab.load(tour)
    told = [problem.split(": ") for problem in caught.value.problems]
    return [
        " < ".join(part.rpartition("/")[2] for part in parts if ".yaml:" in part) for parts in told
    ]


def test_invalid_arguments_are_located_at_include_and_use(lab: Lab) -> None:
    wrong = TOUR.replace("who: cf1", "who: cf9")
    assert places(lab, wrong) == ["mission.yaml:12:46 < patrol.yaml:5:21"]


def test_only_the_include_with_the_wrong_argument_is_reported(lab: Lab) -> None:
    tour = (
        "\n  - climb: {}"
        "\n  - include: {file: patrol.yaml, with: {to: 1, who: cf1}}"
        "\n  - include: {file: patrol.yaml, with: {to: 1, who: cf8}}"
        "\n  - include: {file: patrol.yaml, with: {to: 1, who: [cf1, cf9]}}"
    )
    assert sorted(places(lab, tour)) == [
        "mission.yaml:13:53 < patrol.yaml:5:21",
        "mission.yaml:14:59 < patrol.yaml:5:21",
    ]


def test_a_default_that_does_not_fit_is_reported_where_it_stands(lab: Lab, tmp_path: Path) -> None:
    (tmp_path / "patrol.yaml").write_text(PATROL.replace("who: all", "who: al"))
    tour = TOUR.replace("who: cf1, ", "")
    assert places(lab, tour) == ["patrol.yaml:3:19 < patrol.yaml:5:21"]


def test_a_value_that_is_handed_on_is_reported_on_its_whole_way(lab: Lab, tmp_path: Path) -> None:
    (tmp_path / "outer.yaml").write_text(
        "star: 1\nparameters: {who: null}\n"
        "mission: [include: {file: patrol.yaml, with: {to: 1, who: [cf1, $who]}}]\n"
    )
    tour = "\n  - climb: {}\n  - include: {file: outer.yaml, with: {who: cf9}}"
    assert places(lab, tour) == ["mission.yaml:12:45 < outer.yaml:3:65 < patrol.yaml:5:21"]


def test_a_list_is_reported_with_the_places_of_the_values_in_it(lab: Lab, tmp_path: Path) -> None:
    (tmp_path / "low.yaml").write_text(
        "star: 1\nparameters: {x: 1, z: null}\n"
        "mission: [wait: {until: {near: {point: [$x, $x, $z, 0], within: 1}}}]\n"
    )
    tour = "\n  - include: {file: low.yaml, with: {z: 1}}"
    assert places(lab, tour) == ["low.yaml:2:17 < mission.yaml:11:41 < low.yaml:3:40"]


def test_what_a_map_that_is_given_has_too_much_is_reported_in_it(lab: Lab, tmp_path: Path) -> None:
    (tmp_path / "any.yaml").write_text("star: 1\nparameters: {o: null}\nmission: [visit: $o]\n")
    tour = "\n  - include: {file: any.yaml, with: {o: {too: [0, 0, 1]}}}"
    assert "mission.yaml:11:42 < any.yaml:3:18" in places(lab, tour)


def test_problems_of_a_file_included_twice_are_reported_once(lab: Lab, tmp_path: Path) -> None:
    (tmp_path / "patrol.yaml").write_text(PATROL.replace("to: null", "to: [0, 0, $who]"))
    assert faults(lab, TOUR + "  - include: {file: patrol.yaml}\n") == [
        "patrol.yaml:3:47: a default cannot refer to a parameter [misplaced-key]"
    ]


def test_a_value_that_has_to_be_given_is_missed_once(lab: Lab, tmp_path: Path) -> None:
    (tmp_path / "outer.yaml").write_text(
        "star: 1\nparameters: {there: null}\n"
        "mission:\n  - include: {file: patrol.yaml, with: {to: $there}}\n"
    )
    wrong = "\n  - climb: {}\n  - include: {file: outer.yaml, with: {there: null}}\n"
    (told,) = faults(lab, wrong)
    assert told.endswith(": needs a value for 'there': with: {there: ...} [missing-option]")


def test_files_may_include_files(lab: Lab, tmp_path: Path) -> None:
    (tmp_path / "outer.yaml").write_text(
        "star: 1\nparameters: {place: null}\n"
        "mission: [include: {file: patrol.yaml, with: {to: $place, who: cf2}}]\n"
    )
    tour = "\n  - climb: {}\n  - include: {file: outer.yaml, with: {place: [0, 2, 1]}}"
    assert [step["verb"] for step in lab.fly(tour)["steps"]] == ["climb", "visit", "wait"]


def test_a_step_may_be_a_parameter(lab: Lab, tmp_path: Path) -> None:
    (tmp_path / "twice.yaml").write_text(
        "star: 1\nparameters: {what: null}\nmission: [$what, repeat: {times: 1, steps: [$what]}]\n"
    )
    tour = "\n  - climb: {}\n  - include: {file: twice.yaml, with: {what: {wait: {seconds: 1}}}}"
    assert [step["verb"] for step in lab.fly(tour)["steps"]] == ["climb", "wait", "wait"]


@pytest.mark.parametrize("key", sorted(schema.load("mission")["properties"]))
def test_a_key_of_missions_makes_no_file_of_steps(key: str) -> None:
    data = {"star": 1, "name": "m", "mission": [], key: None}
    is_plain = key in {"star", "name", "mission"}
    assert kind_of(data, Registry()) == ("steps" if is_plain else "mission")


@pytest.mark.parametrize(
    ("keys", "kind"),
    [
        ("star", "mission"),
        ("star name rate", "mission"),
        ("star mission parameters", "steps"),
        ("star parameters", "steps"),
        ("star mission limits parameters", "steps"),
        ("star mission world parameters", "mission"),
        ("star mission paramters", "steps"),
        ("star mission wrold", "mission"),
        ("star fence", "world"),
        ("star fence swarm", "mission"),
        ("star fence mission", "mission"),
        ("star name matrix", "camera"),
        ("star name widht", "camera"),
        ("star name obstacls", "world"),
        ("star name width mission", "mission"),
    ],
)
def test_the_kind_of_a_file_follows_from_its_keys(keys: str, kind: str) -> None:
    assert kind_of(dict.fromkeys(keys.split()), Registry()) == kind
