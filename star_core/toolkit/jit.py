"""How plugins compile their inner loops: once, kept on disk, never stale."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit
from numba.core.event import TimingListener, register

from star_core import toolkit
from star_core.messages import rotations

Function = TypeVar("Function", bound=Callable[..., Any])

_compiling = TimingListener()  # type: ignore[no-untyped-call]
register("numba:compiler_lock", _compiling)  # type: ignore[no-untyped-call]


def compile_time() -> float:
    """Return how long numba has compiled in this process so far, s."""
    return _compiling.duration if _compiling.done else 0.0


def compiled(
    function: Function, *, on_disk: bool = True, alone: bool = False, **options: Any
) -> Function:
    """Return `function` compiled by numba, with its type as it was.

    Division follows IEEE 754 in place of Python: no test for zero before every one. To find the
    machine code on disk numba looks at the function's own file only, but other files are compiled
    into it; so the function is given a name that holds every source of its folder, of
    `star_core.toolkit` and of `star_core.messages.rotations`.

    Args:
        function: Takes numbers and arrays.
        on_disk: Whether to keep the machine code; False for what other kernels only call.
        alone: Whether nothing is compiled into it but code of its own file, which numba looks at.
        options: Of `numba.njit`.
    """
    if on_disk and not alone:
        function.__qualname__ += f"_{_sources(Path(function.__code__.co_filename).parent)}"
    return cast("Function", njit(cache=on_disk, error_model="numpy", **options)(function))


@cache
def _sources(folder: Path) -> str:
    """A name for all the sources in a folder, in the toolkit and of rotations."""
    shared = [*Path(*toolkit.__path__).glob("*.py"), Path(rotations.__file__)]
    files = sorted([*folder.glob("*.py"), *shared])
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]
