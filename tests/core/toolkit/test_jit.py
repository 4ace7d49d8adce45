"""How kernels are compiled, kept on disk and reported."""

from __future__ import annotations

import ast
import gc
import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numba
import numpy as np
import pytest
from numba.core.types.functions import BaseFunction

from star_core.toolkit import compiled, jit, subroutine

ROOT = Path(__file__).parents[3]
KERNEL = """\
import sys
from star_core.toolkit import compiled
from constants import OFFSET
from functions import double
from pairs import PAIR, first


@compiled
def doubled(x):
    return double(x)


@compiled
def moved(x):
    return x + OFFSET


values = doubled(1.0), moved(1.0), first(PAIR)
hits = (sum(kernel.stats.cache_hits.values()) for kernel in (doubled, moved, first))
sys.stdout.write(repr((values, tuple(hits))))
"""
FUNCTIONS = '''\
from star_core.toolkit import subroutine


@subroutine
def double(x):
    """Return a product."""
    return twice(x)


@subroutine
def twice(x):
    return 2.0 * x
'''
CONSTANTS = "OFFSET = 1.0\n"
PAIRS = """\
from star_core.toolkit import compiled
from types_before import Pair


@compiled
def first(pair):
    return pair.first


PAIR = Pair(1.0)
"""
TYPES = "from typing import NamedTuple\n\n\nclass Pair(NamedTuple):\n    first: float\n"


class Ran(NamedTuple):
    """Results of the kernels `doubled`, `moved` and `first`, their loads from disk, and stderr."""

    values: tuple[float, ...]
    hits: tuple[int, ...]
    reported: str


Runs: TypeAlias = dict[str, Ran]


