"""Hashes of whole flights, to show that a change leaves every flight the same to the last bit.

``python benchmarks/flight_bits.py`` flies some missions in the simulator and prints hashes of each:
of every table of every tick, ground truth included, and of the summary without its times. Compare
those before a change with those after it:

    python benchmarks/flight_bits.py > before.txt
    python benchmarks/flight_bits.py | diff before.txt -
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from tick import write

from star_core import Goals, Registry, Setpoint, Tick, fly, hookimpl, load

MISSIONS = Path(__file__).parents[1] / "missions"
NAMES = (
    "first_flight", "around", "paths", "formation", "search_flow", "safety", "handover",
    "trajectory", "each_own_pace", "until_low", "paper_box", "search",
)  # fmt: skip
VARIANTS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "exact": ("first_flight", ("limits.uncertainty_margin=0",)),
    "voronoi": ("around", ("avoider=voronoi",)),
    "potential": ("formation", ("avoider=potential",)),
    "seed": ("first_flight", ("seed=8",)),
}
AGENTS = 160  # of the mission of benchmarks/tick.py
TIMES = {
    "wall_time_s", "realtime_factor", "compute_us", "compute_s", "slow_ticks", "late_ticks",
    "latest_tick_s",
}  # fmt: skip
"""Entries of the summary that are measured by the computer's clock."""

TRAJECTORY = {"position", "acceleration", "yaw_rate"}
"""Columns of goals and setpoints that count only where an agent follows a trajectory."""


class Bits:
    """Hashes every tick of a flight."""

    def __init__(self) -> None:
        self.ticks = hashlib.sha256()

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self._add(
            {f.name: getattr(tick, f.name) for f in dataclasses.fields(tick) if f.name != "timing"}
        )

    def _add(self, value: Any) -> None:
        if isinstance(value, np.ndarray):
            self.ticks.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
        elif dataclasses.is_dataclass(value):
            columns = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
            optional = TRAJECTORY if isinstance(value, Goals | Setpoint) else {"heights"}
            self._add({k: v for k, v in columns.items() if v is not None or k not in optional})
        elif isinstance(value, Mapping):
            for key, entry in value.items():
                self.ticks.update(str(key).encode())
                self._add(entry)
        elif isinstance(value, tuple | list):
            for entry in value:
                self._add(entry)
        else:
            self.ticks.update(repr(value).encode())


def flight(path: Path, overrides: tuple[str, ...] = ()) -> str:
    """Return a line about a flight: its outcome, and the hashes of its ticks and its summary."""
    bits = Bits()
    registry = Registry(bits)
    summary = fly(load(path, registry, list(overrides)), registry)
    rest = {key: value for key, value in summary.items() if key not in TIMES}
    text = json.dumps(rest, sort_keys=True, default=str).replace(str(path.parent), "")
    end = hashlib.sha256(text.encode()).hexdigest()
    return f"{summary['outcome']:10}{bits.ticks.hexdigest()[:16]} {end[:16]}"


def main() -> None:
    """Print the hashes."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--missions", nargs="+", default=[*NAMES, *VARIANTS, "thousand"])
    for name in options.parse_args().missions:
        if name == "thousand":
            with TemporaryDirectory() as folder:
                line = flight(write(Path(folder), AGENTS))
        else:
            mission, overrides = VARIANTS.get(name, (name, ()))
            line = flight(MISSIONS / f"{mission}.yaml", overrides)
        print(f"{name:28}{line}", flush=True)


if __name__ == "__main__":
    main()
