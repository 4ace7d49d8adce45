"""The tasks of a mission's steps, made before anything moves: what is slow or wrong shows then."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from star_core.contracts import Task
from star_core.errors import ContractError
from star_core.messages.commands import Trajectory
from star_core.messages.validation import accepts, require_methods
from star_core.mission import Mission
from star_core.mission_file.step_tree import Action, Node, Parallel, Repeat
from star_core.plugin_guard import PluginGuard, close
from star_core.plugin_schema import fill_defaults
from star_core.registry import Registry


class TaskPool:
    """Makes every step's task at once, and more of them as they are needed.

    Args:
        mission: Its steps.
        registry: Where verbs are found.

    Attributes:
        trajectories: What the tasks may order to be flown on board, each once.
    """

    def __init__(self, mission: Mission, registry: Registry) -> None:
        self._scene = mission.scene
        self._registry = registry
        self._made: dict[int, Task] = {}
        self._all: list[tuple[PluginGuard, object]] = []  # those that can be closed
        self.trajectories: tuple[Trajectory, ...] = ()
        try:
            self._prepare(mission.steps)
        except BaseException:
            self.close()
            raise

    def take(self, action: Action, rows: tuple[int, ...]) -> tuple[Task, PluginGuard]:
        """Return a task of a step for some of its agents, and the guard that names its plugin."""
        ready = self._made.pop(id(action), None) if rows == action.rows else None
        return ready or self._task(action, rows), self._blame(action)

    def close(self) -> list[str]:
        """Close every task that can be closed; return what went wrong."""
        return close(self._all)

    def _prepare(self, nodes: Sequence[Node]) -> None:
        """Make the tasks of steps and of those within."""
        for node in nodes:
            match node:
                case Action():
                    task = self._made[id(node)] = self._task(node, node.rows)
                    self._carry(task, self._blame(node))
                case Parallel(inner) | Repeat(_, inner):
                    self._prepare(inner)

    def _carry(self, task: Task, blame: PluginGuard) -> None:
        """Have what a task may order uploaded."""
        with blame:
            for given in getattr(task, "trajectories", ()):
                if not isinstance(given, Trajectory):
                    raise ContractError(
                        f"trajectories has {type(given).__name__}, expected Trajectory"
                    )
                if given not in self.trajectories:
                    self.trajectories += (given,)

    def _task(self, action: Action, rows: tuple[int, ...]) -> Task:
        """Make a step's task for some of its agents."""
        offer = self._registry.find("task", action.verb).offer
        options = fill_defaults(action.options, offer.options)
        with self._blame(action):
            accepts(offer.make, "make", ("scene", "rows"), options)
            task = offer.make(self._scene, rows, **options)
            if hasattr(task, "close"):
                self._all.append((self._blame(action), task))
            require_methods(task, Task)
        return cast("Task", task)

    def _blame(self, action: Action) -> PluginGuard:
        source = self._registry.find("task", action.verb).source
        return PluginGuard(f"task {action.verb!r} ({source})", len(self._scene.agents))
