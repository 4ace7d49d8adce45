"""Faults of the calls of localizers, planners, avoiders and tasks."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from star_core import TaskOutput
from star_core.toolkit import Fault
from star_faults.tables import Passing, spoiled


class OutputFaults:
    """A method of a plugin, with a fault.

    Args:
        right: The method.
        now: Returns the mission time, s.
    """

    def __init__(
        self,
        fault: Fault,
        random: np.random.Generator,
        right: Callable[..., Any],
        now: Callable[[], float],
    ) -> None:
        self._fault = fault
        self._random = random
        self._right = right
        self._now = now
        self._passing: Passing | None = None

    def __call__(self, *arguments: Any) -> Any:
        """Return the method's output, or what the fault makes of it."""
        now, mode = self._now(), self._fault.mode
        active = bool(self._fault.rows(now))
        if active and (
            mode == "off"
            or (mode == "intermittent" and self._random.random() < self._fault.values["loss"])
        ):
            raise RuntimeError("injected fault")
        if active and mode == "slow":
            time.sleep(self._fault.values["delay"])
        output = self._right(*arguments)
        if mode in {"stuck", "delayed"}:
            return self._old(output, now)
        if not active or mode in {"slow", "intermittent"}:
            return output
        values = self._fault.values
        nan = mode == "garbage"
        factor = np.nan if nan else values["factor"]
        offset = np.full(3, np.nan) if nan else np.array(values["offset"])
        return spoiled(output, self._passes(output).active(now), factor, offset)

    def _old(self, output: Any, now: float) -> Any:
        """Return the output with rows of an earlier one, as of the present."""
        part = output.goals if isinstance(output, TaskOutput) else output
        if part is None:
            return output
        passing = self._passes(output)
        old, _ = passing.shown(part, now, passing.fresh(now))
        return replace(output, goals=old) if isinstance(output, TaskOutput) else old

    def _passes(self, output: Any) -> Passing:
        if self._passing is None:
            table = getattr(output, "setpoint", output)  # of a plan
            table = getattr(table, "goals", table)  # of a task
            n = len(table.yaw) if table is not None else 1 + max(self._fault.until)
            self._passing = Passing(self._fault, self._random, n)
        return self._passing
