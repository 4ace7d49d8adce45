"""Lengths of the paths that agents flew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from star_core import Array, Tick
from star_core.toolkit import every


class PathLengths:
    """Adds up the way of each agent from tick to tick, by ground truth if there is one.

    The path of an agent whose position was never known is unknown, and not part of the total.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._length = np.zeros(len(names))  # m
        self._located = np.zeros(len(names), np.bool_)  # whether a position was ever known
        self._last: Array | None = None  # (N, 3) positions in the previous tick, m

    def add(self, tick: Tick) -> None:
        """Add the way since the previous tick."""
        position = tick.estimate.position if tick.truth is None else tick.truth.position
        if self._last is not None:
            step = position - self._last
            length = np.sqrt(np.vecdot(step, step))
            finite = np.isfinite(length)
            self._length += length if every(finite) else np.where(finite, length, 0.0)
        if not every(self._located):
            self._located |= np.isfinite(position).all(axis=1)
        self._last = position

    def summary(self) -> dict[str, Any]:
        """Return the lengths in total and for each agent, m; None if unknown."""
        has_length = (
            np.full(len(self._names), fill_value=True) if self._last is None else self._located
        )
        return {
            "total": float(self._length.sum()) if has_length.any() else None,
            "per_agent": {
                name: float(length) if located else None
                for name, length, located in zip(self._names, self._length, has_length, strict=True)
            },
        }
