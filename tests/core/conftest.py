"""A laboratory that flies missions with obedient stubs, each of which misbehaves on demand."""

from __future__ import annotations

import io
import itertools
import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import star_core as star
import star_monitors
import star_yaml
from star_core import (
    AgentPhase,
    AvoiderSpec,
    LocalizerSpec,
    Operator,
    Order,
    PlannerSpec,
    Status,
    TaskOutput,
    TaskSpec,
    TransportSpec,
    hookimpl,
)
from star_core.discovery import Source
from star_core.mission import Mission
from star_core.plugin_support.registry import Registry
from star_core.plugin_support.specs import SPECS
from star_core.runner import fly
from star_yaml.mission_loader import load
from tests.core.robots import SOON, Robots

TOUR = """
  - climb: {}
  - wait: {seconds: 2}
  - descend: {}
"""
WORLD = "star: 1\nname: room\nfence: {low: [-9, -9, -9], high: [9, 9, 9]}\n"
MISSION = """\
star: 1
name: lab
world: room.yaml
rate: 10
swarm: {{{swarm}}}
transport: robots
localizer: seer
planner: dash
avoider: idle
mission:{steps}"""


class Seer:
    """A localizer that knows where the odometry frames lie."""

    def __init__(self, frames: star.Transform) -> None:
        self._frames = frames

    def locate(self, telemetry: star.Telemetry) -> star.Estimate:
        n = len(telemetry.age)
        return star.Estimate(
            time=telemetry.time,
            position=self._frames.apply(telemetry.position),
            velocity=self._frames.turn(telemetry.velocity),
            yaw=2 * np.arctan2(*telemetry.attitude[:, 2:].T) + self._frames.yaw,
            covariance=np.zeros((n, 3, 3)),
            valid=np.ones(n, np.bool_),
            map_from_odom=self._frames,
        )


class Dash:
    """A planner that wants to be at every goal by the next tick, however fast that is."""

    def __init__(self, scene: star.Scene) -> None:
        self._period = scene.period

    def plan(self, estimate: star.Estimate, goals: star.Goals) -> star.Plan:
        velocity = (goals.position - estimate.position) / self._period
        setpoint = star.Setpoint(velocity, goals.yaw, goals.active & estimate.valid)
        nowhere = star.Paths(np.zeros(0, np.int64), np.zeros((0, 3)))
        return star.Plan(setpoint, nowhere, np.zeros(len(goals.yaw), np.bool_))


class Script:
    """A task that gives its commands once and its goals in every tick, until it is over.

    Then it succeeds or, if it has a reason for that, fails.
    """

    def __init__(
        self, first: TaskOutput, over: Callable[..., Any], limit: float = 20.0, fails: str = ""
    ) -> None:
        self._say = first
        self._over = over
        self._limit = limit
        self._end = TaskOutput(status=Status.FAILURE if fails else Status.SUCCESS, reason=fails)

    def begin(self, estimate: star.Estimate, health: star.Health) -> float:
        self._begun = estimate.time
        return self._limit

    def step(self, estimate: star.Estimate, health: star.Health) -> TaskOutput:
        say, self._say = self._say, TaskOutput(self._say.goals)
        if not say.commands and self._over(estimate, health, estimate.time - self._begun + SOON):
            return self._end
        return say


def _order(
    order: Order, until: AgentPhase | None, _scene: star.Scene, rows: tuple[int, ...], **target: Any
) -> Script:
    """Give an order; over when all are in a phase or, with None, when its duration is over."""
    k = len(rows)
    position = np.tile(target.get("to", [0.0, 0.0, float(order is Order.TAKEOFF)]), (k, 1))
    yaw = np.full(k, math.radians(target.get("yaw_deg", 0.0)))
    seconds = target.get("seconds", 1.0)
    command = star.Command(order, np.array(rows), position, yaw, np.full(k, seconds))

    def over(_estimate: star.Estimate, health: star.Health, since: float) -> bool:
        return since >= seconds if until is None else all(health.phase[list(rows)] == until)

    return Script(TaskOutput(commands=(command,)), over)


