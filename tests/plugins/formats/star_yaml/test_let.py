"""Names for values: replaced everywhere, located, set from outside, and bounded."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core.errors import InputError
from star_core.plugin_support.registry import Registry
from star_core.toolkit import actions
from star_yaml.mission_loader import load
from star_yaml.yaml_reader import parse

NAMED = """\
star: 1
name: named
let: {height: 0.8, side: $(height + 0.2), corner: [$side, $(-side), $height], home: cf1}
world: lab.yaml
limits: {height: [0.2, $(2 * height)]}
swarm:
  cf1: {start: [$(-side), 0.0, 0.0]}
  cf2: {start: [$side, 0.0, 0.0]}
transport: sim
localizer: flow
planner: straight
avoider: {use: orca, radius: $(height / 4)}
mission:
  - takeoff: {height: $height}
  - goto: {agents: $home, to: $corner}
  - each:
      with: {cf1: {by: [0.0, 0.5, 0.0], turns: 1}, cf2: {by: [0.0, -0.5, 0.0], turns: 2}}
      steps:
        - repeat: {times: $turns, steps: [goto: {by: $by}]}
        - hold: {for: "$(max(turns, height))"}
  - land: {}
"""
PLAIN = """\
star: 1
name: named
world: lab.yaml
limits: {height: [0.2, 1.6]}
swarm:
  cf1: {start: [-1.0, 0.0, 0.0]}
  cf2: {start: [1.0, 0.0, 0.0]}
transport: sim
localizer: flow
planner: straight
avoider: {use: orca, radius: 0.2}
mission:
  - takeoff: {height: 0.8}
  - goto: {agents: cf1, to: [1.0, -1.0, 0.8]}
  - parallel:
      - each:
          agents: cf1
          steps: [repeat: {times: 1, steps: [goto: {by: [0.0, 0.5, 0.0]}]}, hold: {for: 1}]
      - each:
          agents: cf2
          steps: [repeat: {times: 2, steps: [goto: {by: [0.0, -0.5, 0.0]}]}, hold: {for: 2}]
  - land: {}
"""


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("lab.yaml").write_text("star: 1\nname: lab\nfence: {low: [-2, -2, 0], high: [2, 2, 2]}\n")


def wrong(text: str, *assignments: str) -> list[str]:
    """What is wrong with a mission, without codes."""
    Path("m.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        load("m.yaml", Registry(), assignments)
    return [problem.rpartition(" [")[0] for problem in caught.value.problems]


def test_a_mission_with_names_is_the_one_without_them() -> None:
    Path("m.yaml").write_text(NAMED)
    Path("plain.yaml").write_text(PLAIN)
    named, plain = load("m.yaml", Registry()), load("plain.yaml", Registry())
    assert {key: value for key, value in named.source.items() if key != "let"} == plain.source
    assert named.scene == plain.scene
    assert [(step.verb, step.rows, step.options) for step in actions(named.steps)] == [
        (step.verb, step.rows, step.options) for step in actions(plain.steps)
    ]


def test_a_record_has_the_values_of_all_names() -> None:
    Path("m.yaml").write_text(NAMED)
    assert load("m.yaml", Registry()).source["let"] == {
        "height": 0.8, "side": 1.0, "corner": [1.0, -1.0, 0.8], "home": "cf1",
    }  # fmt: skip


def test_a_name_that_is_set_changes_what_depends_on_it() -> None:
    Path("m.yaml").write_text(NAMED)
    mission = load("m.yaml", Registry(), ["let.height=0.6"])
    takeoff, goto, *_ = actions(mission.steps)
    assert takeoff.options["height"] == 0.6
    assert goto.options["to"] == [0.8, -0.8, 0.6]
    assert mission.scene.limits.height == (0.2, 1.2)
    assert mission.scene.agents[0].start[0] == -0.8


def test_only_names_that_there_are_can_be_set() -> None:
    assert wrong(NAMED, "let.hieght=0.6") == [
        "--set let.hieght=0.6: nothing in 'let' is named 'hieght'; did you mean 'height'?"
    ]


def test_a_wrong_value_is_located_where_it_is_and_where_it_is_used() -> None:
    problems = wrong(NAMED.replace("home: cf1", "home: cf9"))
    assert problems == [
        "m.yaml:3:85: m.yaml:15:20: no agent or group named 'cf9'; did you mean 'cf2'?"
    ]


def test_names_cannot_stand_for_endless_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("star_yaml.scopes.MAX_VALUES", 10_000)
    doubled = "\n".join(f"  l{i + 1}: [{', '.join([f'$l{i}'] * 10)}]" for i in range(8))
    (problem,) = wrong(NAMED.replace("let: {", f"let:\n  l0: 1\n{doubled}\ngroups: {{"))
    assert "stand for more than" in problem


def test_a_sign_within_a_text_stays() -> None:
    Path("m.yaml").write_text(PLAIN.replace("cf1: {start", "cf1: {uri: 'radio://$x', start"))
    assert load("m.yaml", Registry()).scene.agents[0].uri == "radio://$x"


def test_columns_of_expressions_are_those_after_a_quote() -> None:
    value = parse("a: '$(1)'", "m.yaml").need("a")
    assert str(value.mark) == "m.yaml:1:5"
