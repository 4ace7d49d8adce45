"""The verb ``external``, step by step, with a planner in this process."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from star_core import Estimate, Goals, PluginError, Scene, Status, Task, TaskOutput, deferred
from star_core.testing import estimate, health, scene
from star_core.toolkit import fill_defaults
from star_external.planner import Done, Failed, Goal
from tests.plugins.tasks.star_external.conftest import offered

AIR = np.array([[-1.0, 0.0, 0.8], [0.0, 0.0, 0.8], [1.0, 0.0, 0.8]])
LABEL = "external planner 'theirs' (theirs-dist 1.0:theirs): "
THERE = Goal((0.5, 0.5, 1.0))


class Scripted:
    """A planner that answers one thing after the other, and the last one from then on."""

    def __init__(self, *answers: Any) -> None:
        self._answers = list(answers)
        self.asked: list[tuple[float, tuple[int, ...]]] = []

    def __call__(self, *_scene_and_rows: object) -> Scripted:
        return self

    def plan(self, estimate: Estimate, _health: object, rows: tuple[int, ...]) -> Any:
        self.asked.append((estimate.time, rows))
        answer = self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]
        if isinstance(answer, BaseException):
            raise answer
        return answer


@pytest.fixture
def made() -> Callable[..., Any]:
    """Make the task of the first two of three agents with a planner, and begin it."""

    def task(planner: Callable[..., object], **options: Any) -> Any:
        offer = offered(theirs=planner)
        made: Any = offer.make(
            scene(3), (0, 1), **fill_defaults({"planner": "theirs", **options}, offer.options)
        )
        assert made.begin(estimate(AIR), health(3)) == 60.0
        return made

    return task


def step(task: Task, time: float = 0.0) -> TaskOutput:
    return task.step(estimate(AIR, time=time), health(3))


def goals(of: TaskOutput) -> Goals:
    assert of.goals is not None
    return of.goals


def test_what_a_planner_is_made_with_are_the_scene_and_the_rows(made: Any) -> None:
    got: list[object] = []

    def make(*arguments: object) -> Scripted:
        got.extend(arguments)
        return Scripted({})

    assert isinstance(made(make), Task)
    assert got == [scene(3), (0, 1)]


def test_goals_may_be_made_of_arrays(made: Any) -> None:
    position = np.array([0.5, 0.5, 1.0], np.float32)
    targets = goals(step(made(Scripted({"cf1": Goal(position, yaw=np.float32(1))}))))  # type: ignore[arg-type]
    assert targets.position[0].tolist() == [0.5, 0.5, 1.0]
    assert targets.yaw[0] == 1.0


@pytest.mark.parametrize(
    ("options", "times"), [({}, [0.05 * tick for tick in range(9)]), ({"rate": 5}, [0.0, 0.2, 0.4])]
)
def test_the_planner_is_asked_at_the_rate(
    made: Any, options: dict[str, float], times: list[float]
) -> None:
    planner = Scripted({})
    task = made(planner, **options)
    for tick in range(9):
        step(task, tick * 0.05)
    assert planner.asked == [(time, (0, 1)) for time in times]


def test_a_step_ends_when_the_planner_is_done_and_opens_no_port(
    made: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("socket.create_server", None)  # any call of it raises
    task = made(Scripted(Done()))
    assert step(task) == TaskOutput(status=Status.SUCCESS)
    task.close()


def test_a_step_fails_when_the_planner_gives_up_and_it_is_named(made: Any) -> None:
    ended = step(made(Scripted(Failed("no\nway"))))
    assert ended.status is Status.FAILURE
    assert ended.reason == "external planner 'theirs' (theirs-dist 1.0:theirs) gave up: no way"


def test_the_planner_is_asked_for_the_agents_of_the_step(made: Any) -> None:
    planner = Scripted({"cf1": THERE, "cf2": THERE}, {}, {}, {"cf2": THERE})
    task = made(planner)
    step(task)
    task.on_agents_removed((1,))
    assert goals(step(task)).active.tolist() == [False, True, False]
    task.on_agent_replaced(1, 2)
    targets = goals(step(task))
    assert targets.active.tolist() == [False, False, True]
    assert targets.position[2].tolist() == [0.5, 0.5, 1.0]
    task.on_agents_added((2, 1))
    assert goals(step(task)).active.tolist() == [False, True, True]
    assert [rows for _, rows in planner.asked] == [(0, 1), (1,), (2,), (2, 1)]


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (None, "plan() returned None, expected goals by agent, Done() or Failed(why)"),
        (Failed(7), "plan() returned Failed(why=7), expected goals"),  # type: ignore[arg-type]
        (Done, "plan() returned <class 'star_...planner.Done'>, expected goals"),
        ({"cf1": (1, 0, 1)}, "cf1: the goal is (1, 0, 1), expected a Goal"),
        ({"cf3": THERE}, "no agent named 'cf3' in this step; there are: cf1, cf2"),
        ({0: THERE}, "no agent named 0 in this step; there are: cf1, cf2"),
        ({"cf1": Goal((0, math.nan, 1))}, "cf1: position has nan, expected a finite number"),
        ({"cf1": Goal((99, 0, 1))}, "cf1: [99, 0, 1] is outside the fence"),
        ({"cf1": Goal((0, 0, 2))}, "cf1: [0, 0, 2] is outside the heights to fly at"),
        ({"cf1": Goal((0, 0, 1), speed=2)}, "cf1: speed of 2 m/s is above limits.speed, 0.5 m/s"),
        (KeyError("gain"), "KeyError: 'gain' ("),
        (PluginError("no map of the room"), "no map of the room"),
        (SystemExit("bye"), "SystemExit: bye ("),
    ],
)
def test_failures_of_a_planner_name_it(made: Any, answer: Any, why: str) -> None:
    task = made(Scripted(answer))
    with pytest.raises(PluginError) as raised:
        step(task)
    assert str(raised.value).startswith(LABEL + why)


def test_a_plugin_may_end_the_program(made: Any) -> None:
    task = made(Scripted(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        step(task)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(position=st.tuples(st.floats(), st.floats(), st.floats()), yaw=st.none() | st.floats())
def test_planner_goals_outside_the_fence_are_refused(
    made: Any, position: tuple[float, float, float], yaw: float | None
) -> None:
    room: Scene = scene(3)
    task = made(Scripted({"cf1": Goal(position, yaw=yaw)}))
    try:
        targets = goals(step(task))
    except PluginError as error:
        assert str(error).startswith(f"{LABEL}cf1: ")  # noqa: PT017 -- whichever it is
        return
    assert room.world.fault(position) is None
    assert np.isfinite(targets.yaw).all()


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (deferred("star_nowhere:Spiral"), "ModuleNotFoundError: No module named 'star_nowhere'"),
        (deferred("builtins:Spiral"), "AttributeError: module 'builtins' has no attribute"),
        (slice, "made slice, expected plan(estimate, health, rows)"),
        (len, "TypeError: len() takes exactly one argument (2 given)"),
    ],
)
def test_a_planner_that_cannot_be_created_is_named(make: Callable[..., object], why: str) -> None:
    offer = offered(theirs=make)
    with pytest.raises(PluginError) as raised:
        offer.make(scene(3), (0, 1), **fill_defaults({"planner": "theirs"}, offer.options))
    assert str(raised.value).startswith(LABEL + why)


def test_a_planner_is_closed_and_named_if_it_raises_then(made: Any) -> None:
    class Closes(Scripted):
        closed = 0

        def close(self) -> None:
            self.closed += 1
            if self.closed > 1:
                raise OSError("stuck")

    planner = Closes({})
    made(planner).close()
    assert planner.closed == 1
    with pytest.raises(PluginError) as raised:
        made(planner).close()
    assert str(raised.value).startswith(f"{LABEL}OSError: stuck (")
