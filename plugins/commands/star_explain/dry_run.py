"""Dry run of a mission's steps: expected duration and timeout of each, without disturbances.

The task of every step is created and begun where the previous steps end, as in a flight, and gets
estimates of agents that follow its goals exactly. So every timeout equals that of a flight; the
duration of a step is that without other agents, obstacles, drift and acceleration limits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, TypeAlias

import numpy as np

from star_core import AgentPhase, Array, Goals, Mission, Registry, StarError, Status, Task, TaskSpec
from star_core.toolkit import step_timeout
from star_explain import follows_surfaces
from star_explain.dry_run_swarm import NO_TIME, DryRunSwarm
from star_explain.separation import kept_distance
from star_explain.tracks import Tracks
from star_explain.words import seconds

TICK: Final = 0.1  # s, of the dry run: a smaller one does not change points that fly straight
NO_DISTANCE: Final = 1e-6  # m, rounding error of a position
ARRIVED: Final = 0.1  # m, from its goal, at which an agent has arrived
BESIDE: Final = 0.2  # m beside what is lower, at which an agent may be above it by its error
STRAIGHT: Final = 0.9999  # cosine of a change of direction that is no corner
LONGEST: Final = 600.0  # s, greatest simulated duration of one step


@dataclass(frozen=True, slots=True)
class StepResult:
    """Dry-run result of one step.

    Attributes:
        action: The step of the mission.
        agents: Names of its agents.
        takes: Duration without disturbances, s; None if unknown.
        limit: Its timeout, s; None if unknown.
        given: Whether the mission sets the timeout.
        fault: Why it would fail, or why nothing is known about it; empty otherwise.
        on_board: Whether its agents fly trajectories on board, without steering.
        blocked: Which obstacles are in the way of which agents, if the planner ignores them.
        surfaces: Over which surface each agent flies that is not as high as that of its start, if
            heights are measured from there.
        late: Whether it fails by its timeout.
        failed: Whether it fails for another reason, such as a goal where no agent can be.
        certain: Whether its agents begin it where the dry run has them: after a step that a
            condition ended, or of unknown duration, they may be elsewhere.
        anchored: Whether its agents begin it at goals that the mission names, and not above where
            they took off, which is known less exactly.
        ends: Goals of its agents at its end, (n, 3) m, if the check of the mission could not know
            them; empty otherwise.
        paths: For each agent, corners of its path, (K, 3) in the map, m; of several repetitions
            those of the first.
    """

    action: Any
    agents: tuple[str, ...]
    takes: float | None
    limit: float | None
    given: bool
    fault: str
    on_board: bool = False
    blocked: tuple[str, ...] = ()
    surfaces: tuple[str, ...] = ()
    late: bool = False
    failed: bool = False
    certain: bool = True
    anchored: bool = False
    ends: tuple[Array, ...] = ()
    paths: tuple[Array, ...] = ()


@dataclass(frozen=True, slots=True)
class Group:
    """Steps that run in parallel or in sequence.

    Attributes:
        at_once: Whether they run in parallel.
        times: Number of repetitions.
        parts: The steps.
    """

    at_once: bool
    times: int
    parts: tuple[Part, ...]

    @property
    def file(self) -> str:
        """The file that contains them; empty if unknown."""
        steps = [part.action.location for part in self.parts if isinstance(part, StepResult)]
        files = {place.rsplit(":", 2)[0] for place in steps}
        files = files or {part.file for part in self.parts if isinstance(part, Group)}
        return files.pop() if len(files) == 1 else ""

    @property
    def takes(self) -> float | None:
        """Duration without disturbances, s; None if unknown."""
        return self._all([part.takes for part in self.parts])

    @property
    def limit(self) -> float | None:
        """Greatest duration, s; None if unknown."""
        return self._all([part.limit for part in self.parts])

    def _all(self, times: Sequence[float | None]) -> float | None:
        known = [time for time in times if time is not None]
        if len(known) < len(times):
            return None
        return self.times * (max(known, default=0.0) if self.at_once else math.fsum(known))


Part: TypeAlias = StepResult | Group


@dataclass(frozen=True, slots=True)
class Crowd:
    """Two agents that hover too near to each other after a step.

    Attributes:
        path: Of the step in the document.
        rows: Of the agents.
        distance: Between them, m.
        kept: Horizontal distance that they keep, m.
    """

    path: tuple[str | int, ...]
    rows: tuple[int, int]
    distance: float
    kept: float


def dry_run(mission: Mission, registry: Registry) -> Group:
    """Return the dry-run results of a mission's steps."""
    return dry_run_with_tracks(mission, registry)[0]


