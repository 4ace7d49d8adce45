"""The law of drift, compiled: imported by flights only, since checks of missions do without."""

from __future__ import annotations

from typing import Any

import numpy as np

from star_core import Array
from star_core.toolkit import compiled, subroutine
from star_flow.drift import follow_move

_follow_move = subroutine(follow_move)


@compiled
def follow_moves(
    deviations: Array,
    position: Array,
    last: Array,
    begin: tuple[Array, Array],
    state: tuple[Any, Array, Array, Array],
    period: float,
    elapsed: float,
) -> None:
    """Add a move of all agents to the state of `star_flow.drift.Drift`; see `follow_move`."""
    for row in range(len(position)):
        _follow_move(row, deviations, position, last, begin, state, period, elapsed)


def warm_up() -> None:
    """Compile the kernel, or load it from disk, before the flight."""
    plane, line, square = np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2, 2))
    state = np.zeros((0, 2), np.complex128), line, plane, square
    follow_moves(np.zeros((0, 3, 2)), np.zeros((0, 3)), plane, (plane, line), state, 0.0, 0.0)
