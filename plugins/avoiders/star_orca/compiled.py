"""How this package compiles its kernels: ahead of flight, kept on disk, IEEE arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return `function` compiled by numba, with its type as it was.

    Division follows IEEE 754 in place of Python (no test for zero before every one), and the
    machine code is kept beside the source. Numba looks only at the file of the function that is
    called from Python to see whether that code is still good: `star_orca.kernel` says more.
    """
    return cast("Function", njit(cache=True, error_model="numpy")(function))