def _visit(scene: star.Scene, rows: tuple[int, ...], **target: Any) -> Script:
    """Fly to a point; over when all are there."""
    n = len(scene.agents)
    active = np.isin(np.arange(n), rows)
    point, yaw = np.tile(target["to"], (n, 1)), np.radians(np.full(n, target.get("yaw_deg", 0.0)))
    goals = star.Goals(point, np.zeros((n, 3)), yaw, np.full(n, 0.5), active)
    return Script(
        TaskOutput(goals), lambda now, *_: np.allclose(now.position[active], point[active])
    )


def _wait(_scene: star.Scene, _rows: tuple[int, ...], seconds: float, **end: Any) -> Script:
    return Script(TaskOutput(), lambda _estimate, _health, since: since >= seconds, **end)


VERBS: Mapping[str, tuple[Callable[..., Any], str]] = {  # how it is made, and its options
    "climb": (partial(_order, Order.TAKEOFF, AgentPhase.FLYING), ""),
    "descend": (partial(_order, Order.LAND, AgentPhase.LANDED), "seconds"),
    "join": (partial(_order, Order.TAKEOFF, AgentPhase.FLYING), ""),
    "leave": (partial(_order, Order.LAND, AgentPhase.LANDED), ""),
    "ride": (partial(_order, Order.GOTO, None), "to yaw_deg seconds"),
    "visit": (_visit, "to yaw_deg"),
    "wait": (_wait, "seconds limit fails"),
}


