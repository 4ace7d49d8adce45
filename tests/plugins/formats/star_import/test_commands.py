"""Missions of the original STAR."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from star_core import InputError, Mission
from star_core.formats import Value
from star_core.formats.located import Data, Mark
from star_core.toolkit import actions
from star_import.import_log import ImportLog
from star_import.records import records
from tests.plugins.formats.star_import.conftest import ROBOTS, Import, main, place, refusals

Fly = Callable[..., Mission]
"""A mission's commands, and options, to the mission that comes out."""

UP = '"takeoff", "wait", "all", "", "",\n'


def steps(mission: Mission) -> list[tuple[str, tuple[int, ...], dict[str, Any]]]:
    return [
        (
            step.verb,
            step.rows,
            {key: step.written[key] for key in step.written if key in step.options},
        )
        for step in actions(mission.steps)
    ]


def test_every_verb_has_its_step(commands: Fly) -> None:
    mission = commands(
        '"takeoff", "wait", "all", "", "",\n'
        '"hold", "wait", "all", "2.5", "",\n'
        '"goto_velocity", "wait", "cf1", "", "0.5 1 0.9 90",\n'
        '"external", "wait", "cf2", "", "",\n'
        '"land", "wait", "all", "", ""'
    )
    flight = {"to": [0.5, 1, 0.9], "yaw_deg": 90, "speed": 0.1, "within": 0.2}
    assert steps(mission) == [
        ("takeoff", (0, 1), {"height": 0.8, "speed": 0.2}),
        ("hold", (0, 1), {"for": 2.5}),
        ("goto", (0,), flight),
        ("external", (1,), {"max_silence": 5, "on_silence": "fail", "response_timeout": 5}),
        ("land", (0, 1), {}),
    ]


def test_orders_that_do_not_wait_run_with_the_next(commands: Fly) -> None:
    mission = commands(
        '"takeoff", "wait", "all", "", "",\n'
        '"goto_velocity", "conc", "cf1", "", "0 1 1 0",\n'
        '"goto_velocity", "wait", "cf2", "land", "0 -1 1 0",'
    )
    assert [type(step).__name__ for step in mission.steps] == ["Action", "Parallel"]
    assert [verb for verb, _, _ in steps(mission)] == ["takeoff", "goto", "goto", "land"]


def test_a_goto_turns_in_rad_and_a_goto_velocity_in_degrees(commands: Fly) -> None:
    mission = commands(
        UP + '"goto", "wait", "cf1", "", "0 1 1 1.570796",\n'
        '"goto_velocity", "wait", "cf1", "", "0 1 1 90"'
    )
    assert [options["yaw_deg"] for _, _, options in steps(mission)[1:]] == [
        pytest.approx(90.0, abs=1e-3),
        90,
    ]


def test_units_and_agents_on_the_ground_are_reported(take: Import, commands: Fly) -> None:
    commands('"hold", "wait", "cf1", "2", ""')
    notes = take("m.yaml", "crazyflies.yaml", "--force")
    units = "durations are in s, positions in m, yaw in degrees (goto_velocity) or rad (goto)"
    assert f"assumed m.yaml:1:19: {units}" in notes
    assert "changed m.yaml:2:1: cf1: not airborne at this point" in notes


def test_a_goto_moves_no_agent_as_executed(commands: Fly) -> None:
    text = UP + '"goto", "wait", "cf1", "", "0 1 1 0"'
    assert steps(commands(text, "--as-executed"))[1:] == [("hold", (0,), {})]
    assert steps(commands(text))[1][0] == "goto"


def test_the_grid_moves_goals_as_executed(commands: Fly) -> None:
    text = UP + '"goto_velocity", "wait", "cf1", "", "0 1 1 0"'
    (_, _, options) = steps(commands(text, "--as-executed"))[1]
    assert options["to"] == [-0.2, 0.8, 1]


def test_all_take_off_as_executed_whichever_are_named(commands: Fly) -> None:
    text = '"takeoff", "wait", "cf1", "", ""'
    assert steps(commands(text, "--as-executed"))[0][1] == (0, 1)
    assert steps(commands(text))[0][1] == (0,)


@pytest.mark.parametrize(
    ("records", "takeoffs"),
    [
        ('"takeoff", "wait", "cf1", "", "",\n"takeoff", "wait", "cf2", "", "",\n', [(0, 1)]),
        ('"takeoff", "conc", "cf1", "", "",\n"takeoff", "wait", "cf2", "", "",\n', [(0, 1)]),
        ('"takeoff", "wait", "all", "", "",\n"takeoff", "wait", "all", "", "",\n', [(0, 1)]),
    ],
)
def test_agents_in_the_air_do_not_take_off_again(
    commands: Fly, records: str, takeoffs: list[tuple[int, ...]]
) -> None:
    mission = commands(records + '"land", "wait", "all", "", ""', "--as-executed")
    flown = [rows for verb, rows, _ in steps(mission) if verb == "takeoff"]
    assert flown == takeoffs
    assert "  # line 3: in the air already\n" in Path("imported/m.yaml").read_text("utf-8")


