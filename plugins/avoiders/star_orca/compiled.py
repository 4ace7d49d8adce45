"""How this package compiles its kernels: ahead of flight, kept on disk, IEEE arithmetic."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])

# numba looks only at the file of the function that is called from Python to see whether the machine
# code on disk is still good, but the other files are compiled into it. It finds that code by the
# function's name, so a name that holds all the sources is of no other code.
_SOURCES = hashlib.sha256(
    b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))
).hexdigest()[:16]


def compiled(function: Function) -> Function:
    """Return `function` compiled by numba, with its type as it was.

    Division follows IEEE 754 in place of Python (no test for zero before every one), and the
    machine code is kept beside the source.
    """
    function.__qualname__ += f"_{_SOURCES}"
    return cast("Function", njit(cache=True, error_model="numpy")(function))
