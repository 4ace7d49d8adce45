"""The source files that one tick of a mission visits, with the functions called in each.

Run as ``python benchmarks/tick_files.py [MISSION] [--json]``. Generated code, such as the
constructors of tables, has no file and is not counted; kernels count by the file of their source.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from types import FrameType
from typing import Any, Final

from star_core import Registry, fly, load
from star_core.tick import ControlLoop, MissionStatus

ROOT: Final = Path(__file__).parents[1]
TICK: Final = 60  # of the flight: agents are in the air, nothing begins or ends

Calls = dict[str, Counter[str]]


def calls_of_one_tick(mission: str) -> Calls:
    """Fly a mission; return how often each function was called in one tick, by source file."""
    calls: Calls = defaultdict(Counter)
    tick, ticks = ControlLoop.tick, iter(range(sys.maxsize))

    def note(frame: FrameType, event: str, _argument: Any) -> None:
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(ROOT) and ".venv" not in path.parts:
            calls[str(path.relative_to(ROOT))][frame.f_code.co_name] += 1

    def traced(loop: ControlLoop) -> MissionStatus:
        if next(ticks) != TICK:
            return tick(loop)
        sys.setprofile(note)
        try:
            return tick(loop)
        finally:
            sys.setprofile(None)

    registry = Registry()
    ControlLoop.tick = traced  # type: ignore[method-assign, assignment]
    try:
        with tempfile.TemporaryDirectory() as folder:
            fly(load(mission, registry), registry, folder=folder)
    finally:
        ControlLoop.tick = tick  # type: ignore[method-assign]
    calls.pop(str(Path(__file__).relative_to(ROOT)), None)
    return calls


def main() -> None:
    """Print the files of one tick."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("mission", nargs="?", default=str(ROOT / "missions/first_flight.yaml"))
    arguments.add_argument("--json", action="store_true")
    given = arguments.parse_args()
    calls = calls_of_one_tick(given.mission)
    figures = {
        "files": len(calls),
        "core_files": sum(file.startswith("star_core/") for file in calls),
        "calls": sum(count.total() for count in calls.values()),
    }
    if given.json:
        print(json.dumps(figures))
        return
    for file, functions in sorted(calls.items()):
        print(f"{file}: {', '.join(functions)}")
    print(", ".join(f"{name} {value}" for name, value in figures.items()))


if __name__ == "__main__":
    main()
