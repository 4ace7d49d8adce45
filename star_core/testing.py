"""Checks for the tests of plugin authors: whether a plugin keeps its contract.

Each check makes a plugin for swarms of 1, 2 and 50 agents, calls it with inputs that occur in
flight (agents that are not located, that stand on the ground, that are all at one point), and
raises `ContractError` at the first violation. A second plugin, made alike, must return the same.
In a plugin's tests::

    from star_core.testing import check_avoider

    def test_it_keeps_the_contract():
        check_avoider(lambda scene: MyAvoider(scene, radius=0.4))

``make`` makes the plugin for a scene, ``scene`` the scene of a number of agents. The message of an
error begins with the case. Every check returns the mean time of a call, s, by the number of agents;
pytest prints it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from time import perf_counter
from typing import Any, Final, TypeAlias

import numpy as np

from star_core.contracts import (
    Avoider,
    Localizer,
    Planner,
    Status,
    Task,
    TaskOutput,
    Transport,
)
from star_core.errors import ContractError
from star_core.execution.assignments import GoalBuffer
from star_core.execution.step_run import checked_timeout
from star_core.messages.arrays import Array, Mask
from star_core.messages.commands import Command, Order
from star_core.messages.rotations import Transform
from star_core.messages.state import AgentPhase, Estimate, Goals, Health, Setpoint
from star_core.messages.telemetry import Supervisor, Telemetry
from star_core.messages.vision import Corrections, Frames
from star_core.pipeline import (
    TIME_TOLERANCE,
    checked_location,
    checked_plan,
    checked_setpoint,
    checked_telemetry,
    checked_time,
    checked_truth,
)
from star_core.plugin_guard import require_methods
from star_core.scene import Agent, Limits, Scene
from star_core.world.world import Fence, World

Times: TypeAlias = Mapping[int, float]
Case: TypeAlias = tuple[str, tuple[Any, ...]]

SIZES: Final = (1, 2, 50)
ROW: Final = 10  # agents of a scene in a line
TASK_TIME: Final = 4.0  # s, for which a task is called if it is not over before

MAX_ERROR: Final = 0.2  # m, of agents that a transport flies
UNLOCATED: Final = range(5, 8)  # ticks of a task in which its first agent is not located
CHANGES: Final[Mapping[int, tuple[str, Callable[[tuple[int, ...]], tuple[int, ...]]]]] = {
    20: ("on_agents_removed", lambda rows: rows[1:]),
    30: ("on_agent_replaced", lambda rows: (*rows[:-1], 1)),
    40: ("on_agents_added", lambda rows: (*rows, 0)),
}
"""Changes of a task's agents, by the tick: its method, and its rows after it."""

# of a transport: label, command, duration (a command takes half of it), velocity of the setpoints
# along x, m/s, position at the end in the odometry frame: x and z, m
FLIGHT: Final = (
    ("before the take-off", None, 0.5, None, (0.0, 0.0)),
    ("after a take-off", Order.TAKEOFF, 4.0, None, (0.0, 0.6)),
    ("with setpoints along x", None, 2.0, 0.2, (0.4, 0.6)),
    ("with setpoints of zero velocity", None, 0.5, 0.0, (0.45, 0.6)),
    ("after a landing", Order.LAND, 6.0, None, (0.45, 0.0)),
)

reports: list[str] = []
"""A line on each check of this process, with its times."""