def dry_run_with_tracks(
    mission: Mission, registry: Registry
) -> tuple[Group, Tracks, tuple[Crowd, ...]]:
    """Return the dry-run results of a mission's steps, where its agents are, and which crowd."""
    run = _DryRun(mission, registry)
    result = run.sequence(mission.steps, 1, 0.0)
    return result, run.tracks, tuple(run.crowds.values())


def corners(path: Array) -> Array:
    """Return the ends of a path, (K, 3) m, and the points at which its direction changes.

    >>> corners(np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0], [3, 0, 0], [3, 1, 0.0]]))
    array([[0., 0., 0.],
           [3., 0., 0.],
           [3., 1., 0.]])
    """
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1) > NO_DISTANCE
    path = path[np.concatenate([[True], moved])]
    way = np.diff(path, axis=0)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    turns = (way[:-1] * way[1:]).sum(axis=1) < STRAIGHT
    kept: Array = path[np.concatenate([[True], turns, [True]])] if len(way) else path
    return kept


class _DryRun:
    """Dry run of the steps of a mission.

    Args:
        mission: Mission to run.
        registry: Registry of its verbs.

    Attributes:
        tracks: Where the agents are.
        crowds: Agents that hover too near to each other after a step of the mission, by their rows.
    """

    def __init__(self, mission: Mission, registry: Registry) -> None:
        # With `realtime` set, no plugin may wait for anything.
        self._scene = replace(mission.scene, realtime=True, period=TICK)
        self._registry = registry
        self._kept = kept_distance(mission)
        self._outer = mission.steps  # between which all agents hover
        self._swarm = DryRunSwarm(self._scene)
        self.tracks = Tracks(self._scene)
        self.crowds: dict[tuple[int, int], Crowd] = {}
        self._out = set(mission.reserve_rows)
        self._ignores_obstacles = not registry.find(
            "planner", mission.parts["planner"].use
        ).offer.avoids_obstacles
        self._surfaces_matter = follows_surfaces(mission, registry)
        # Of the current step: whether it is flown on board, late or fails, obstacles in its way,
        # and path.
        self._on_board = self._late = self._failed = False
        self._uncertain: set[int] = set()  # rows
        self._anchored: set[int] = set()  # rows
        self._blocked: dict[tuple[int, str], str] = {}
        self._surfaces: dict[tuple[int, str], str] = {}
        self._beside: dict[tuple[int, str], str] = {}  # likewise, of what agents pass nearly above
        self._track: list[Array] = []  # positions, (n, 3) m, of its n agents

    def sequence(self, nodes: Sequence[Any], times: int, begun: float) -> Group:
        """Run steps in sequence; of several repetitions only the first is run."""
        parts: list[Part] = []
        first, marks = begun, self.tracks.marks()
        for node in nodes:
            part = self._node(node, begun)
            begun += part.takes or 0.0
            parts.append(part)
            if node in self._outer:
                self._note_crowds(node)
        self.tracks.repeat(marks, times, begun - first)
        return Group(at_once=False, times=times, parts=tuple(parts))

    def _node(self, node: Any, begun: float) -> Part:
        if hasattr(node, "branches"):
            parts = tuple(self._node(branch, begun) for branch in node.branches)
            return Group(at_once=True, times=1, parts=parts)
        if hasattr(node, "times"):
            return self.sequence(node.steps, node.times, begun)
        return self._action(node, begun)

    def _action(self, action: Any, begun: float) -> StepResult:
        if action.verb == "join":
            self._out -= set(action.rows)
        rows = tuple(row for row in action.rows if row not in self._out)
        agents = tuple(self._scene.agents[row].name for row in rows)
        given = action.timeout is not None
        if not rows:
            return StepResult(action, agents, 0.0, 0.0, given, "no agents are left for it")
        self._on_board = self._late = self._failed = False
        self._blocked, self._surfaces, self._beside = {}, {}, {}
        self._track = [self._swarm.position[[*rows]]]
        try:
            takes, limit, fault = self._run(action, rows, begun)
        except StarError as error:
            takes, limit, fault = None, action.timeout, str(error)
        except Exception as error:  # noqa: BLE001 -- whatever a plugin may raise
            what = f"task {action.verb!r} ({action.source}) raised {error!r}"
            takes, limit, fault = None, action.timeout, what
        if action.verb == "leave":
            self._out |= set(rows)
        ends = self._swarm.position[[*rows]] if self._is_relative(action, rows) else ()
        certain, anchored = self._uncertain.isdisjoint(rows), self._anchored.issuperset(rows)
        self._note_origins(action, rows, sure=takes is not None and action.until is None)
        blocked = tuple(self._blocked.values())
        paths = tuple(corners(path) for path in np.array(self._track).swapaxes(0, 1))
        return StepResult(
            action,
            agents,
            takes,
            limit,
            given,
            fault,
            on_board=self._on_board,
            blocked=blocked,
            surfaces=tuple((self._beside | self._surfaces).values()),
            late=self._late,
            failed=self._failed,
            certain=certain,
            anchored=anchored,
            ends=tuple(ends) if takes is not None else (),
            paths=paths,
        )

    def _goals_of(self, action: Any, rows: tuple[int, ...]) -> bool:
        """Return whether the check of a mission knows the goals of a step."""
        offer: TaskSpec = self._registry.find("task", action.verb).offer
        if offer.goals is None:
            return False
        return any(offer.goals(self._scene, rows, **action.options))

    def _note_origins(self, action: Any, rows: tuple[int, ...], *, sure: bool) -> None:
        """Note which agents are where the dry run has them after a step, and how exactly."""
        offer: TaskSpec = self._registry.find("task", action.verb).offer
        named = self._goals_of(action, rows)
        if not sure:
            self._uncertain |= set(rows)
        elif named:
            self._uncertain -= set(rows)
        if named and sure:
            self._anchored |= set(rows)
        elif "ground" in {offer.before, offer.after}:
            self._anchored -= set(rows)

    def _is_relative(self, action: Any, rows: tuple[int, ...]) -> bool:
        """Return whether a step leads to goals that depend on where it begins."""
        offer: TaskSpec = self._registry.find("task", action.verb).offer
        return (offer.before, offer.after) == ("air", "air") and not self._goals_of(action, rows)

    def _run(
        self, action: Any, rows: tuple[int, ...], begun: float
    ) -> tuple[float | None, float, str]:
        """Run a step; return its duration and its timeout, s, and why it fails."""
        offer: TaskSpec = self._registry.find("task", action.verb).offer
        held = offer.exclusive
        if held and held.unless not in action.written:  # do not claim resources
            limit = held.timeout if action.timeout is None else action.timeout
            return None, float(limit), ""
        task: Task = offer.make(self._scene, rows, **action.options)
        self._on_board = bool(getattr(task, "trajectories", ()))
        try:
            limit = self._limit(action, task, begun)
            takes, fault = self._perform(action, task, rows, begun, limit)
        finally:
            if (close := getattr(task, "close", None)) is not None:
                close()
        return takes, limit, fault

    def _limit(self, action: Any, task: Task, begun: float) -> float:
        """Begin a task and return the timeout of its step, as in a flight, s."""
        limit = float(task.begin(self._swarm.estimate(begun), self._swarm.health()))
        wait = None if action.until is None else action.until.longest_wait
        return step_timeout(limit, wait, action.timeout)

    def _perform(
        self, action: Any, task: Task, rows: tuple[int, ...], begun: float, limit: float
    ) -> tuple[float | None, str]:
        """Run a step; return its duration, s, None if unknown, and why it fails."""
        end = math.inf if action.until is None else action.until.holds_from(math.inf)
        goals: Goals | None = None
        # A timeout that the mission sets is ignored at first, to report the one that is needed.
        horizon = LONGEST if action.timeout is not None and action.until is None else limit
        for tick in range(math.ceil(min(horizon, end, LONGEST) / TICK) + 1):
            now = begun + tick * TICK
            step = task.step(self._swarm.estimate(now), self._swarm.health())
            if step.status is Status.FAILURE:
                self._failed = True
                return None, step.reason or "failed and gave no reason"
            if step.status is Status.SUCCESS or tick * TICK >= end - NO_TIME:
                self._late = tick * TICK > limit + TICK
                takes = tick * TICK
                text = f"takes about {seconds(takes)}, but times out after {limit:g} s"
                return takes, text if self._late else ""
            goals = step.goals or goals
            for command in step.commands:
                self._swarm.execute(command, now)
            self._swarm.move(goals, rows, now + TICK)
            self._track.append(self._swarm.position[[*rows]])
            swarm = self._swarm
            self.tracks.add(now + TICK, rows, swarm.position, swarm.yaw, swarm.phase)
            if self._ignores_obstacles:
                self._note_obstacles(rows)
            if self._surfaces_matter:
                self._note_surfaces(rows)
        late = action.until is None and limit <= LONGEST
        return None, f"times out after {limit:g} s, even with nothing in the way" if late else ""

    def _note_obstacles(self, rows: tuple[int, ...]) -> None:
        """Note which obstacles the agents touch, each where it is touched first."""
        for row in rows:
            x, y, z = self._swarm.position[row].tolist()
            if self._swarm.phase[row] != AgentPhase.FLYING:
                continue
            for obstacle in self._scene.world.obstacles:
                if obstacle.touched((x, y, z), z):
                    name = self._scene.agents[row].name
                    where = f"at [{x:.2f}, {y:.2f}, {z:.2f}]"
                    text = f"obstacle {obstacle.name!r} is in the way of {name} {where}"
                    self._blocked.setdefault((row, obstacle.name), text)

    def _note_crowds(self, node: Any) -> None:
        """Note which agents in the air are so near to others that the core keeps them apart."""
        limits, swarm = self._scene.limits, self._swarm
        flying = swarm.phase == AgentPhase.FLYING
        rows = [row for row in range(len(flying)) if flying[row] or row not in self._out]
        rows = [row for row in rows if row not in self._uncertain]
        beside = max(limits.separation, self._kept - ARRIVED)
        semi_axes = np.array([beside, beside, limits.vertical_separation])
        if not rows or not semi_axes.all():
            return
        offset = swarm.position[rows][:, None] - swarm.position[rows]  # (K, K, 3)
        near = np.linalg.norm(offset / semi_axes, axis=2) < 1 - NO_DISTANCE
        near &= flying[rows][:, None] | flying[rows]
        for i, k in np.argwhere(np.triu(near, 1)).tolist():
            pair = rows[i], rows[k]
            path = node.at if hasattr(node, "at") else node.path
            apart = float(np.linalg.norm(offset[i, k]))
            crowd = Crowd(tuple(path), pair, apart, self._kept)
            self.crowds.setdefault(pair, crowd)

    def _note_surfaces(self, rows: tuple[int, ...]) -> None:
        """Note over what the agents fly that is not as high as where they started."""
        for row in rows:
            agent = self._scene.agents[row]
            if self._swarm.phase[row] != AgentPhase.FLYING or math.isnan(agent.start[0]):
                continue
            x, y, z = self._swarm.position[row].tolist()
            start = self._surface(agent.start)[0]
            height, what, flies = self._surface((x, y, z))
            notes = [(height, what, flies, self._surfaces)]
            notes += [
                (obstacle.height[1], f"obstacle {obstacle.name!r}", "may fly", self._beside)
                for obstacle in self._scene.world.obstacles
                if start <= height < obstacle.height[1] < z
                and obstacle.gaps((x, y, obstacle.height[1]))[0] < BESIDE
            ]
            for height, what, flies, noted in notes:
                climbs = height - start
                if climbs != 0.0:
                    text = (
                        f"{agent.name} {flies} over {what} at [{x:.2f}, {y:.2f}, {z:.2f}], from "
                        f"where a ranger measures its height: it "
                        f"{'climbs' if climbs > 0 else 'sinks'} by {abs(climbs):.2f} m"
                    )
                    noted.setdefault((row, what), text)

    def _surface(self, point: tuple[float, float, float]) -> tuple[float, str, str]:
        """Return the surface below a point: its height, m, and what it is; and how sure that is.

        A planner may lead over an obstacle that is in the way.
        """
        scene = self._scene
        ceiling = min(scene.limits.height[1], scene.world.fence.high[2])
        for obstacle in () if self._ignores_obstacles else scene.world.obstacles:
            top = obstacle.height[1]
            if point[2] < top < ceiling and obstacle.touched(point, point[2]):
                return top, f"obstacle {obstacle.name!r}", "may fly"
        below = scene.world.below(point)
        if below is None:
            return 0.0, "the floor", "flies"
        return below.height[1], f"obstacle {below.name!r}", "flies"
