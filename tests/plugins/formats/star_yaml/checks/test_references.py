"""What is wrong with a mission or a world that fits its schema."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import star_yaml
from star_core.discovery import Source
from star_core.errors import InputError, Problem
from star_core.plugin_support.hookspecs import hookimpl
from star_core.plugin_support.registry import Registry
from star_core.plugin_support.specs import SPECS
from star_yaml.mission_loader import load
from star_yaml.step_tree import rows_of
from tests.plugins.formats.star_yaml.problems import problems as located

WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
obstacles:
  pillar: {polygon: [[0.8, 0.8], [1.2, 0.8], [1, 1.2]], height: [0, 2]}
"""
MISSION = """\
star: 1
name: checked
world: room.yaml
limits: {height: [0.2, 1.8]}
swarm:
  cf1: {start: [-1, 0, 0]}
  cf2: {start: [0, 0, 0]}
  cf3: {start: [1, 0, 0]}
groups: {pair: [cf1, cf2]}
transport: link
localizer: guess
planner: crow
avoider: shy
mission:
  - wait: {}
"""
NUMBER = {"type": "number"}
NAMES = {
    "transport": "link",
    "localizer": "guess",
    "planner": "crow",
    "avoider": "shy",
    "task": "wait",
}


class Parts:
    """A plugin that offers one part of every kind, and the verb ``wait``.

    Args:
        options: Properties of the options of each kind that has any.
        faults: What each kind's own check finds, or raises.

    Attributes:
        asked: The arguments that each kind's check was called with.
    """

    def __init__(
        self,
        options: Mapping[str, Mapping[str, Any]] | None = None,
        faults: Mapping[str, Iterable[Problem] | BaseException] | None = None,
    ) -> None:
        self._options = options or {}
        self._faults = faults or {}
        self.asked: dict[str, tuple[Any, ...]] = {}
        for kind, name in NAMES.items():
            setattr(self, f"star_{kind}s", hookimpl(self._offering(kind, name)))

    def _offering(self, kind: str, name: str) -> Callable[[], list[Any]]:
        def check(*arguments: Any, **options: Any) -> Iterable[Problem]:
            self.asked[kind] = (*arguments, options)
            answer = self._faults.get(kind, ())
            if isinstance(answer, BaseException):
                raise answer
            return answer

        options = {"type": "object", "properties": self._options.get(kind, {})}
        spec: Any = SPECS[kind]
        summary = f"The {name}."
        offer = spec(name=name, summary=summary, make=object, options=options, check=check)
        return lambda: [offer]


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("room.yaml").write_text(WORLD)


def registry(plugin: object | None = None) -> Registry:
    """A registry of one plugin, of the distribution ``their-dist``."""
    only = Registry(star_yaml, installed=False)
    only.add(plugin or Parts(), Source("their-dist:parts", "1.2"))
    return only


def problems(text: str, plugin: object | None = None) -> list[str]:
    """Where a mission cannot be flown, with codes; none if it can."""
    return located(text, registry(plugin))


def with_steps(steps: str) -> str:
    return MISSION.replace("  - wait: {}\n", steps)


# Names


def test_every_part_receives_the_groups_of_a_mission(missions: Path) -> None:
    groups = "groups={ends: [cf3, cf1], pair: [cf1, cf2]}"
    scene = load(missions / "first_flight.yaml", Registry(), [groups]).scene
    assert scene.groups == {"ends": (2, 0), "pair": (0, 1)}
    assert hash(scene) == hash(replace(scene, groups={}))


@pytest.mark.parametrize(
    ("names", "rows"),
    [
        ("all", tuple(range(9))),
        ("ends", (0, 8)),
        (["ends", "cf1"], (0, 8)),
        (["cf19", "cf2"], (1,)),
    ],
)
def test_agents_of_a_step_are_unique_and_in_swarm_order(
    names: str | list[str], rows: tuple[int, ...]
) -> None:
    agents = {f"cf{row + 1}": (row,) for row in range(8)}
    groups = {**agents, "ends": (8, 0), "all": tuple(range(9))}
    assert rows_of(names, groups) == rows


# Agents that move in a parallel


@pytest.mark.parametrize(
    "branches",
    [
        "{wait: {agents: pair}}, {wait: {agents: cf3}}",
        "{repeat: {times: 2, steps: [{wait: {agents: cf1}}, {wait: {agents: cf1}}]}}",
        "{parallel: [{wait: {agents: cf1}}, {wait: {agents: cf2}}]}, {wait: {agents: cf3}}",
    ],
)
def test_agents_of_their_own_may_move_in_every_branch(branches: str) -> None:
    assert problems(with_steps(f"  - parallel: [{branches}]\n")) == []


@pytest.mark.parametrize(
    ("branches", "column"),
    [
        ("{wait: {agents: pair}}, {wait: {}}", 47),
        ("{wait: {agents: cf1}}, {repeat: {times: 1, steps: [{wait: {agents: pair}}]}}", 48),
        ("{parallel: [{wait: {agents: cf3}}]}, {wait: {agents: [cf2, cf3]}}", 60),
    ],
)
def test_an_agent_cannot_move_in_two_branches(branches: str, column: int) -> None:
    steps = f"  - parallel: [{branches}]\n"
    assert problems(with_steps(steps)) == [f"15:{column} [agent-conflict]"]


