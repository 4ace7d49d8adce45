"""How kernels are compiled and kept."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest

from star_core import compiled, toolkit
from star_core.toolkit import jit as kernels

KERNEL = """\
from star_core import compiled
from inner import twice


@compiled
def kernel(x):
    return twice(x) + 1.0


print(kernel(1.0), sum(kernel.stats.cache_hits.values()))
"""
INNER = """\
from star_core import compiled


@compiled
def twice(x):
    return 2.0 * x
"""


def run(folder: Path) -> tuple[float, int]:
    """What the kernel gives for 1, and how often it came from disk."""
    told = subprocess.run(
        [sys.executable, str(folder / "kernel.py")], capture_output=True, check=True, text=True
    )
    value, hits = told.stdout.split()
    return float(value), int(hits)


def test_machine_code_comes_from_disk_but_never_that_of_other_sources(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    (tmp_path / "inner.py").write_text(INNER)
    assert run(tmp_path) == (3.0, 0)
    assert run(tmp_path) == (3.0, 1)
    (tmp_path / "inner.py").write_text(INNER.replace("2.0", "5.0"))
    assert run(tmp_path) == (6.0, 0)


def test_a_division_by_zero_is_infinite() -> None:
    @compiled
    def over(x: float, y: float) -> float:
        return x / y

    assert over(1.0, 0.0) == math.inf


def test_what_other_kernels_only_call_is_not_kept() -> None:
    def half(x: float) -> float:
        return x / 2

    name = half.__qualname__
    assert compiled(half, on_disk=False)(3.0) == 1.5
    assert half.__qualname__ == name


def test_machine_code_is_not_that_of_another_toolkit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = kernels._sources.__wrapped__(tmp_path)
    (tmp_path / "toolkit").mkdir()
    (tmp_path / "toolkit" / "trajectory.py").write_text("")
    monkeypatch.setattr(toolkit, "__path__", [str(tmp_path / "toolkit")])
    assert kernels._sources.__wrapped__(tmp_path) != name