def edit(file: Path, old: str, new: str) -> None:
    source = file.read_text()
    assert old in source
    file.write_text(source.replace(old, new))


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Runs of the kernels in new processes: with arguments of 1."""
    folder = tmp_path_factory.mktemp("kernel")
    modules = {"functions": FUNCTIONS, "constants": CONSTANTS, "pairs": PAIRS}
    for name, source in {"kernel": KERNEL, "types_before": TYPES, **modules}.items():
        (folder / f"{name}.py").write_text(source)

    def run() -> Ran:
        command = [sys.executable, "-B", str(folder / "kernel.py")]  # edits are too quick for .pyc
        done = subprocess.run(command, capture_output=True, check=True, text=True)
        values, hits = ast.literal_eval(done.stdout)
        return Ran(values, hits, done.stderr)

    made = {"first": run()}
    edit(folder / "functions.py", "a product", "the product, which is a long story")
    edit(folder / "functions.py", "from star", "# A comment.\nfrom star")
    edit(folder / "constants.py", "\n", "\nUNUSED = 2.0\n")
    made["commented"] = run()
    edit(folder / "functions.py", "2.0 * x", "5.0 * x")
    edit(folder / "constants.py", "1.0", "4.0")
    (folder / "types_before.py").rename(folder / "types_after.py")
    edit(folder / "pairs.py", "from types_before", "from types_after")
    made["changed"] = run()
    return made


@pytest.mark.extended
def test_machine_code_of_other_sources_is_never_loaded_from_disk(runs: Runs) -> None:
    assert runs["first"][:2] == ((2.0, 2.0, 1.0), (0, 0, 0))
    assert runs["changed"][:2] == ((5.0, 5.0, 1.0), (0, 0, 0))


def test_comments_docstrings_and_unused_code_recompile_nothing(runs: Runs) -> None:
    assert runs["commented"][:2] == ((2.0, 2.0, 1.0), (1, 1, 1))


def test_compilation_is_reported_on_stderr_and_loading_is_not(runs: Runs) -> None:
    lines = runs["first"].reported.splitlines()
    kernels = [line.removeprefix("compiling kernels (once): ") for line in lines]
    assert kernels[0] == "__main__.doubled, 0 of up to 3 functions"
    names = {line.split(",")[0] for line in kernels}
    assert names == {"__main__.doubled", "__main__.moved", "pairs.first"}
    assert not runs["commented"].reported


@pytest.mark.extended
def test_editing_an_option_recompiles_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "star_voronoi"
    shutil.copytree(
        ROOT / "plugins" / "avoiders" / "star_voronoi",
        folder,
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    script = (
        "import numpy as np, star_voronoi; from star_voronoi.avoider import within\n"
        f"assert star_voronoi.__file__.startswith({str(tmp_path)!r})\n"
        "within(np.zeros((1, 3)), np.zeros((1, 1, 2)), np.zeros((1, 1)))\n"
        "print(sum(within.stats.cache_hits.values()))"
    )
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}

    def hits() -> int:
        done = subprocess.run(
            [sys.executable, "-c", script],
            env=environment,
            capture_output=True,
            check=True,
            text=True,
        )
        return int(done.stdout)

    assert hits() == 0
    edit(folder / "__init__.py", "Half the distance between agents", "Half their distance")
    assert hits() == 1


@pytest.mark.campaign
@pytest.mark.parametrize("mission", ["first_flight", "around", "search"])
def test_first_flights_report_compilation_and_equal_later_ones(
    mission: str, tmp_path: Path
) -> None:
    star = Path(sys.executable).with_name("star")
    path = ROOT / "missions" / f"{mission}.yaml"

    def fly() -> tuple[list[str], dict[str, Any]]:
        done = subprocess.run(
            [str(star), "run", str(path), "--no-record", "--json"],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            check=True,
            text=True,
        )
        summary: dict[str, Any] = json.loads(done.stdout)
        for key in ("wall_time_s", "realtime_factor", "compute_us", "compute_s", "slow_ticks"):
            del summary[key]
        summary["events"] = [event for event in summary["events"] if event["kind"] != "slow"]
        return [line for line in done.stderr.splitlines() if "compiling" in line], summary

    reports, first = fly()
    later_reports, later = fly()
    assert reports
    assert not later_reports
    assert first == later


@pytest.mark.extended
@pytest.mark.usefixtures("hop")
def test_a_flight_by_interpreted_kernels_is_the_same() -> None:
    star = str(Path(sys.executable).with_name("star"))

    def fly(**environment: str) -> dict[str, Any]:
        done = subprocess.run(
            [star, "run", "hop.yaml", "--no-record", "--json"],
            env=os.environ | environment,
            capture_output=True,
            check=True,
            text=True,
        )
        summary: dict[str, Any] = json.loads(done.stdout)
        return {key: summary[key] for key in ("steps", "min_separation_m", "position_rmse_m")}

    assert fly(NUMBA_DISABLE_JIT="1") == fly()


def test_a_division_by_zero_is_infinite() -> None:
    @compiled
    def over(x: float, y: float) -> float:
        return x / y

    assert over(1.0, 0.0) == math.inf


def test_sums_are_neither_fused_with_products_nor_reordered() -> None:
    @compiled
    def fused(a: float, b: float, c: float) -> float:
        return a * b + c

    @compiled
    def total(values: Any) -> float:
        most = 0.0
        for value in values:
            most += value
        return most

    assert fused(1 + 2**-30, 1 - 2**-30, -1.0) == 0.0  # the exact result is -(2**-60)
    assert total(np.array([1e16, *[1.0] * 30, -1e16])) == 0.0


def test_only_the_branch_for_an_argument_is_compiled() -> None:
    @compiled
    def length(values: Any) -> float:
        if values is None:
            return values.none_has_no_such_attribute  # type: ignore[attr-defined, no-any-return]
        return len(values)

    @compiled
    def missing(values: Any) -> float:
        if values is not None:
            return values.no_array_has_such_an_attribute  # type: ignore[no-any-return]
        return 0.0

    assert length(np.zeros(3)) == 3.0
    assert missing(None) == 0.0


def test_python_calls_a_subroutine_without_compiling_it() -> None:
    half = subroutine(_half)
    assert half(3.0) == 1.5
    assert half.__name__ == "_half"


def _half(x: float) -> float:
    return x / 2


def test_types_of_numba_are_not_changed_for_other_code() -> None:
    def broken(x: float) -> float:
        return x.no_number_has_such_an_attribute  # type: ignore[attr-defined, no-any-return]

    with pytest.raises(numba.TypingError):
        compiled(broken)(1.0)
    assert not hasattr(numba.types.Array, "literal_type")
    assert BaseFunction.get_call_type.__module__ == BaseFunction.__module__


def test_operators_are_looked_up_once_for_all_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    looked_up, numbas = [], BaseFunction.get_call_type

    def look_up(function: Any, *arguments: Any) -> Any:
        looked_up.append(function)
        return numbas(function, *arguments)

    def first(x: float) -> float:
        return x * x + abs(x)

    def second(x: float) -> float:
        return abs(x * x) + x

    compiled(first)(1.0)
    monkeypatch.setattr(jit, "_GET_CALL_TYPE", look_up)
    monkeypatch.setattr(BaseFunction, "get_call_type", look_up)
    assert compiled(second)(-2.0) == 2.0
    assert not looked_up


def test_garbage_of_the_compiler_is_old() -> None:
    def kernel(x: float) -> float:
        return x + 1.0

    threshold = gc.get_threshold()
    gc.set_threshold(1_000_000_000)
    try:
        compiled(kernel)(1.0)
        assert gc.get_count()[0] < 1_000  # of some 100,000 objects
    finally:
        gc.set_threshold(*threshold)


@subroutine
def thrice(value: float) -> float:
    with numba.objmode(doubled="float64"):
        doubled = float(2 * value)
    return value + doubled


def test_subroutines_of_a_new_kernel_may_return_to_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def kernel(value: float) -> float:
        return thrice(value)

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert compiled(kernel)(1.5) == 4.5