class Lab:
    """Offers the stubs as one plugin, flies missions with them, and watches.

    Attributes:
        swarm: Names of the agents; they start 1 m apart along the y axis.
        frames: Where odometry frames lie in the map; None: where the agents start.
        realtime: Whether mission time goes on by itself.
        closed: How often parts were closed, by role: their kind, or the verb of a task.
        robots: The transport of the last flight.
    """

    def __init__(self, folder: Path) -> None:
        self.swarm: tuple[str, ...] = ("cf1", "cf2")
        self.frames: star.Transform | None = None
        self.realtime = False
        self.closed: Counter[str] = Counter()
        self.robots: Robots
        self.robots_class = Robots
        self.ticks: list[star.Tick] = []
        self.events: list[star.Event] = []
        self.phases: list[tuple[float, str | None, str]] = []
        self.summaries: list[Mapping[str, Any]] = []
        self.registry = Registry(star_yaml, star_monitors, installed=False)
        self.registry.add(self, Source("their-dist:lab", "1.2"))
        self._folder = folder
        self._wrong: dict[tuple[str, str], Callable[..., Any]] = {}

    def spoil(
        self,
        role: str,
        method: str,
        wrong: BaseException | Callable[..., Any],
        calls: range | None = None,
    ) -> None:
        """Have a method of a role, or ``make``, raise `wrong`, or answer ``wrong(right, *args)``.

        Here ``right`` is the method as it was. With `calls` only those, counted from 0, go wrong.
        """
        count = itertools.count()

        def answer(right: Callable[..., Any], *args: Any, **options: Any) -> Any:
            if calls is not None and next(count) not in calls:
                return right(*args, **options)
            if isinstance(wrong, BaseException):
                raise wrong
            return wrong(right, *args, **options)

        self._wrong[role, method] = answer

    def load(self, steps: str = TOUR, more: str = "") -> Mission:
        """Read a mission of these steps, a YAML list, with `more` lines before them."""
        (self._folder / "room.yaml").write_text(WORLD)
        path = self._folder / "mission.yaml"
        agents = (f"{name}: {{start: [0, {i}, 0]}}" for i, name in enumerate(self.swarm))
        path.write_text(more + MISSION.format(swarm=", ".join(agents), steps=steps))
        return load(path, self.registry)

    def fly(
        self, steps: str = TOUR, operator: Operator | None = None, more: str = ""
    ) -> dict[str, Any]:
        """Fly a mission of these steps."""
        return fly(self.load(steps, more), self.registry, operator=operator)

    def ordered(self, order: Order) -> list[int]:
        """Rows that were given an order, in the order they were given it in."""
        commands = (command for _, command in self.robots.commands if command.order is order)
        return [row for command in commands for row in command.agent.tolist()]

    def went(self, agent: str | None) -> list[str]:
        """Phases that an agent, or with None the mission, went through."""
        return [phase for _, name, phase in self.phases if name == agent]

    def said(self, kind: str) -> list[str]:
        """Texts of the events of a kind."""
        return [event.text for event in self.events if event.kind == kind]

    @hookimpl
    def star_transports(self) -> Iterable[TransportSpec]:
        yield replace(self._offer("transport", "robots", self._robots), realtime=self.realtime)

    @hookimpl
    def star_localizers(self) -> Iterable[LocalizerSpec]:
        yield self._offer("localizer", "seer", lambda scene: Seer(self._where(scene)))

    @hookimpl
    def star_planners(self) -> Iterable[PlannerSpec]:
        yield self._offer("planner", "dash", Dash)

    @hookimpl
    def star_avoiders(self) -> Iterable[AvoiderSpec]:
        idle = SimpleNamespace(avoid=lambda _estimate, planned: planned)
        yield self._offer("avoider", "idle", lambda _scene: idle)

    @hookimpl
    def star_tasks(self) -> Iterable[TaskSpec]:
        return [self._offer(verb, verb, *how) for verb, how in VERBS.items()]

    @hookimpl
    def star_ticked(self, tick: star.Tick) -> None:
        self.ticks.append(tick)

    @hookimpl
    def star_phase_changed(self, time: float, agent: str | None, phase: str) -> None:
        self.phases.append((time, agent, phase))

    @hookimpl
    def star_event(self, event: star.Event) -> None:
        self.events.append(event)

    @hookimpl
    def star_mission_ended(self, summary: Mapping[str, Any]) -> None:
        self.summaries.append(summary)

    def _offer(self, role: str, name: str, make: Callable[..., Any], options: str = "") -> Any:
        def furnished(*args: Any, **options: Any) -> Any:
            part = make(*args, **options)
            part.close = partial(self.closed.update, [role])
            for (whose, method), wrong in self._wrong.items():
                if whose == role and method != "make":
                    setattr(part, method, partial(wrong, getattr(part, method)))
            return part

        def made(*args: Any, **options: Any) -> Any:
            wrong = self._wrong.get((role, "make"))
            return wrong(furnished, *args, **options) if wrong else furnished(*args, **options)

        schema = {"type": "object", "properties": {key: {} for key in options.split()}}
        return SPECS[role if role in SPECS else "task"](  # type: ignore[call-arg]
            name=name, summary=f"The stub {name}.", make=made, options=schema
        )

    def _robots(self, scene: star.Scene) -> Robots:
        self.robots = self.robots_class(self._where(scene))
        return self.robots

    def _where(self, scene: star.Scene) -> star.Transform:
        starts = np.array([agent.start for agent in scene.agents])
        return self.frames or star.Transform(np.zeros(len(starts)), starts)


def heard(change: Callable[[star.Telemetry], Mapping[str, Any]]) -> Callable[..., Any]:
    """Return what spoils ``receive`` of a transport: columns that are changed."""

    def wrong(right: Callable[[], star.Telemetry]) -> star.Telemetry:
        telemetry = right()
        return replace(telemetry, **change(telemetry))

    return wrong


def a_pipe(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """Return what is written to stderr, a pipe, from now on."""
    text = io.StringIO()
    monkeypatch.setattr(sys, "stderr", text)
    monkeypatch.setattr("star_core.toolkit.progress._reporter._until", 0.0)  # no work before
    return text


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    return Lab(tmp_path)