# Starts and limits


@pytest.mark.parametrize(
    ("avoider", "options"),
    [
        ("{use: shy, radius: 0.51}", {"radius": NUMBER}),
        ("shy", {"radius": NUMBER | {"default": 0.6}}),
        ("{use: shy, radius: 0.75}", {"radius": NUMBER | {"default": 0.1}}),
    ],
)
def test_starts_are_at_least_two_radii_of_the_avoider_apart(
    avoider: str, options: Mapping[str, Any]
) -> None:
    mission = MISSION.replace("avoider: shy", f"avoider: {avoider}")
    locations = problems(mission, Parts({"avoider": options}))
    assert locations == ["7:16 [too-close]", "8:16 [too-close]"]


def test_starts_may_be_just_two_radii_apart() -> None:
    mission = MISSION.replace("avoider: shy", "avoider: {use: shy, radius: 0.5}")
    assert problems(mission, Parts({"avoider": {"radius": NUMBER}})) == []


def test_default_start_separation_is_the_diameter_of_a_drone() -> None:
    close, closer = (MISSION.replace("[1, 0, 0]", f"[{x}, 0, 0]") for x in ("0.12", "0.11"))
    assert problems(close) == []
    assert problems(closer) == ["8:16 [too-close]"]


# Plugins' own checks


@pytest.mark.parametrize("kind", ["transport", "localizer", "planner", "avoider"])
def test_what_the_check_of_a_part_finds_stands_at_its_option(kind: str) -> None:
    name = NAMES[kind]
    mission = MISSION.replace(f"{kind}: {name}", f"{kind}: {{use: {name}, odd: 3}}")
    plugin = Parts({kind: {"odd": NUMBER}}, {kind: [Problem(("odd",), "3 is odd")]})
    line = list(NAMES).index(kind) + 10
    column = len(f"{kind}: {{use: {name}, odd: ") + 1
    assert problems(mission, plugin) == [f"{line}:{column} [invalid-option]"]


def test_the_check_of_a_part_is_given_the_scene_and_the_options() -> None:
    plugin = Parts({"planner": {"odd": NUMBER}})
    problems(MISSION.replace("planner: crow", "planner: {use: crow, odd: 3}"), plugin)
    scene, options = plugin.asked["planner"]
    assert scene.names == ("cf1", "cf2", "cf3")
    assert options == {"odd": 3}


def test_verb_checks_receive_rows_and_only_their_own_options() -> None:
    plugin = Parts({"task": {"odd": NUMBER}})
    step = "  - wait: {agents: [cf3, cf1], odd: 3, timeout: 9, on_failure: land}\n"
    problems(with_steps(step), plugin)
    _, rows, options = plugin.asked["task"]
    assert rows == (0, 2)
    assert options == {"odd": 3}


def test_a_verb_for_an_unknown_agent_is_not_checked_further() -> None:
    plugin = Parts(faults={"task": [Problem((), "follows from it")]})
    assert len(problems(with_steps("  - wait: {agents: pear}\n"), plugin)) == 1


def test_what_the_check_of_a_verb_finds_stands_in_its_step() -> None:
    plugin = Parts({"task": {"odd": NUMBER}}, {"task": [Problem(("odd",), "3 is odd")]})
    step = "  - repeat:\n      times: 2\n      steps:\n        - wait: {odd: 3}\n"
    assert problems(with_steps(step), plugin) == ["18:23 [invalid-option]"]


@pytest.mark.parametrize(
    ("kind", "answer", "expected"),
    [
        ("avoider", ZeroDivisionError("oops"), "avoider 'shy' (their-dist 1.2:parts) raised Zero"),
        ("task", ZeroDivisionError("oops"), "task 'wait' (their-dist 1.2:parts) raised Zero"),
        ("task", BaseException("oops"), "task 'wait' (their-dist 1.2:parts) raised BaseException"),
        ("avoider", [(("odd",), "3 is odd")], "avoider 'shy' (their-dist 1.2:parts) yields (("),
    ],
)
def test_checks_that_break_their_contract_name_their_plugin(
    kind: str, answer: Any, expected: str
) -> None:
    Path("m.yaml").write_text(MISSION)
    with pytest.raises(InputError) as caught:
        load(Path("m.yaml"), registry(Parts(faults={kind: answer})))
    (problem,) = caught.value.problems
    assert problem.partition(": ")[2].startswith(f"the check of {expected}")


def test_names_offered_by_two_plugins_are_refused_where_used() -> None:
    both = registry()
    both.add(Parts(), Source("my-dist:parts"))
    assert located(MISSION, both)[0] == "10:12 [duplicate-plugin]"


def test_checks_receive_defaults_of_absent_options() -> None:
    inner = {"type": "object", "properties": {"rate": {"type": "number", "default": 5}}}
    plugin = Parts({"avoider": {"gap": {"type": "number", "default": 2}, "link": inner}})
    text = MISSION.replace("avoider: shy", "avoider: {use: shy, link: {}}")
    assert problems(text, plugin) == []
    assert plugin.asked["avoider"][-1] == {"gap": 2, "link": {"rate": 5}}
