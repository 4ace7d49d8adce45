"""Decorators that compile the functions of the simulator's inner loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar

from star_core.toolkit import compiled as compiled_by_star
from star_core.toolkit import subroutine

Function = TypeVar("Function", bound=Callable[..., Any])

# Lets the compiler fuse and reorder sums, but preserve infinities and NaN.
FAST = {"contract", "arcp", "reassoc", "nsz"}

Record: TypeAlias = Any  # one row of a table of `star_sim.drone.DRONE`; mypy cannot know its fields


def compiled(function: Function) -> Function:
    """Compile a function that a kernel calls; a division by zero gives infinity, as in numpy."""
    return subroutine(function, fastmath=FAST)


def kernel(function: Function) -> Function:
    """Compile a function that Python calls, and keep the machine code on disk for the next run."""
    return compiled_by_star(function, fastmath=FAST)