def scene(n: int, *, rate: float = 20.0, limits: Limits | None = None, seed: int = 0) -> Scene:
    """Return a scene of `n` agents 1 m apart, up to 10 on a line, in an empty room 20 m wide."""
    columns, lines = min(n, ROW), -(-n // ROW)
    starts = ((i % ROW - (columns - 1) / 2, i // ROW - (lines - 1) / 2, 0.0) for i in range(n))
    return Scene(
        agents=tuple(Agent(f"cf{i + 1}", start) for i, start in enumerate(starts)),
        period=1 / rate,
        world=World("room", Fence((-10.0, -10.0, 0.0), (10.0, 10.0, 3.0))),
        limits=limits or Limits(),
        seed=seed,
    )


def estimate(position: Array, *, velocity: Array | None = None, time: float = 0.0) -> Estimate:
    """Return an estimate with all rows valid, a deviation of 1 cm, and frames equal to the map.

    Args:
        position: (N, 3) m.
        velocity: (N, 3) m/s; at rest if not given.
        time: Mission time, s.
    """
    n = len(position)
    return Estimate(
        time=time,
        position=position,
        velocity=np.zeros((n, 3)) if velocity is None else velocity,
        yaw=np.zeros(n),
        covariance=np.tile(np.eye(3) * 1e-4, (n, 1, 1)),
        valid=np.ones(n, np.bool_),
        map_from_odom=Transform(np.zeros(n), np.zeros((n, 3))),
    )


def health(n: int, phase: AgentPhase = AgentPhase.FLYING) -> Health:
    """Return the health of `n` agents in one phase, charged and just heard."""
    return Health(phase=np.full(n, int(phase)), battery=np.full(n, 4.0), age=np.zeros(n))


def check_avoider(make: Callable[[Scene], Avoider], scene: Callable[[int], Scene] = scene) -> Times:
    """Check that an avoider returns finite setpoints and keeps inactive rows inactive.

    Raises:
        ContractError: It does not.
    """

    def cases(room: Scene) -> Iterator[Case]:
        for label, now, active in _situations(room):
            draw = np.random.default_rng(len(active)).uniform(-0.4, 0.4, (len(active), 3))
            yield label, (now, Setpoint(draw, np.nan_to_num(now.yaw), active))

    def check(answer: Any, _now: Estimate, wanted: Setpoint) -> None:
        safe = checked_setpoint(answer, len(wanted.yaw))
        _require_inactive(safe.active, wanted.active, "wanted")

    return _check(make, Avoider, "avoid", scene, cases, check)


def check_planner(make: Callable[[Scene], Planner], scene: Callable[[int], Scene] = scene) -> Times:
    """Check that a planner returns finite plans and keeps rows without goals inactive.

    Raises:
        ContractError: It does not.
    """

    def cases(room: Scene) -> Iterator[Case]:
        for label, now, active in _situations(room):
            n, here = len(active), np.nan_to_num(now.position)
            for what, away in (("a goal near by", 0.5), ("a goal outside the fence", 1e3)):
                goals = here + np.array([away, 0.0, 0.0])
                rest = np.zeros((n, 3)), np.zeros(n), np.full(n, 0.5), active
                yield f"{label}, {what}", (now, Goals(goals, *rest))
            yield f"{label}, at the goal", (now, Goals(here, *rest))
            lost = f"{label}, goals for all agents, also for those that are not located"
            yield lost, (now, Goals(here, *rest[:3], np.ones(n, np.bool_)))

    def check(answer: Any, _now: Estimate, goals: Goals) -> None:
        plan = checked_plan(answer, len(goals.yaw))
        _require_inactive(plan.setpoint.active, goals.active, "goals")

    return _check(make, Planner, "plan", scene, cases, check)


def check_localizer(
    make: Callable[[Scene], Localizer], scene: Callable[[int], Scene] = scene
) -> Times:
    """Check that a localizer returns estimates of the right time, finite where valid.

    Raises:
        ContractError: It does not.
    """

    def cases(room: Scene) -> Iterator[Case]:
        n = len(room.agents)
        last, every, none = np.arange(n) == n - 1, np.ones(n, np.bool_), np.zeros(n, np.bool_)
        situations = (
            ("before any agent was heard", every, every),
            ("at the first reports", none, none),
            ("in flight", none, none),
            ("an agent is not heard", last, none),
            ("an agent reports no position", none, last),
            ("no agent is heard any more", every, none),
            ("all agents are heard again", none, none),
        )
        for tick, (label, silent, unknown) in enumerate(situations):
            yield label, (_telemetry(room, tick * room.period, silent, unknown),)

    return _check(make, Localizer, "locate", scene, cases, checked_location)


def check_task(
    make: Callable[[Scene, tuple[int, ...]], Task],
    scene: Callable[[int], Scene] = scene,
    phase: AgentPhase = AgentPhase.FLYING,
) -> Times:
    """Check that a task has goals and commands for its own agents only, all of them finite.

    Every second agent is its own. They fly exactly to its goals, and do what it commands. The first
    is not located for a while; later one leaves, one is replaced, and one is added, if the task has
    the methods for that.

    Args:
        make: Makes the task for some rows of a scene.
        scene: As of all checks.
        phase: Of the agents when it begins: GROUNDED for a verb that takes off.

    Raises:
        ContractError: It does not.
    """
    means = {}
    for n in SIZES:
        room, rows = scene(n), tuple(range(0, n, 2))
        tasks = [make(room, rows) for _ in range(2)]
        require_methods(tasks[0], Task)
        swarm = _PointMasses(room, phase)
        goals = GoalBuffer(n, room.limits.speed, getattr(tasks[0], "trajectories", ()))
        took, status = [0.0], Status.RUNNING
        for tick in range(int(TASK_TIME / room.period)):
            if status is not Status.RUNNING:
                break
            lost = (np.arange(n) == 0) & (tick in UNLOCATED)
            inputs = swarm.estimate(lost), swarm.health()
            with _case(f"task of {_agents(n)}, tick {tick}"):
                if not tick:
                    _require_same(*(checked_timeout(task.begin(*inputs)) for task in tasks))
                rows = _changed(tasks, rows, tick) if n > 1 else rows
                output, elapsed = _called(tasks, "step", inputs)
                took.append(elapsed)
                status = goals.add(output, np.isin(np.arange(n), rows)).status
                if status is Status.FAILURE and not output.reason:
                    raise ContractError("failed without TaskOutput.reason, which users are shown")
                swarm.move(output)
        _close(tasks)
        means[n] = float(np.mean(took[2:] or took))
    return _reported(tasks[0], means)


def _changed(tasks: Sequence[Task], rows: tuple[int, ...], tick: int) -> tuple[int, ...]:
    """Change the agents of a task if it has a method for the change of a tick; return the rows."""
    if tick not in CHANGES:
        return rows
    method, change = CHANGES[tick]
    after = change(rows)
    if not after or len(set(after)) < len(after) or not hasattr(tasks[0], method):
        return rows
    for task in tasks:
        getattr(task, method)(*((rows[-1], 1) if method == "on_agent_replaced" else (after,)))
    return after


def check_transport(
    make: Callable[[Scene], Transport],
    scene: Callable[[int], Scene] = scene,
    *,
    deterministic: bool = True,
) -> Times:
    """Check a transport by a flight: every second agent takes off, flies a setpoint and lands.

    Args:
        make: Makes the transport for a scene.
        scene: As of all checks.
        deterministic: Whether two transports made alike do the same, as a simulation should.

    Raises:
        ContractError: The agents do not do that, or a table breaks its contract.
    """
    means = {}
    for n in SIZES:
        room = scene(n)
        links = [make(room) for _ in range(1 + deterministic)]
        require_methods(links[0], Transport)
        took: list[float] = []
        for link in links:
            link.connect()
        try:
            _fly(links, room, took)
        finally:
            _close(links)
        _close(links)  # it may be called twice
        means[n] = float(np.mean(took))
    return _reported(links[0], means)


def _fly(links: Sequence[Transport], room: Scene, took: list[float]) -> None:
    """Fly every second agent of a transport as `FLIGHT` says, and check where all are then."""
    n = len(room.agents)
    flown, rows = np.arange(n) % 2 == 0, np.arange(0, n, 2)
    now = 0.0

    def call(method: str, *inputs: Any) -> Any:
        output, elapsed = _called(links, method, inputs)
        took.append(elapsed)
        return output

    def tick(velocity: float | None) -> Telemetry:
        nonlocal now
        now = checked_time(call("wait", now + room.period), now + room.period)
        telemetry = checked_telemetry(call("receive"), n)
        if telemetry.time > now + TIME_TOLERANCE:
            raise ContractError(f"Telemetry.time is {telemetry.time!r}, later than {now!r}")
        checked_truth(call("truth"), n)
        if velocity is not None:
            speeds = np.where(flown[:, None], [velocity, 0.0, 0.0], 0.0)
            checked_setpoint(call("send", Setpoint(speeds, np.zeros(n), flown)), n)
        return telemetry

    for label, order, seconds, velocity, (x, z) in FLIGHT:
        with _case(f"transport of {_agents(n)}, {label}"):
            if order is not None:
                target = np.tile([0.0, 0.0, z], (len(rows), 1))
                last = np.full(len(rows), seconds / 2)
                call("command", Command(order, rows, target, 0.0 * last, last))
            for _ in range(round(seconds / room.period)):
                telemetry = tick(velocity)
            _require_flown(telemetry, flown, (x, z), commanded=order is not None)
    with _case(f"transport of {_agents(n)}, with a correction"):
        one = np.full(1, 0.01)
        level = np.array([[0.0, 0.0, 0.0, 1.0]])
        call("correct", Corrections(rows[:1], telemetry.position[:1], level, one, one))


def _require_flown(
    telemetry: Telemetry, flown: Mask, end: tuple[float, float], *, commanded: bool
) -> None:
    """Check that the agents that were flown are at x and z, m, and the others at their starts."""
    x, z = end
    expected = np.where(flown[:, None], [x, 0.0, z], 0.0)
    error = np.abs(telemetry.position - expected).max(axis=1)
    flying, finished = (
        telemetry.state & int(flag) != 0
        for flag in (Supervisor.FLYING, Supervisor.COMMANDER_FINISHED)
    )
    for wrong, rule in (
        (
            ~(error < MAX_ERROR),
            f"is {error.round(2).tolist()} m from where it is expected: agents fly commands and "
            "active rows of setpoints, positions are in the frame of their starts",
        ),
        (
            flying != (flown & (z > 0)),
            "must report Supervisor.FLYING in the air, and not on the ground: take-offs and "
            "landings wait for that",
        ),
        (
            ~finished & flown & commanded,
            "must report Supervisor.COMMANDER_FINISHED after a command: tasks wait for it",
        ),
    ):
        if wrong.any():
            raise ContractError(f"row {int(np.argmax(wrong))} {rule}")


class _PointMasses:
    """Agents that do at once what a task wants."""

    def __init__(self, room: Scene, phase: AgentPhase) -> None:
        n = len(room.agents)
        self._period, self._time = room.period, 0.0
        self._position = np.array([agent.start for agent in room.agents])
        self._position[:, 2] = 0.0 if phase is AgentPhase.GROUNDED else 0.8
        self._phase = np.full(n, int(phase))
        self._goals = Goals.none(n)
        self._target = self._position.copy()
        self._after = self._phase.copy()
        self._due = np.full(n, np.inf)

    def estimate(self, lost: Mask) -> Estimate:
        gone = np.where(lost, np.nan, 0.0)
        now = estimate(self._position + gone[:, None], time=self._time)
        return replace(now, valid=~lost)

    def health(self) -> Health:
        return replace(health(len(self._phase)), phase=self._phase)

    def move(self, output: TaskOutput) -> None:
        self._time += self._period
        self._goals = output.goals or self._goals
        way = self._goals.position - self._position
        far = np.linalg.norm(way, axis=1, keepdims=True)
        reach = self._goals.speed[:, None] * self._period
        flies = self._goals.active & (self._phase == AgentPhase.FLYING)
        step = way * np.minimum(1.0, reach / np.maximum(far, 1e-9))
        self._position = self._position + np.where(flies[:, None], step, 0.0)
        for command in output.commands:
            self._obey(command)
        done = self._due <= self._time + 1e-9
        self._position[done], self._phase[done] = self._target[done], self._after[done]
        self._due[done] = np.inf

    def _obey(self, command: Command) -> None:
        rows = command.agent
        phases = {
            Order.TAKEOFF: (AgentPhase.TAKING_OFF, AgentPhase.FLYING),
            Order.LAND: (AgentPhase.LANDING, AgentPhase.LANDED),
        }
        self._target[rows] = self._position[rows]
        self._due[rows] = self._time + command.duration
        if command.order in phases:
            self._phase[rows], self._after[rows] = phases[command.order]
            self._target[rows, 2] = command.position[:, 2]
        else:
            self._after[rows] = self._phase[rows]
            if command.order is Order.GOTO:
                self._target[rows] = command.position


def _situations(room: Scene) -> Iterator[tuple[str, Estimate, Mask]]:
    """Yield what avoiders and planners meet in flight: a label, an estimate, the agents that fly.

    Args:
        room: Where agents fly at 1 m above their starts.
    """
    n = len(room.agents)
    draw = np.random.default_rng(n)
    position = np.array([agent.start for agent in room.agents]) + np.array([0.0, 0.0, 1.0])
    velocity = draw.uniform(-0.3, 0.3, (n, 3))
    flying = np.ones(n, np.bool_)
    first, odd = np.arange(n) == 0, np.arange(n) % 2 == 1
    now = estimate(position, velocity=velocity)
    yield "all fly", now, flying
    gone = np.where(first, np.nan, 0.0)
    lost = estimate(position + gone[:, None], velocity=velocity + gone[:, None], time=room.period)
    lost = replace(lost, yaw=gone, valid=~first)
    yield "agent 0 is not located, its row is NaN", lost, ~first
    low = position * np.where(odd, [[1.0], [1.0], [0.0]], 1.0).T
    yield "every second agent has landed", estimate(low, time=2 * room.period), ~odd
    here = np.tile(position[:1], (n, 1))
    yield "all are at one point", estimate(here, time=3 * room.period), flying
    travel = np.where(first[:, None], [0.5, 0.0, 0.0], 0.0)
    unheard = replace(now, time=4 * room.period, valid=~first, possible_travel=travel)
    yield "agent 0 is not heard", unheard, ~first
    yield "no agent flies", replace(now, time=5 * room.period), np.zeros(n, np.bool_)


def _telemetry(room: Scene, time: float, silent: Mask, unknown: Mask) -> Telemetry:
    """Return telemetry of agents that fly along x; NaN for those whose position is not known.

    Cameras send black images.
    """
    n = len(room.agents)
    cameras = {row: agent.camera for row, agent in enumerate(room.agents) if agent.camera}
    moments = np.full(len(cameras), time)
    images = tuple(np.zeros((one.height, one.width), np.uint8) for one in cameras.values())
    nan = np.where(unknown, np.nan, 0.0)
    velocity = np.tile([0.2, 0.0, 0.0], (n, 1)) + nan[:, None]
    return Telemetry(
        time=time,
        position=velocity * time,
        velocity=velocity,
        attitude=np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)) + nan[:, None],
        battery=4.0 + nan,
        state=np.full(n, int(Supervisor.FLYING)),
        age=np.where(silent, 0.3, 0.0),
        frames=Frames(np.array([*cameras], np.int64), moments, moments, images),
    )


def _check(
    make: Callable[[Scene], Any],
    contract: type,
    method: str,
    scene: Callable[[int], Scene],
    cases: Callable[[Scene], Iterator[Case]],
    check: Callable[..., object],
) -> Times:
    """Check one method of two plugins made alike with the same inputs; return the times."""
    means = {}
    for n in SIZES:
        room = scene(n)
        plugins = [make(room), make(room)]
        require_methods(plugins[0], contract)
        took = []
        for label, inputs in cases(room):
            with _case(f"{contract.__name__.lower()} of {_agents(n)}, {label}"):
                output, elapsed = _called(plugins, method, inputs)
                took.append(elapsed)
                check(output, *inputs)
        _close(plugins)
        means[n] = float(np.mean(took[1:]))
    return _reported(plugins[0], means)


def _called(plugins: Sequence[Any], method: str, inputs: tuple[Any, ...]) -> tuple[Any, float]:
    """Return the output and time, s, of the first plugin, after comparing the others' outputs.

    Raises:
        ContractError: They differ, or an input was changed.
    """
    before = [(name, np.copy(leaf)) for name, leaf in _leaves(inputs) if _is_array(leaf)]
    outputs = []
    for plugin in plugins:
        begun = perf_counter()
        outputs.append(getattr(plugin, method)(*inputs))
        elapsed = perf_counter() - begun
    after = (leaf for _, leaf in _leaves(inputs) if _is_array(leaf))
    for (name, old), new in zip(before, after, strict=True):
        if not _equal(old, new):
            raise ContractError(
                f"{method}() changed {name} of its input: make another table by "
                "dataclasses.replace, and copy arrays before you change them"
            )
    for other in outputs[1:]:
        _require_same(outputs[0], other)
    return outputs[0], elapsed


def _require_same(one: Any, other: Any) -> None:
    for (name, leaf), (_, again) in zip(_leaves(one), _leaves(other), strict=False):
        if not _equal(leaf, again):
            raise ContractError(
                f"two plugins that were made alike return different {name or 'values'} for the "
                "same inputs: draw random numbers from numpy.random.default_rng([scene.seed, a "
                "constant of your own]), read no clock, and share nothing between plugins"
            )


def _require_inactive(active: Mask, given: Mask, name: str) -> None:
    if (wrong := active & ~given).any():
        raise ContractError(
            f"row {int(np.argmax(wrong))} is not active in {name}, but active in the result: such "
            f"an agent is on the ground or has no goal; copy {name}.active"
        )


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield what a table consists of, with names such as ``Plan.setpoint.velocity``."""
    if is_dataclass(value):
        owner = name or type(value).__name__
        for one in fields(value):
            yield from _leaves(getattr(value, one.name), f"{owner}.{one.name}")
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from _leaves(item, f"{name}[{i}]" if name else "")
    else:
        yield name, value


def _is_array(leaf: Any) -> bool:
    return isinstance(leaf, np.ndarray)


def _equal(one: Any, other: Any) -> bool:
    if _is_array(one) and _is_array(other):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return bool(one == other)


def _agents(n: int) -> str:
    return f"{n} agent{'s' if n > 1 else ''}"


@contextmanager
def _case(label: str) -> Iterator[None]:
    """Put a label before the message of a contract error, and beside any other."""
    try:
        yield
    except ContractError as error:
        raise ContractError(f"{label}: {error}") from error
    except Exception as error:
        error.add_note(
            f"{label}; agents that are not located have rows of NaN, arrays of inputs are read-only"
        )
        raise


def _close(plugins: Sequence[Any]) -> None:
    for plugin in plugins:
        if hasattr(plugin, "close"):
            plugin.close()


def _reported(plugin: object, means: dict[int, float]) -> Times:
    times = ", ".join(f"{1e3 * mean:.3f} ms with {_agents(n)}" for n, mean in means.items())
    reports.append(f"{type(plugin).__name__}: {times} per call")
    return means
