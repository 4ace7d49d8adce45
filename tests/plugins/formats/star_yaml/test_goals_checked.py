"""Goals that a step is known to have are checked before the flight, also by the planner."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, cast

import pytest

from star_core import PlannerSpec, Problem, Scene, TaskSpec, hookimpl
from star_core.discovery import Source
from star_core.errors import InputError
from star_core.plugin_support.registry import Registry
from star_core.toolkit import StepGoal
from star_yaml.mission_loader import load

WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
obstacles:
  pillar: {box: {centre: [1.2, 1.2], size: [0.4, 0.4]}, height: [0, 2]}
"""
MISSION = """\
star: 1
name: checked
world: room.yaml
swarm:
  cf1: {start: [-1, 0, 0]}
  cf2: {start: [0, 0, 0]}
transport: sim
localizer: flow
planner: {use: shelf, top: 1.0}
avoider: none
mission:
"""
Goals = Sequence[tuple[float, float, float]]


def below_the_top(_scene: Scene, goals: Goals, *, top: float = 0.5) -> Iterable[Problem]:
    for i, (_, _, z) in enumerate(goals):
        if z > top:
            yield Problem((i,), f"is higher than shelf's top, {top:g} m")


class Shelf:
    """A third party's planner `shelf`, and its verb `tour` through given points.

    Args:
        check_goals: What the planner checks goals with.
        goals: What the verb says of its goals; the points if None.
    """

    def __init__(
        self,
        check_goals: Callable[..., Iterable[Any]] | None = below_the_top,
        goals: Callable[..., Iterable[Any]] | None = None,
    ) -> None:
        self._check_goals = check_goals
        self._goals = goals or self._points

    @hookimpl
    def star_planners(self) -> Iterable[PlannerSpec]:
        yield PlannerSpec(
            name="shelf",
            summary="Keeps below a height.",
            make=cast("Any", object),
            options={"type": "object", "properties": {"top": {"type": "number"}}},
            check_goals=self._check_goals,
        )

    @hookimpl
    def star_tasks(self) -> Iterable[TaskSpec]:
        points = {"type": "array", "items": {"type": "array", "items": {"type": "number"}}}
        yield TaskSpec(
            name="tour",
            summary="Fly through points.",
            make=cast("Any", object),
            options={"type": "object", "properties": {"points": points}},
            goals=self._goals,
        )

    @staticmethod
    def _points(_scene: Scene, _rows: tuple[int, ...], points: Goals) -> Iterable[StepGoal]:
        for i, (x, y, z) in enumerate(points):
            yield StepGoal(("points", i), (x, y, z))


def problems(folder: Path, plugin: Shelf, *steps: str) -> list[str]:
    """What the check of a mission finds, without the file's name."""
    (folder / "room.yaml").write_text(WORLD)
    path = folder / "checked.yaml"
    path.write_text(MISSION + "".join(f"  - {step}\n" for step in ("takeoff: {}", *steps)))
    registry = Registry()
    registry.add(plugin, Source("their-dist:shelf", "1.2"))
    try:
        load(path, registry)
    except InputError as error:
        return [problem.removeprefix(f"{path}:") for problem in error.problems]
    return []


def test_goals_refused_by_third_party_planners_are_located(tmp_path: Path) -> None:
    assert problems(tmp_path, Shelf(), "goto: {agents: cf1, to: [0, 1, 1.2]}") == [
        "13:29: goal [0, 1, 1.2] is higher than shelf's top, 1 m [unreachable-goal]"
    ]


def test_a_goal_that_the_planner_accepts_is_no_problem(tmp_path: Path) -> None:
    assert problems(tmp_path, Shelf(), "goto: {agents: cf1, to: [0, 1, 0.9]}") == []


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ("hold: {at: [0, 1, 1.2]}", "13:16: position 1 of 2: goal [-0.3, 1, 1.2]"),
        (
            "formation: {shape: line, centre: [0, 1, 1.2]}",
            "13:38: position 1 of 2: goal [-0.3, 1, 1.2]",
        ),
        (
            "formation: {shape: points, points: [[0, 1, 0.8], [0, 0, 1.2]]}",
            "13:54: position 2 of 2: goal [0, 0, 1.2]",
        ),
        (
            "formation: {shape: line, centre: [0, 1, 0.8], move: {to: [0, 1, 1.2]}}",
            "13:62: position 1 of 2 moves there: goal [-0.3, 1, 1.0",
        ),
        ("follow: {path: circle, size: 1.4, centre: [0, 0, 1.2]}", "13:20: circle: goal [0.7, 0,"),
        ("follow: {file: way.csv}", "13:20: way.csv:2, shifted by [-0.3, 0, 0] for one of 2 agent"),
        ("each: {steps: [goto: {to: [0, 1, 1.2]}]}", "13:31: goal [0, 1, 1.2]"),
    ],
)
def test_every_verb_of_stars_own_declares_where_it_sends_agents(
    tmp_path: Path, step: str, message: str
) -> None:
    (tmp_path / "way.csv").write_text("x,y,z\n0,0,0.8\n0,1,1.2\n")
    (problem,) = problems(tmp_path, Shelf(), step)
    assert problem.startswith(message)
    assert "is higher than shelf's top, 1 m" in problem


