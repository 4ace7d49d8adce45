"""The tasks of a mission's steps, made before take-off: what is slow or wrong shows then."""

from __future__ import annotations

from star_core.contracts import Task
from star_core.errors import ContractError
from star_core.messages.commands import Trajectory
from star_core.metrics.timing import ComputeTime
from star_core.mission import Mission
from star_core.mission_file.step_tree import Action, actions
from star_core.plugin_guard import PluginGuard, close_all, require_methods, require_signature
from star_core.plugin_schema import fill_defaults
from star_core.registry import Registry


class TaskPool:
    """Makes the task of every step at the start, and further ones as they are needed.

    Args:
        mission: Its steps.
        registry: Where verbs are found.
        compute_time: Measures each task.

    Attributes:
        trajectories: Those that the tasks may order to be flown on board, each once.
    """

    def __init__(self, mission: Mission, registry: Registry, compute_time: ComputeTime) -> None:
        self._scene = mission.scene
        self._registry = registry
        self._compute_time = compute_time
        self._ready: dict[int, Task] = {}
        self._closing: list[tuple[PluginGuard, object]] = []
        self.trajectories: tuple[Trajectory, ...] = ()
        try:
            for action in actions(mission.steps):
                task = self._ready[id(action)] = self._make(action, action.rows)
                self._add_trajectories(task, self._guard(action))
        except BaseException:
            self.close()
            raise

    def take(self, action: Action, rows: tuple[int, ...]) -> tuple[Task, PluginGuard]:
        """Return a task of a step for some of its agents, and the guard that names its plugin."""
        ready = self._ready.pop(id(action), None) if rows == action.rows else None
        return ready or self._make(action, rows), self._guard(action, timed=True)

    def close(self) -> list[str]:
        """Close every task that has ``close()``; return their errors."""
        return close_all(self._closing)

    def _add_trajectories(self, task: Task, guard: PluginGuard) -> None:
        with guard:
            for given in getattr(task, "trajectories", ()):
                if not isinstance(given, Trajectory):
                    raise ContractError(
                        f"trajectories has {type(given).__name__}, expected Trajectory"
                    )
                if given not in self.trajectories:
                    self.trajectories += (given,)

    def _make(self, action: Action, rows: tuple[int, ...]) -> Task:
        """Make a step's task for some of its agents."""
        spec = self._registry.find("task", action.verb).offer
        options = fill_defaults(action.options, spec.options)
        guard = self._guard(action)
        with guard:
            require_signature(spec.make, "make", ("scene", "rows"), options)
            task: Task = spec.make(self._scene, rows, **options)
            if hasattr(task, "close"):
                self._closing.append((guard, task))
            require_methods(task, Task)
        return task

    def _guard(self, action: Action, *, timed: bool = False) -> PluginGuard:
        source = self._registry.find("task", action.verb).source
        plugin = f"task {action.verb!r} ({source})"
        stopwatch = self._compute_time.of(plugin) if timed else None
        return PluginGuard(plugin, len(self._scene.agents), stopwatch)
