"""Tables that the core makes of its own arrays are as those that are checked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from star_core import Registry, Tick, fly, hookimpl, load
from star_core.messages.arrays import Table

MISSION = Path(__file__).parents[3] / "missions" / "first_flight.yaml"


class Tables:
    """Makes every table of a flight again, which checks it."""

    def __init__(self) -> None:
        self.kinds: set[str] = set()

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        for made in tables(tick):
            columns = {item.name: getattr(made, item.name) for item in fields(made)}
            checked = type(made)(**columns)
            for name, value in columns.items():
                assert getattr(checked, name) is value, f"{type(made).__name__}.{name} was copied"
            self.kinds.add(type(made).__name__)


def tables(value: Any) -> Iterator[Any]:
    if isinstance(value, Table):
        yield value
    if is_dataclass(value):
        for item in fields(value):
            yield from tables(getattr(value, item.name))


def test_tables_that_the_core_makes_are_frozen_and_fit() -> None:
    tables = Tables()
    registry = Registry(tables)
    fly(load(MISSION, registry), registry)
    assert {"Estimate", "Goals", "Health", "Plan", "Setpoint", "Telemetry", "Truth"} <= tables.kinds
