"""The checks that authors of plugins run: installed plugins pass them, violations are refused."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from star_core import (
    AgentPhase,
    Camera,
    Command,
    ContractError,
    Fence,
    Goals,
    Obstacle,
    Order,
    Registry,
    Scene,
    Setpoint,
    Status,
    Supervisor,
    Tag,
    TaskOutput,
    Transform,
)
from star_core import testing as kit
from star_core.toolkit import fill_defaults
from tests.core.conftest import Dash, Seer
from tests.core.robots import Robots

WALL = Obstacle("wall", (((7.0, -6.0), (7.2, -6.0), (7.2, 6.0), (7.0, 6.0)),), (0.0, 3.0))
OPTIONS: dict[str, dict[str, Any]] = {
    "light": {"color": "red"},
    "sim": {"profile": "ideal", "controller": "ideal"},
    "apriltag": {"processes": 0},
    "goto": {"by": [0.0, 0.0, 0.1]},
    "formation": {"shape": "line", "centre": [0.0, 0.0, 0.8]},
    "follow": {"path": "box", "size": 1.0, "centre": [0.0, 0.0, 0.8]},
}


def hall(n: int) -> Scene:
    """A room with a wall, a landmark, and a camera on every agent."""
    room = kit.scene(n)
    landmark = Tag(1, 0.168, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), "landmark")
    world = replace(room.world, obstacles=(WALL,), landmarks=(landmark,))
    return replace(
        room,
        agents=tuple(replace(agent, camera=Camera()) for agent in room.agents),
        world=replace(world, fence=Fence((-30.0, -30.0, 0.0), (30.0, 30.0, 3.0))),
    )


def installed(*kinds: str) -> list[Any]:
    registry = Registry()
    offers = ((kind, registry.find(kind, name)) for kind in kinds for name in registry.names(kind))
    return [
        pytest.param(kind, plugin.offer, id=f"{kind}-{plugin.offer.name}")
        for kind, plugin in offers
        if plugin.source.own
    ]


@pytest.mark.parametrize(
    ("kind", "spec"), installed("transport", "localizer", "planner", "avoider", "task")
)
def test_installed_plugins_keep_their_contracts(kind: str, spec: Any) -> None:
    if getattr(spec, "realtime", False) or getattr(spec, "exclusive", None):
        pytest.skip("needs drones, or another process")
    options = fill_defaults(OPTIONS.get(spec.name, {}), spec.options)
    check = getattr(kit, f"check_{kind}")
    if kind == "task":
        phase = AgentPhase.GROUNDED if spec.before == "ground" else AgentPhase.FLYING
        check(lambda scene, rows: spec.make(scene, rows, **options), hall, phase)
    else:
        check(lambda scene: spec.make(scene, **options), kit.scene if kind == "transport" else hall)


def wrong(plugin: Any, method: str, change: Callable[..., Any], calls: range = range(10**6)) -> Any:
    """Return a plugin with a method that returns ``change(right, *inputs)`` in some calls."""
    right, count = getattr(plugin, method), itertools.count()

    def answer(*inputs: Any) -> Any:
        return change(right, *inputs) if next(count) in calls else right(*inputs)

    setattr(plugin, method, answer)
    return plugin


def velocity(change: Callable[[np.ndarray], np.ndarray]) -> Callable[..., Any]:
    return lambda right, *inputs: replace(right(*inputs), velocity=change(right(*inputs).velocity))


def unfreezes(right: Callable[..., Any], now: Any, *rest: Any) -> Any:
    now.position.flags.writeable = True
    now.position[:] = 0.0
    return right(now, *rest)


DICE = np.random.default_rng(0)
AVOIDERS = [
    (lambda *_: None, "avoider of 1 agent, all fly: returned NoneType, expected S"),
    (
        lambda _, now, planned: replace(planned, velocity=planned.velocity + now.position.sum()),
        r"2 agents, agent 0 is not located, its row is NaN: Setpoint.velocity of row 1 is \[nan",
    ),
    (
        lambda _, now, planned: replace(planned, active=np.ones(len(now.yaw), np.bool_)),
        "row 0 is not active in planned, but active in the result",
    ),
    (velocity(lambda a: a + DICE.random()), r"return different Setpoint.velocity .* draw random"),
    (unfreezes, r"avoid\(\) changed Estimate.position of its input: make another table by"),
    (velocity(lambda a: a[:, :2]), r"Setpoint.velocity has shape \(1, 2\), expected \(1, 3\)"),
]


@pytest.mark.parametrize(("change", "message"), AVOIDERS)
def test_avoiders_that_break_their_contract_are_refused(
    change: Callable[..., Any], message: str
) -> None:
    idle = SimpleNamespace(avoid=lambda _now, planned: planned)
    wrong(idle, "avoid", change)
    with pytest.raises(ContractError, match=message):
        kit.check_avoider(lambda _scene: idle)


def test_an_error_of_a_plugin_itself_has_the_case_beside_it() -> None:
    raising = SimpleNamespace(avoid=lambda _now, _planned: dict[str, float]()["gain"])
    with pytest.raises(KeyError) as caught:
        kit.check_avoider(lambda _scene: raising)
    assert caught.value.__notes__[0].startswith("avoider of 1 agent, all fly; agents that are not")


PLANNERS = [
    (lambda *_: None, "returned NoneType, expected Plan"),
    (
        lambda right, now, goals: replace(
            right(now, goals),
            setpoint=Setpoint(goals.position - now.position, goals.yaw, goals.active),
        ),
        r"goals for all agents, also .* Setpoint.velocity of row 0 is \[nan",
    ),
]


@pytest.mark.parametrize(("change", "message"), PLANNERS)
def test_planners_that_break_their_contract_are_refused(
    change: Callable[..., Any], message: str
) -> None:
    with pytest.raises(ContractError, match=message):
        kit.check_planner(lambda scene: wrong(Dash(scene), "plan", change))


def seer(scene: Scene) -> Any:
    n = len(scene.agents)
    starts = Transform(np.zeros(n), np.array([agent.start for agent in scene.agents]))
    locate = lambda right, heard: replace(  # noqa: E731
        right(heard), valid=np.isfinite(heard.position[:, 0])
    )
    return wrong(Seer(starts), "locate", locate)


LOCALIZERS = [
    (lambda right, heard: replace(right(heard), time=0.0), r"Estimate.time is 0.0, expected"),
    (
        lambda right, heard: replace(right(heard), valid=heard.age < 1.0),
        r"before any agent was heard: Estimate.position of row 0 is \[nan",
    ),
]


@pytest.mark.parametrize(("change", "message"), LOCALIZERS)
def test_localizers_that_break_their_contract_are_refused(
    change: Callable[..., Any], message: str
) -> None:
    kit.check_localizer(seer)
    with pytest.raises(ContractError, match=message):
        kit.check_localizer(lambda scene: wrong(seer(scene), "locate", change))


class Still:
    """A task whose agents stay where they are."""

    def __init__(self, scene: Scene, rows: tuple[int, ...]) -> None:
        self.own = np.isin(np.arange(len(scene.agents)), rows)

    def begin(self, estimate: Any, _health: Any) -> float:
        self.goals = Goals(
            estimate.position, 0 * estimate.position, estimate.yaw, 1 + estimate.yaw, self.own
        )
        return 5.0

    def step(self, _estimate: Any, _health: Any) -> TaskOutput:
        return TaskOutput(self.goals)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        own = np.isin(np.arange(len(self.own)), rows)
        self.goals = replace(self.goals, active=own)


ONE = np.ones(1)
DONE: Any = "done"
TASKS: list[tuple[str, Callable[..., Any], str]] = [
    ("begin", lambda *_: 0.0, r"tick 0: begin\(\) returned 0.0, expected the timeout"),
    ("step", lambda *_: None, "returned NoneType, expected TaskOutput"),
    ("step", lambda *_: TaskOutput(status=DONE), "TaskOutput.status is 'done', expected a Status"),
    (
        "step",
        lambda *_: TaskOutput(status=Status.FAILURE),
        "task of 1 agent, tick 0: failed without TaskOutput.reason",
    ),
    (
        "step",
        lambda _, now, __: TaskOutput(
            Goals(now.position, now.velocity, now.yaw, now.yaw, now.valid)
        ),
        "task of 2 agents, tick 0: has goals for agents that are not its own",
    ),
    (
        "step",
        lambda *_: TaskOutput(
            commands=(Command(Order.LAND, np.zeros(1, np.int64), np.zeros((1, 3)), ONE, ONE),)
        ),
        r"task of 50 agents, tick 20: commands agents \[0\], its own are \(2, 4",
    ),
    ("on_agents_removed", lambda *_: None, "task of 50 agents, tick 20: has goals for"),
    (
        "step",
        lambda right, now, health: TaskOutput(
            replace(right(now, health).goals, position=now.position)
        ),
        r"tick 5: Goals.position is \[\[nan",
    ),
]


@pytest.mark.parametrize(("method", "change", "message"), TASKS)
def test_tasks_that_break_their_contract_are_refused(
    method: str, change: Callable[..., Any], message: str
) -> None:
    with pytest.raises(ContractError, match=message):
        kit.check_task(lambda scene, rows: wrong(Still(scene, rows), method, change))


def robots(scene: Scene) -> Robots:
    n = len(scene.agents)
    return Robots(Transform(np.zeros(n), np.zeros((n, 3))))


def without(*flags: Supervisor) -> Callable[..., Any]:
    drop = ~int(sum(flags))
    return lambda right: replace(right(), state=right().state & drop)


TRANSPORTS = [
    ("wait", lambda right, until: right(until) - 0.01, r"before the take-off: wait\(0.05\) ret"),
    ("receive", without(Supervisor.FLYING), "after a take-off: row 0 must report Supervisor.FLYI"),
    (
        "receive",
        without(Supervisor.COMMANDER_FINISHED),
        "row 0 must report Supervisor.COMMANDER_FINISHED after a command",
    ),
    ("receive", lambda right: replace(right(), time=99.0), "Telemetry.time is 99.0, later than"),
    ("command", lambda *_: None, r"after a take-off: row 0 is \[0.6\] m from where"),
    ("send", lambda *_: None, "with setpoints along x: returned NoneType"),
    (
        "send",
        lambda right, planned: right(replace(planned, active=~planned.active)),
        r"with setpoints along x: row 0 is \[0.4\] m from",
    ),
    ("truth", lambda *_: DICE, "returned Generator, expected Truth"),
    (
        "receive",
        lambda right: replace(right(), battery=right().battery + DICE.random()),
        "different Telemetry.battery",
    ),
]


@pytest.mark.parametrize(("method", "change", "message"), TRANSPORTS)
def test_transports_that_break_their_contract_are_refused(
    method: str, change: Callable[..., Any], message: str
) -> None:
    with pytest.raises(ContractError, match=message):
        kit.check_transport(lambda scene: wrong(robots(scene), method, change))


def test_call_times_are_returned_and_kept_for_pytest() -> None:
    idle = SimpleNamespace(avoid=lambda _now, planned: planned)
    times = kit.check_avoider(lambda _scene: idle)
    assert list(times) == [1, 2, 50]
    assert kit.reports[-1].startswith("SimpleNamespace: ")
