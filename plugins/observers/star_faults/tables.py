"""Rows of tables that pass late, seldom or not at all."""

from __future__ import annotations

from collections import deque
from dataclasses import fields, replace
from typing import Any

import numpy as np

from star_core import Array, Goals, Mask, Plan, Setpoint, TaskOutput, Transform
from star_core.toolkit import Fault


class Passing:
    """Decides which rows of a table with one row per agent pass in a tick, and keeps old ones."""

    def __init__(self, fault: Fault, random: np.random.Generator, n: int) -> None:
        self._fault = fault
        self._random = random
        self._n = n
        self._due = 0.0  # s, when the next rows pass in mode slow
        self._shown: Any = None
        self._since = np.zeros(n)  # s, when each row that is shown was new
        self._queue: deque[tuple[float, Any]] = deque()

    def active(self, time: float) -> Mask:
        """(N,) agents that have the fault at a mission time, s."""
        mask = np.zeros(self._n, np.bool_)
        mask[list(self._fault.rows(time))] = True
        return mask

    def fresh(self, time: float) -> Mask:
        """(N,) agents whose rows pass at a mission time, s; others repeat an earlier one."""
        active = self.active(time)
        match self._fault.mode:
            case "slow":
                passes = time >= self._due - 1e-9
                if passes and active.any():
                    self._due = time + 1 / self._fault.values["rate"]
            case "intermittent":
                passes = self._random.random(self._n) >= self._fault.values["loss"]
            case mode:
                passes = mode == "delayed"
        answer: Mask = ~active | passes
        return answer

    def shown(self, table: Any, time: float, fresh: Mask) -> tuple[Any, Array]:
        """Return the table with the rows that pass, and the time since each row was new, s: (N,).

        Args:
            table: Of this tick.
            time: Mission time, s.
            fresh: (N,) rows that pass.
        """
        active = self.active(time)
        source, taken = table, time
        if self._fault.mode == "delayed":
            self._queue.append((time, table))
            while len(self._queue) > 1 and self._queue[1][0] <= time - self._fault.values["delay"]:
                self._queue.popleft()
            taken, source = self._queue[0]
        if not active.any():
            self._shown = None
            return table, np.zeros(self._n)
        if self._shown is None:
            self._shown, self._since = source, np.full(self._n, taken)
        self._shown = select(fresh, source, self._shown)
        self._since = np.where(fresh, taken, self._since)
        return select(~active, table, self._shown), np.where(active, time - self._since, 0.0)


def select(mask: Mask, first: Any, second: Any) -> Any:
    """Return `first` with the rows of `second` where an (N,) mask is False.

    Tables with one row per agent are selected by row; others within them stay as in `first`.
    """
    changes: dict[str, Any] = {}
    for name in (field.name for field in fields(first)):
        value, alternative = getattr(first, name), getattr(second, name)
        if isinstance(value, Transform | Setpoint | Goals) and alternative is not None:
            changes[name] = select(mask, value, alternative)
        elif isinstance(value, np.ndarray) and alternative is not None:
            changes[name] = np.where(mask.reshape(-1, *[1] * (value.ndim - 1)), value, alternative)
    return replace(first, **changes)


def kept(table: Any, mask: Mask) -> Any:
    """Return the rows of a long table where a mask is True."""
    columns = {field.name: getattr(table, field.name) for field in fields(table)}
    return replace(
        table,
        **{
            name: column[mask]
            if isinstance(column, np.ndarray)
            else tuple(item for item, keep in zip(column, mask, strict=True) if keep)
            for name, column in columns.items()
        },
    )


def joined(tables: list[Any]) -> Any:
    """Return the rows of long tables one after the other."""
    first = tables[0]
    return replace(
        first,
        **{
            field.name: np.concatenate([getattr(table, field.name) for table in tables])
            if isinstance(getattr(first, field.name), np.ndarray)
            else sum((getattr(table, field.name) for table in tables), ())
            for field in fields(first)
        },
    )


def spoiled(output: Any, mask: Mask, factor: float, offset: Array) -> Any:
    """Return a plugin's output with velocities times a factor and positions moved, where masked.

    Args:
        output: An `Estimate`, a `Plan`, a `Setpoint` or a `TaskOutput`.
        mask: (N,) agents.
        factor: Of velocities.
        offset: (3,) added to positions, m; a localizer's frames move with its estimates.
    """
    match output:
        case Plan():
            return replace(output, setpoint=spoiled(output.setpoint, mask, factor, offset))
        case Setpoint():
            velocity = np.where(mask[:, None], factor * output.velocity, output.velocity)
            return replace(output, velocity=velocity)
        case TaskOutput(goals=None):
            return output
        case TaskOutput():
            return replace(output, goals=spoiled(output.goals, mask, factor, offset))
    moved = output.position + np.where(mask[:, None], offset, 0.0)
    if isinstance(output, Goals):
        return replace(output, position=moved)
    frames = output.map_from_odom
    translation = frames.translation + np.where(mask[:, None], offset, 0.0)
    return replace(output, position=moved, map_from_odom=replace(frames, translation=translation))
