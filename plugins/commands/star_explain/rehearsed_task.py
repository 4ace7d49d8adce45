"""A task in a rehearsal: it records the outcome of its step, and never fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, cast

from star_core import Estimate, Goals, Health, PluginError, Status, Task, TaskOutput
from star_core.toolkit import Action, Outcome, PluginGuard, RehearsedStep, step_timeout
from star_explain.words import seconds

LONGEST: Final = 600.0  # s, greatest rehearsed duration of a step
FOREVER: Final = 1e9  # s: the rehearsal itself ends steps
CLOCK_ERROR: Final = 1e-9  # s, rounding error of a sum of ticks


class RehearsedTask:
    """Runs the task of a step for as long as it needs, also beyond its timeout.

    Its step always succeeds, so that the steps after it are rehearsed too.

    Args:
        action: The step of the mission.
        rows: Its agents.
        make: Makes its task; None if it cannot be rehearsed.
        limit: Timeout of a step that is not rehearsed, unless the mission sets one, s.

    Attributes:
        running: Whether the step has begun and is not over.
        ended: Mission time of the last call, s.
    """

    def __init__(
        self,
        action: Action,
        rows: tuple[int, ...],
        make: Callable[[], Task] | None,
        limit: float | None = None,
    ) -> None:
        self.running = False
        self.begun = self.ended = math.nan
        self._action, self._rows = action, rows
        self._timeout = limit if action.timeout is None else action.timeout
        self._horizon = LONGEST
        self._outcome: Outcome = "unknown"
        self._problem = ""
        self._task: Task | None = None
        if make is not None:
            try:
                self._task = make()
            except PluginError as error:
                self._outcome, self._problem = "raised", str(error)

    def __getattr__(self, name: str) -> Any:
        """Return optional attributes of the task, as for a change of its agents."""
        return getattr(self.__dict__.get("_task"), name)

    def continue_from(self, goals: Goals) -> None:
        if self._task is not None and hasattr(self._task, "continue_from"):
            with self._noted():
                self._task.continue_from(goals)

    def begin(self, estimate: Estimate, health: Health) -> float:
        self.running, self.begun, self.ended = True, estimate.time, estimate.time
        action = self._action
        if self._task is not None:
            with self._noted():
                derived = float(self._task.begin(estimate, health))
                wait = None if action.until is None else action.until.longest_wait
                self._timeout = step_timeout(derived, wait, action.timeout)
                self._horizon = min(self._timeout, LONGEST)
        if action.timeout is not None and action.until is None:
            self._horizon = LONGEST  # to find the timeout that it needs
        return FOREVER

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        self.ended = estimate.time
        output: Any = TaskOutput(status=Status.SUCCESS)
        if self._task is None or self._problem:
            self.running = False
            return cast("TaskOutput", output)
        with self._noted():
            output = self._task.step(estimate, health)
        if not isinstance(output, TaskOutput):
            return cast("TaskOutput", output)  # the executor refuses it
        if output.status is not Status.RUNNING:
            self._finish(output)
        elif self.ended - self.begun >= self._horizon - CLOCK_ERROR:
            self._give_up()
        return output if self.running else TaskOutput(output.goals, status=Status.SUCCESS)

    def fail(self, problem: str) -> None:
        """Note why the step fails, if it runs; it ends in the next tick."""
        if self.running:
            self._outcome, self._problem = "failed", problem

    def end_by_condition(self) -> None:
        """Note that its condition ended the step."""
        self.running, self._outcome = False, "done"

    def result(self) -> RehearsedStep:
        """Return how the step went."""
        on_board = bool(getattr(self._task, "trajectories", ()))
        return RehearsedStep(
            self._action,
            self._rows,
            self.begun,
            self.ended,
            self._timeout,
            self._outcome,
            self._problem,
            on_board,
        )

    def _finish(self, output: TaskOutput) -> None:
        """Note how the task ended."""
        self.running, duration = False, self.ended - self.begun
        if output.status is Status.FAILURE:
            self._outcome, self._problem = "failed", output.reason or "failed and gave no reason"
        elif self._problem:
            return
        elif self._timeout is not None and duration > self._timeout + CLOCK_ERROR:
            self._outcome = "late"
            self._problem = (
                f"takes about {seconds(duration)}, but times out after {self._timeout:g} s"
            )
        else:
            self._outcome = "done"

    def _give_up(self) -> None:
        """End a step that does not end by itself."""
        self.running, limit = False, self._timeout
        if self._action.until is None and limit is not None and limit <= LONGEST:
            self._problem = f"times out after {limit:.3g} s"
            if self._action.timeout is None:
                self._outcome = "late"

    @contextmanager
    def _noted(self) -> Iterator[None]:
        """Note what the task raises."""
        try:
            with PluginGuard(f"task {self._action.verb!r} ({self._action.source})"):
                yield
        except PluginError as error:
            self._outcome, self._problem = "raised", str(error)
