"""Targets: random valid missions, checked, flown, and judged on the ground truth.

A mission that ``star check`` passes without a warning is completed: no drone touches another or an
obstacle, leaves the fence, falls, or stands still away from its goal.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from itertools import count
from pathlib import Path
from typing import Final

from star_core import InputError, Registry, fly, load
from star_core.discovery import Source
from star_core.formats import check_file
from tests.fuzz.files import registry
from tests.fuzz.ground_truth import Witness, judged
from tests.fuzz.harness import Broken, Draw, Target, Try
from tests.fuzz.random_missions import random_mission

SIZES: Final[Mapping[str, Mapping[str, int]]] = {
    "short flights": {"agents": 2, "steps": 1, "rate": 10},
    "flights": {"agents": 12, "steps": 5},
}
PATIENCE: Final = 50.0  # a flight takes up to a minute of processor time


@cache
def watched() -> tuple[Registry, Witness]:
    """Return a registry with a witness, the same ones for all flights: plugins load slowly."""
    flight, witness = Registry(), Witness()
    flight.add(witness, Source("test:witness", ""))
    return flight, witness


def flown(draw: Draw, folder: Path, size: str) -> str:
    """Draw a mission, check it and, without a warning, fly it; return what became of it.

    Args:
        draw: Source of all that is random.
        folder: For its files.
        size: Key of `SIZES`.

    Raises:
        Broken: It was passed without a warning, and something went wrong.
    """
    drawn = random_mission(draw, **SIZES[size])
    path = drawn.write(folder)
    try:
        _, warnings = check_file(path, registry())
    except InputError:
        return "refused"
    if warnings:
        return "warned of"
    flight, witness = watched()
    witness.reset()
    summary = fly(load(path, flight), flight)
    witness.watch_on()
    if defects := judged(witness, drawn.world, summary):
        raise Broken("; ".join(defects))
    return "completed"


@contextmanager
def _flights(folder: Path, size: str) -> Iterator[Try]:
    numbers = count()

    def attempt(draw: Draw) -> str:
        own = folder / f"{size} {next(numbers)}"
        own.mkdir()
        return flown(draw, own, size)

    yield attempt


TARGETS: Final = (
    Target("short flights", 4, 200, partial(_flights, size="short flights"), PATIENCE),
    Target("flights", 0, 1000, partial(_flights, size="flights"), PATIENCE),
)