@pytest.mark.parametrize(
    ("options", "refused"),
    [("relative: false", "way.csv:2: "), ("relative: false, on_board: true", ""), ("", "")],
)
def test_absolute_trajectories_are_checked_by_the_planner(
    tmp_path: Path, options: str, refused: str
) -> None:
    numbers = ["4"] + ["0"] * 32
    numbers[17] = "0.9"  # z
    numbers[18] = "0.1"  # z per second
    header = ",".join(["duration", *(f"{k}^{i}" for k in ("x", "y", "z", "yaw") for i in range(8))])
    (tmp_path / "way.csv").write_text(f"{header}\n{','.join(numbers)}\n")
    step = f"follow: {{agents: cf1, file: way.csv, format: poly7{', ' * bool(options)}{options}}}"
    messages = problems(tmp_path, Shelf(), step)
    assert len(messages) == bool(refused)
    assert all(refused in problem and "higher than shelf's top" in problem for problem in messages)


def test_goals_of_one_value_are_one_problem_listing_the_others(tmp_path: Path) -> None:
    (problem,) = problems(tmp_path, Shelf(), "goto: {to: [0, 1, 1.2]}")
    assert problem.endswith(
        "position 1 of 2: goal [-0.3, 1, 1.2] is higher than shelf's top, 1 m"
        " (also position 2 of 2) [unreachable-goal]"
    )


def test_a_third_partys_verb_names_its_goals(tmp_path: Path) -> None:
    messages = problems(
        tmp_path, Shelf(), "tour: {points: [[0, 1, 0.8], [0, 1, 1.2], [1.2, 1.2, 1]]}"
    )
    assert messages == [
        "13:34: goal [0, 1, 1.2] is higher than shelf's top, 1 m [unreachable-goal]",
        "13:47: [1.2, 1.2, 1] is inside obstacle 'pillar' [inside-obstacle]",
    ]


@pytest.mark.parametrize("check_goals", [None, below_the_top])
def test_goals_in_contact_with_obstacles_fail_for_any_planner(
    tmp_path: Path, check_goals: Any
) -> None:
    messages = problems(tmp_path, Shelf(check_goals), "tour: {points: [[0.95, 1.2, 0.8]]}")
    assert messages == [
        "13:21: [0.95, 1.2, 0.8] is 0.05 m from obstacle 'pillar', "
        "expected at least the radius of a drone: 0.06 m [inside-obstacle]"
    ]


def raises(*_: Any, **__: Any) -> Iterable[Any]:
    raise ZeroDivisionError("oops")


@pytest.mark.parametrize(
    ("plugin", "message"),
    [
        (Shelf(raises), "the check_goals of planner 'shelf' (their-dist 1.2:shelf) raised Zero"),
        (Shelf(goals=raises), "the goals of task 'tour' (their-dist 1.2:shelf) raised Zero"),
        (
            Shelf(lambda *_, **__: [Problem((7,), "is far")]),
            "the check_goals of planner 'shelf' (their-dist 1.2:shelf) yields "
            "Problem(path=(7,), message='is far', code='invalid-option', "
            "warning=False), "
            "expected Problem with the index of a goal",
        ),
        (
            Shelf(goals=lambda *_, **__: [StepGoal((), (1.0, 2.0))]),  # type: ignore[arg-type]
            "the goals of task 'tour' (their-dist 1.2:shelf) yields "
            "StepGoal(path=(), position=(1.0, 2.0), label=''), expected StepGoal at [x, y, z]",
        ),
    ],
    ids=["check_goals raises", "goals raises", "no index", "no position"],
)
def test_what_a_plugin_does_wrong_is_reported_as_its_own(
    tmp_path: Path, plugin: Shelf, message: str
) -> None:
    (problem,) = problems(tmp_path, plugin, "tour: {points: [[0, 1, 0.8]]}")
    assert problem.startswith(f"13:11: {message}")
