"""Catalogue of scenarios, and the scenario of a name, a number of agents and a seed."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from random import Random
from typing import Any, Final

from star_bench.scenario import Scenario
from star_bench.scenarios import (
    blocks,
    circle,
    corridor,
    crossing,
    disc,
    doorway,
    polygons,
    stack,
)
from star_core import InputError

MIN_AGENTS: Final = 2  # a single one has no other to avoid
MAX_AGENTS: Final = 256  # up to which tests cover the layout
MAX_WIDTH: Final = 10  # m, of a corridor, a door or a street

CATALOGUE: Final[Mapping[str, Callable[..., Scenario]]] = {
    draw.__name__: draw
    for draw in (circle, disc, crossing, stack, corridor, doorway, blocks, polygons)
}
NUMBERS: Final[Mapping[str, tuple[int, ...]]] = {"circle": (4, 8, 16, 32, 64)}
USUAL_NUMBERS: Final = (8, 16, 32)


@dataclass(frozen=True, slots=True)
class Case:
    """One scenario as one mission flies it.

    Attributes:
        scenario: Its name in the catalogue.
        agents: Number of agents.
        seed: Seed of the scenario and of the flight.
        options: Its options, such as the width of a corridor, m.
    """

    scenario: str
    agents: int
    seed: int
    options: Mapping[str, float] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The scenario with its options, for tables: ``corridor width 2``."""
        return " ".join([self.scenario, *(f"{k} {v:g}" for k, v in self.options.items())])

    @property
    def name(self) -> str:
        """Name of the mission and its file: ``corridor-width-1_2-8-0``."""
        return f"{self.title.replace(' ', '-').replace('.', '_')}-{self.agents}-{self.seed}"

    def draw(self) -> Scenario:
        """Return the scenario; equal cases give equal ones, other seeds give other ones."""
        rng = Random(f"{self.scenario} {self.agents} {self.seed}")  # noqa: S311 -- no secret
        return CATALOGUE[self.scenario](self.agents, rng, **self.options)


def numbers(scenario: str) -> tuple[int, ...]:
    """Return the default numbers of agents of a scenario."""
    return NUMBERS.get(scenario, USUAL_NUMBERS)


def checked_options(scenario: str, given: Mapping[str, Any]) -> Mapping[str, float]:
    """Return a scenario's options as numbers.

    Raises:
        InputError: It has no option of that name, or the value is not a valid length.
    """
    known = inspect.getfullargspec(CATALOGUE[scenario]).kwonlyargs
    for name, value in given.items():
        if name not in known:
            there = f"there is {', '.join(known)}" if known else "it has none"
            wrong = f"--scenarios: {scenario!r} has no option {name!r}; {there}"
            raise InputError(wrong, "invalid-argument")
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (number and 0 < value <= MAX_WIDTH):
            wrong = f"{value!r}, expected m, more than 0, {MAX_WIDTH} at most"
            raise InputError(f"--scenarios: {scenario} {name}: {wrong}", "out-of-range")
    return {name: float(value) for name, value in given.items()}
