"""A hall, scouts that fly exactly what the planner returns, and targets in their fields of view."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as made
from typing import Any

import numpy as np
import shapely

import star_search
from star_core import (
    Agent,
    AgentPhase,
    Array,
    Camera,
    Command,
    Estimate,
    Fence,
    Goals,
    Health,
    Limits,
    Mask,
    Obstacle,
    Registry,
    Rows,
    Scene,
    Sightings,
    Status,
    Tag,
    Task,
    World,
)
from star_core.testing import PointMasses
from star_core.toolkit import fill_defaults
from star_search.area import FieldOfView, field_of_view
from star_search.search_space import SearchSpace
from star_visibility import OPTIONS
from star_visibility.planner import Visibility

FLAT = (0.0, 0.0, 0.0, 1.0)
BLOCK = Obstacle("block", (((-0.4, -0.4), (0.4, -0.4), (0.4, 0.4), (-0.4, 0.4)),), (0.0, 2.5))
HEIGHT = 0.8  # m
PERIOD = 0.2  # s
SPEC = Registry(star_search, installed=False).find("task", "search").offer


def hall(
    agents: int = 2,
    *,
    half: float = 2.0,
    obstacles: tuple[Obstacle, ...] = (BLOCK,),
    targets: Mapping[str, tuple[float, float]] | None = None,
    camera: Camera | None = Camera(),  # noqa: B008 -- frozen
) -> Scene:
    starts = [(-half + 0.5 + 0.7 * i, -half + 0.5, 0.0) for i in range(agents)]
    tags = tuple(
        Tag(100 + i, 0.168, (x, y, 0.0), FLAT, name)
        for i, (name, (x, y)) in enumerate((targets or {}).items())
    )
    fence = Fence((-half, -half, 0.0), (half, half, 2.5))
    return Scene(
        agents=tuple(Agent(f"cf{i + 1}", at, 0.0, None, camera) for i, at in enumerate(starts)),
        period=PERIOD,
        world=World("hall", fence, obstacles, (), tags),
        limits=Limits(speed=0.5, acceleration=2.0, height=(0.2, 1.8)),
    )


@dataclass
class Searched:
    """What became of a search."""

    limit: float
    space: SearchSpace
    status: Status = Status.RUNNING
    reason: str = ""
    time: float = 0.0
    commands: list[tuple[float, Command]] = made(default_factory=list)
    position: list[Array] = made(default_factory=list)
    goal: list[Array] = made(default_factory=list)
    phase: Rows = made(default_factory=lambda: np.zeros(0, np.int64))
    finder: Rows = made(default_factory=lambda: np.zeros(0, np.int64))

    @property
    def track(self) -> Array:
        """(T, N, 3) where the scouts were."""
        return np.array(self.position)


class Scouts(PointMasses):
    """Point masses that fly what the planner returns, and see targets in their fields of view."""

    def __init__(self, scene: Scene, phase: AgentPhase = AgentPhase.FLYING) -> None:
        n = len(scene.agents)
        starts = np.array([(*agent.start[:2], HEIGHT) for agent in scene.agents])
        super().__init__(starts, phase=phase)
        self.scene = scene
        self.planner = Visibility(scene, **fill_defaults({}, OPTIONS))
        self.valid: Mask = np.ones(n, np.bool_)
        self.looks = np.zeros((len(scene.world.targets), n), np.int64)
        self.finder: Rows = np.full(len(scene.world.targets), -1)
        pieces = [shapely.Polygon(p) for o in scene.world.obstacles for p in o.polygons]
        self.walls = shapely.union_all(pieces)
        camera = scene.agents[0].camera
        self.view: FieldOfView | None = (
            field_of_view(camera, HEIGHT, 0.168, 0.05) if camera else None
        )

    def now(self) -> tuple[Estimate, Health]:
        visible = list(self.sighted())
        sightings = Sightings.none()
        if visible:
            agent, tag, position = (list(column) for column in zip(*visible, strict=True))
            k = len(visible)
            spread = np.tile(np.eye(3) * 1e-3, (k, 1, 1))
            sightings = Sightings(
                np.array(agent),
                np.array(tag),
                np.full(k, self.time),
                np.array(position),
                np.zeros(k),
                spread,
            )
        whole = replace(
            self.estimate(),
            valid=self.valid & np.ones(len(self.yaw), np.bool_),
            covariance=np.tile(np.eye(3) * 1e-4, (len(self.yaw), 1, 1)),
            sightings=sightings,
        )
        return whole, replace(self.health(), finder=self.finder)

    def sighted(self) -> Any:
        for k, tag in enumerate(self.scene.world.targets):
            for row in np.flatnonzero(self.phase == AgentPhase.FLYING).tolist():
                away = complex(*tag.position[:2]) - complex(*self.position[row, :2])
                turned = away * np.exp(-1j * self.yaw[row])
                sight = shapely.LineString(np.array([self.position[row, :2], tag.position[:2]]))
                if self.shows(turned) and not self.walls.intersects(sight):
                    self.looks[k, row] += 1
                    if self.finder[k] < 0 and self.looks[k, row] >= 3:
                        self.finder = self.finder.copy()
                        self.finder[k] = row
                    yield row, tag.id, tag.position

    def shows(self, at: complex) -> bool:
        points = np.array(self.view.points if self.view else [(np.inf, np.inf)])
        return bool((np.abs(points - [at.real, at.imag]) <= 0.025).all(axis=1).any())

    def fly(self, now: Estimate, goals: Goals) -> None:
        plan = self.planner.plan(now, goals)
        assert not plan.unreachable.any(), plan.reasons
        active = plan.setpoint.active & self.steered()
        self.send(replace(plan.setpoint, active=active))


def search(
    scene: Scene,
    *,
    rows: tuple[int, ...] | None = None,
    phase: AgentPhase = AgentPhase.FLYING,
    meddle: Callable[[float, Task, Scouts], None] = lambda _time, _task, _scouts: None,
    longest: float = 300.0,
    **options: Any,
) -> Any:
    """Search until it is over, or for `longest` seconds; `meddle` comes before all of it.

    Return what became of it, `Searched`.
    """
    scouts = Scouts(scene, phase)
    filled = fill_defaults(options, SPEC.options)
    task: Any = SPEC.make(scene, rows or tuple(range(len(scene.agents))), **filled)
    meddle(0.0, task, scouts)
    estimated, healthy = scouts.now()
    limit = task.begin(estimated, healthy)
    searched = Searched(limit, space=task._space)
    for tick in range(math.ceil(longest / scene.period)):
        searched.time = tick * scene.period
        meddle(searched.time, task, scouts)
        estimated, healthy = scouts.now()
        step = task.step(estimated, healthy)
        searched.position.append(scouts.position.copy())
        searched.status, searched.reason = step.status, step.reason
        if step.goals is not None:
            searched.goal.append(np.where(step.goals.active[:, None], step.goals.position, np.nan))
        if step.status is not Status.RUNNING:
            break
        for command in step.commands:
            searched.commands.append((searched.time, command))
            scouts.command(command)
        scouts.fly(estimated, step.goals or Goals.none(len(scene.agents)))
        scouts.wait((tick + 1) * scene.period)
    searched.phase, searched.finder = scouts.phase, scouts.finder
    return searched
