"""The verbs ``goto``, ``hold`` and ``wait``: fly to a position and stop, or hover."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from star_core import Array, Estimate, Goals, Health, Rows, Scene, Status, TaskOutput
from star_core.toolkit import shortlist, some, timeout
from star_verbs.positions import spread
from star_verbs.step_agents import DURATION_ERROR, StepAgents, assign

TOLERANCE: Final = 0.1  # m: distance from its position at which an agent has arrived
MAX_GOAL_ERROR: Final = 0.25  # m: an agent that flies nearer to its goal continues from the goal
FENCE_INSET: Final = 0.01  # m inside of the fence, for the rounding of offsets there and back
CONDITION_TIMEOUT: Final = 60.0  # s


class Approach:
    """A flight of some agents to one position each, which `target` chooses.

    It begins when all of them are located, and fails if a position is not flyable.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        speed: Speed limit, m/s; at most the scene's limit, and that if None.
        yaw_deg: Heading to turn to, degrees; None keeps each agent's own.
        within: Distance to its position that each agent must reach, m.

    Attributes:
        agents: The agents.
        goals: Their goals; None until all of them are located.
    """

    def __init__(
        self,
        scene: Scene,
        rows: tuple[int, ...],
        *,
        speed: float | None = None,
        yaw_deg: float | None = None,
        within: float = TOLERANCE,
    ) -> None:
        self.agents = StepAgents(scene, rows)
        self.goals: Goals | None = None
        self._speed = min(speed or math.inf, scene.limits.speed)
        self._yaw_deg = yaw_deg
        self._within = within
        self._target: Array | None = None
        self._yaw: Array = np.zeros(len(rows))
        self._fault = ""
        self._before: Goals | None = None

    def continue_from(self, goals: Goals) -> None:
        """Continue from these goals, not from the positions, where agents are near to them.

        Otherwise their errors would add up from step to step: a swarm that sags, as drones do,
        would sink, and offsets would lead elsewhere than the check of the mission expects.
        """
        self._before = goals

    def target(self, position: Array) -> Array:
        """Return (K, 3) positions to fly to, m, for agents at `position` (K, 3), m."""
        raise NotImplementedError

    def begin(self, estimate: Estimate, health: Health) -> float:
        self.aim(estimate)
        return self.travel_timeout(estimate)

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        self.aim(estimate)
        if self._fault:
            return TaskOutput(status=Status.FAILURE, reason=self._fault)
        done = self.done(estimate)
        return TaskOutput(self.goals, status=Status.SUCCESS if done else Status.RUNNING)

    def done(self, estimate: Estimate) -> bool:
        """Whether the step is over."""
        return self.arrived(estimate)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        kept = self.agents.keep(rows)
        if self._target is not None:
            self._yaw, self._target = self._yaw[kept], self._target[kept]
            self.goals = self.agents.goals(self._target, self._yaw, self._speed)

    def aim(self, estimate: Estimate) -> None:
        """Set the goals once all agents are located."""
        if self._target is not None or not self.agents.located(estimate):
            return
        rows = self.agents.rows
        self._target = self.target(self.origins(rows, estimate))
        yaw = self._yaw_deg
        self._yaw = estimate.yaw[rows] if yaw is None else np.full(len(rows), math.radians(yaw))
        self.goals = self.agents.goals(self._target, self._yaw, self._speed)
        self._fault = self.target_fault(self._target)

    def origins(self, rows: Rows, estimate: Estimate) -> Array:
        """Return the positions of some agents, or the goals that they are near to, (K, 3) m.

        Of agents that drifted out of the fence, as before another take-off, it is the point beside
        them inside, so that offsets there and back lead back to where agents may be.
        """
        position = estimate.position[rows]
        if self._before is not None:
            goal = self._before.position[rows]
            error = np.linalg.norm(position - goal, axis=1)
            near = self._before.active[rows] & (error <= MAX_GOAL_ERROR)
            position = np.where(near[:, None], goal, position)
        fence = self.agents.scene.world.fence
        low, high = np.array(fence.low[:2]), np.array(fence.high[:2])
        level = position[:, :2]
        outside = (level < low) | (level > high)
        inside = np.clip(level, low + FENCE_INSET, high - FENCE_INSET)
        return np.hstack([np.where(outside, inside, level), position[:, 2:]])

    def target_fault(self, target: Array) -> str:
        """Return which agents have goals that are not flyable, and why; empty if none.

        The check of the mission covers the positions for all agents of a step, but not those for
        the remaining agents, nor the results of offsets.
        """
        scene = self.agents.scene
        faults = (
            f"{scene.agents[row].name} cannot be there: {fault}"
            for row, (x, y, z) in zip(self.agents.rows, target.tolist(), strict=True)
            if (fault := scene.position_fault((x, y, z))) is not None
        )
        return shortlist(faults, "; ")

    def arrived(self, estimate: Estimate) -> bool:
        """Whether all of them have stopped at their positions; call it each tick."""
        return self._target is not None and self.agents.arrived(
            estimate, self._target, self._within
        )

    def distance(self, estimate: Estimate) -> float:
        """Return the greatest distance of an agent from its position, m; infinite if unknown."""
        if self._target is None:
            return math.inf
        return self.agents.max_distance(estimate, self._target)

    def travel_timeout(self, estimate: Estimate, extra: float = 0.0) -> float:
        """Return the timeout of the flight and `extra` seconds, s."""
        travel = self.agents.travel_distance(estimate, self._target)
        return self.agents.timeout(travel / self._speed + extra)


class Goto(Approach):
    """Sends agents to a point, spread around it, or each of them by an offset.

    The point may be one at an offset from another agent. While it moves with that agent, it stays
    where it was last as long as no agent can be where it should be.

    The arguments beside scene and rows are the verb's options.
    """

    def __init__(
        self,
        scene: Scene,
        rows: tuple[int, ...],
        *,
        to: Sequence[float] | None = None,
        by: Sequence[float] = (0.0, 0.0, 0.0),
        relative_to: str | None = None,
        moving: bool = False,
        spacing: float,
        **approach: Any,
    ) -> None:
        super().__init__(scene, rows, **approach)
        self._to = to
        self._by = by
        self._spacing = spacing
        self._other = None if relative_to is None else scene.names.index(relative_to)
        self._moving = moving

    def travel_timeout(self, estimate: Estimate, extra: float = 0.0) -> float:
        if not self._moving:
            return super().travel_timeout(estimate, extra)
        travel = self.agents.travel_distance(estimate, None)  # wherever the other agent flies
        return self.agents.timeout(travel / self._speed + extra)

    def aim(self, estimate: Estimate) -> None:
        if self._other is None:
            super().aim(estimate)
            self._exchange(estimate)
        elif estimate.valid[self._other] and (self._moving or self._target is None):
            self._aim_beside(self._other, estimate)

    def _exchange(self, estimate: Estimate) -> None:
        """Let agents exchange their goals around a point if they are stuck."""
        if self._to is None or self._target is None:
            return
        target = self.agents.exchanged(estimate, self._target, self._within)
        if some(target != self._target):
            self._target = target
            self.goals = self.agents.goals(target, self._yaw, self._speed)

    def _aim_beside(self, other: int, estimate: Estimate) -> None:
        """Set the goals for where another agent is."""
        position = estimate.position[other]
        if not self._moving:
            position = self.origins(np.array([other]), estimate)[0]
        point = position + np.array(self._by, np.float64)
        if self._target is None:
            flyable = self.agents.scene.position_fault(tuple(point.tolist())) is None
            if flyable or not self._moving:
                self._to = point.tolist()
                super().aim(estimate)
            return
        target = self._target + (point - np.array(self._to))
        if not super().target_fault(target):
            self._to, self._target = point.tolist(), target
            velocity = np.broadcast_to(estimate.velocity[other], target.shape)
            self.goals = self.agents.goals(target, self._yaw, self._speed, velocity)

    def arrived(self, estimate: Estimate) -> bool:
        if not self._moving:
            return super().arrived(estimate)
        return self.distance(estimate) <= self._within

    def target(self, position: Array) -> Array:
        if self._to is None:
            return position + np.array(self._by, np.float64)
        targets = np.array(spread(len(position), self._to, self._spacing))
        return targets[assign(position, targets)]

    def on_agent_replaced(self, old: int, new: int) -> None:
        self.agents.replace(old, new)
        if self._target is not None:
            self.goals = self.agents.goals(self._target, self._yaw, self._speed)


class Hold(Goto):
    """Keeps agents at their positions, or at a point and spread around it, for a time.

    The time begins with their arrival; agents that stay at their positions have arrived at once.

    The arguments beside scene and rows are the verb's options.
    """

    def __init__(
        self,
        scene: Scene,
        rows: tuple[int, ...],
        *,
        at: Sequence[float] | None = None,
        **options: Any,
    ) -> None:
        self._seconds: float = options.pop("for")  # a keyword of Python
        super().__init__(scene, rows, to=at, **options)
        self._stays = at is None and self._other is None
        self._since: float | None = None

    def begin(self, estimate: Estimate, health: Health) -> float:
        self.aim(estimate)
        if self._stays:
            return timeout(self._seconds)
        return self.travel_timeout(estimate, self._seconds)

    def target_fault(self, target: Array) -> str:
        return "" if self._stays else super().target_fault(target)

    def done(self, estimate: Estimate) -> bool:
        if self._since is None and self.arrived(estimate):
            self._since = estimate.time
        return (
            self._since is not None
            and estimate.time - self._since >= self._seconds - DURATION_ERROR
        )

    def arrived(self, estimate: Estimate) -> bool:
        return self.goals is not None if self._stays else super().arrived(estimate)


class Wait:
    """Leaves the goals of its agents unchanged; the core evaluates the step's condition."""

    def __init__(self, scene: Scene, rows: tuple[int, ...]) -> None:
        pass

    def begin(self, estimate: Estimate, health: Health) -> float:
        return CONDITION_TIMEOUT

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        return TaskOutput()

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        """The remaining agents keep waiting."""

    def on_agent_replaced(self, old: int, new: int) -> None:
        """The new agent waits too."""
