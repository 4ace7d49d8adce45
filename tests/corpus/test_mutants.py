"""Whatever is left of a shipped file: it is good, or refused in lines with their places, soon."""

from __future__ import annotations

import re
import shutil
import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import NoReturn

import pytest

from star_core.errors import InputError
from star_core.mission import load
from star_core.registry import Registry
from tests.corpus.mutants import mutants

LINE = re.compile(r"[^:\s]+(\.yaml:\d+:\d+)?: \S.*")
SEED = 20
FEW, MANY = 100, 10_000
LIMIT = 20.0  # s of the clock for one file, on a machine that has other things to do


class _Hangs(BaseException):
    """What no `except Exception` catches."""


@contextmanager
def soon() -> Iterator[None]:
    """Raise `_Hangs` if something takes longer than `LIMIT`."""

    def give_up(_number: int, _frame: FrameType | None) -> NoReturn:
        raise _Hangs

    before = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def faults(path: Path, registry: Registry) -> tuple[str, ...]:
    """What is wrong with a mission; the one error that may come of it says what."""
    try:
        load(path, registry)
    except InputError as error:
        return error.problems or ("refused without a reason",)
    return ()


def survey(missions: Path, count: int) -> Counter[str]:
    """Check spoilt files, and return how many are refused and how many are good all the same."""
    registry = Registry()
    names = [path.name for path in missions.glob("*.yaml")]
    world_of = {
        load(missions / name, registry).document.data["world"]: name for name in sorted(names)
    }
    originals = {name: (missions / name).read_bytes() for name in (*names, *world_of)}
    outcomes: Counter[str] = Counter()
    for name, content in mutants(originals, count, SEED):
        (missions / name).write_bytes(content)
        with soon():
            problems = faults(missions / world_of.get(name, name), registry)
        outcomes["refused" if problems else "good"] += 1
        for problem in problems:
            assert LINE.fullmatch(problem), (problem, content)
            assert " raised " not in problem, (problem, content)
        (missions / name).write_bytes(originals[name])
    return outcomes


@pytest.fixture
def shipped(missions: Path, tmp_path: Path) -> Path:
    """A copy of the missions that may be spoilt."""
    return shutil.copytree(missions, tmp_path / "missions")


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.campaign)])
def test_a_spoilt_file_is_refused_in_lines_or_still_good(shipped: Path, count: int) -> None:
    outcomes = survey(shipped, count)
    assert outcomes["refused"] > outcomes["good"] > 0
    assert outcomes.total() == count
