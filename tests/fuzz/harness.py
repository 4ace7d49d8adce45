"""Runs targets of fuzzing: many spoiled inputs each, every one the same for the same seed."""

from __future__ import annotations

import random
import resource
import signal
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Final, NoReturn, TypeAlias

MAX_CPU: Final = 4.0  # s of processor time for one input; 2 on an idle computer
MAX_WALL: Final = 60.0  # s of the clock, for one that waits
MAX_DEFECTS: Final = 20  # of a target, after which it ends

Draw: TypeAlias = random.Random
Try: TypeAlias = Callable[[Draw], str]
"""Makes one input, gives it to the program, and returns what became of it; raises for a defect."""


@dataclass(frozen=True)
class Target:
    """A kind of input.

    Attributes:
        name: Name of the kind.
        few: Number of inputs in the default tests.
        many: Number of inputs of ``make fuzz``.
        opened: Prepares the target in an empty folder.
        patience: Factor of the limits of time.
    """

    name: str
    few: int
    many: int
    opened: Callable[[Path], AbstractContextManager[Try]]
    patience: float = 1.0


@dataclass
class Report:
    """What became of the inputs of a target.

    Attributes:
        outcomes: Number of inputs by outcome.
        defects: Number of the first input, and traceback, by exception and source line.
        slowest: Longest processor time of an input, s.
        growth: Growth of the greatest resident memory of the process, bytes.
        took: Time of the clock, s.
    """

    outcomes: Counter[str] = field(default_factory=Counter)
    defects: dict[str, tuple[int, str]] = field(default_factory=dict)
    slowest: float = 0.0
    growth: int = 0
    took: float = 0.0


class Broken(AssertionError):  # noqa: N818 -- what it looks for
    """A defect that is distinguished by its text, not by the source line that raises it."""


class Hangs(KeyboardInterrupt):
    """An input takes too long; neither ``except Exception`` nor the guards of plugins catch it."""


def run(target: Target, folder: Path, count: int, seed: int, *, first: int = 0) -> Report:
    """Try `count` inputs of a target, from number `first` on."""
    report, began = Report(), time.monotonic()
    with target.opened(folder) as attempt, warnings.catch_warnings():
        warnings.simplefilter("error")  # it would be on the user's terminal
        before = _peak()
        for number in range(first, first + count):
            draw = random.Random(f"{target.name}-{seed}-{number}")  # noqa: S311 -- no secret
            cpu = time.process_time()
            try:
                with _limited(target.patience):
                    report.outcomes[attempt(draw)] += 1
            except (Exception, SystemExit, Hangs) as error:  # noqa: BLE001 -- what it looks for
                report.outcomes["DEFECT"] += 1
                report.defects.setdefault(_where(error), (number, traceback.format_exc()))
                if len(report.defects) >= MAX_DEFECTS:
                    break
            report.slowest = max(report.slowest, time.process_time() - cpu)
        report.growth = _peak() - before
    report.took = time.monotonic() - began
    return report


def _where(error: BaseException) -> str:
    """Return the type of an exception and the innermost line that raised it, or its text."""
    if isinstance(error, Broken):
        return str(error)
    *_, last = traceback.extract_tb(error.__traceback__)
    return f"{type(error).__name__} at {last.filename}:{last.lineno}"


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


@contextmanager
def _limited(patience: float) -> Iterator[None]:
    """Raise `Hangs` if something takes longer than the limits."""

    def give_up(_number: int, _frame: FrameType | None) -> NoReturn:
        raise Hangs

    timers = {signal.SIGPROF: (signal.ITIMER_PROF, patience * MAX_CPU),
              signal.SIGALRM: (signal.ITIMER_REAL, patience * MAX_WALL)}  # fmt: skip
    before = {number: signal.signal(number, give_up) for number in timers}
    try:
        for timer, limit in timers.values():
            signal.setitimer(timer, limit)
        yield
    finally:
        for timer, _limit in timers.values():
            signal.setitimer(timer, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