def test_a_takeoff_of_all_is_that_of_those_on_the_ground(commands: Fly, take: Import) -> None:
    mission = commands('"takeoff", "wait", "cf1", "", "",\n' + UP + '"land", "wait", "all", "", ""')
    assert [rows for _, rows, _ in steps(mission)] == [(0,), (1,), (0, 1)]
    told = take("m.yaml", "crazyflies.yaml", "--force")
    assert "changed m.yaml:3:1: cf1: in the air already, no take-off" in told


def test_names_with_an_underscore_between_are_two(commands: Fly) -> None:
    assert steps(commands('"takeoff", "wait", "cf1_cf2", "", ""'))[0][1] == (0, 1)


def test_empty_command_lists_give_an_empty_mission(take: Import) -> None:
    place("empty.yaml", "command_sequence: [\n  # a comment\n]\n")
    told = take("empty.yaml", "--agent", "cf1=0,0")
    assert "assumed command_sequence: is empty, and so is the mission" in told


def test_a_record_without_a_task_is_reported_and_marked(take: Import) -> None:
    place("m.yaml", 'command_sequence: ["", "wait", "all", "", ""]\n')
    told = take("m.yaml", "--agent", "cf1=0,0")
    assert "ignored m.yaml:1:20: records without a task are skipped" in told
    assert "  # line 1: no task, ignored" in Path("imported/m.yaml").read_text("utf-8")


@pytest.mark.parametrize(
    ("record", "told"),
    [
        ('"hold", "wait", "all", "2000", ""',
         "assumed m.yaml:2:24: 2000 is read as seconds, as the original's code does; its README "
         "says milliseconds"),
        ('"hold", "soon", "all", "2", ""', "assumed m.yaml:2:9: 'soon' is read as 'conc'"),
        ('"hold", "conc", "all", "2", ""', "assumed m.yaml:2:1: the last record does not wait"),
        ('"hold", "wait", "all", "2", "1 2 3"', "ignored m.yaml:2:29: hold has no pose '1 2 3'"),
        ('"land", "wait", "all", "2", ""', "ignored m.yaml:2:24: land has no argument '2'"),
        (UP + '"goto_velocity", "wait", "cf1", "", "0 1 1 0.7"',
         "assumed m.yaml:3:1: yaw is read as degrees"),
    ],
)  # fmt: skip
def test_what_is_doubtful_is_reported(commands: Fly, take: Import, record: str, told: str) -> None:
    commands(record)
    described = take("m.yaml", "crazyflies.yaml", "--force")
    assert [line for line in described if line.startswith(told)]


@pytest.mark.parametrize("names", ["cf1,cf2", "all cf1"])
def test_names_that_are_not_separated_by_spaces_are_refused(names: str) -> None:
    place("m.yaml", f'command_sequence: ["land", "wait", "{names}", "", ""]\n')
    with pytest.raises(InputError) as raised:
        main(["m.yaml", "--agent", "cf1=0,0", "--agent", "cf2=1,0"])
    (problem,) = raised.value.problems
    assert problem.startswith("m.yaml:1:36: ")
    assert "expected 'all' alone, or names separated by spaces" in problem
    assert "--agent" not in problem


def test_externals_beside_each_other_have_a_port_each(commands: Fly) -> None:
    mission = commands(
        UP + '"external", "conc", "cf1", "", "", "external", "wait", "cf2", "", "",\n'
        '"external", "wait", "all", "", "", "land", "wait", "all", "", ""'
    )
    externals = [step for step in actions(mission.steps) if step.verb == "external"]
    assert [step.options["port"] for step in externals] == [5799, 5800, 5799]


def test_a_mission_without_robots_is_refused() -> None:
    place("m.yaml", "command_sequence: []\n")
    assert refusals("m.yaml") == ["m.yaml [invalid-input]"]
    place("m.yaml", 'command_sequence: ["land", "wait", "cf2", "", ""]')
    assert refusals("m.yaml") == ["m.yaml [invalid-input]", "m.yaml:1:36 [invalid-input]"]


def test_nothing_is_overwritten_by_default(take: Import) -> None:
    place("m.yaml", "command_sequence: []\n")
    take("m.yaml", "--agent", "cf1=0,0")
    assert refusals("m.yaml", "--agent", "cf1=0,0") == [
        "imported/worlds/m-room.yaml [invalid-input]",
        "imported/m.yaml [invalid-input]",
    ]
    take("m.yaml", "--agent", "cf1=0,0", "--force")


def test_an_import_does_not_write_over_what_it_read() -> None:
    place("crazyflies.yaml", ROBOTS)
    assert refusals("crazyflies.yaml", "--out", ".") == ["crazyflies.yaml [invalid-input]"]


words = st.sampled_from(["takeoff", "hold", "goto", "land", "external", "", "wait", "conc", "cf1"])
strings = st.lists(words | st.text("cf01_ .-e", max_size=6), max_size=15)


def value(data: Data, line: int = 1) -> Value:
    mark = Mark("m.yaml", line, 1)
    return Value(data, mark, mark)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(texts=strings)
def test_no_record_is_dropped_without_a_word(texts: list[str]) -> None:
    listed = value([value(text, i + 1) for i, text in enumerate(texts)])
    log = ImportLog()
    try:
        commands = records(value({"command_sequence": listed}), ["cf1", "cf2"], log)
    except InputError:
        assert len(texts) % 5
        return
    wrong = {(int(problem.split(":")[1]) - 1) // 5 for problem in log.problems}
    assert len(commands) + len(wrong) == len(texts) // 5
