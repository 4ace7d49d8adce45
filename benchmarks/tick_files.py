"""The source files that one tick of a mission visits, with the functions called in each.

Run as ``python benchmarks/tick_files.py [MISSION] [--check] [--json]``; with ``--check`` they are
those of `star check`, without what only plugins call and import. Generated code, such as the
constructors of tables, has no file and is not counted; kernels count by the file of their source.
The last line has the totals; bookkeeping are the calls that freeze, time, guard or check.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Final

from printed import command_line

from star_core import Registry, fly, load
from star_core.formats import check_file
from star_core.tick import ControlLoop, MissionStatus

ROOT: Final = Path(__file__).parents[1]
TICKS: Final = range(60, 65)
"""Of the flight: agents are in the air, nothing begins or ends. The recorder sends what it has
gathered in one of them, at the wall's clock: that with the fewest calls counts."""
BOOKKEEPING: Final = {"star_core/messages/arrays.py"} | {
    f"star_core/plugin_support/{name}.py"
    for name in ("compute_time", "guard", "outputs", "tick_timing", "watchdog")
}
"""Files whose functions freeze, time, guard or check."""
OTHERS: Final = ("some", "every", "none")
"""Functions in them that do not: they read a mask, or return an empty table."""

Calls = dict[str, Counter[str]]


def calls_of_one_tick(mission: str) -> Calls:
    """Fly a mission; return how often each function was called in one tick, by source file."""
    calls: dict[int, Calls] = {number: defaultdict(Counter) for number in TICKS}
    tick, ticks = ControlLoop.tick, iter(range(sys.maxsize))

    def traced(loop: ControlLoop) -> MissionStatus:
        if (number := next(ticks)) not in TICKS:
            return tick(loop)
        with noted(calls[number]):
            return tick(loop)

    registry = Registry()
    ControlLoop.tick = traced  # type: ignore[method-assign, assignment]
    try:
        with tempfile.TemporaryDirectory() as folder:
            fly(load(mission, registry), registry, folder=folder)
    finally:
        ControlLoop.tick = tick  # type: ignore[method-assign]
    return min(calls.values(), key=lambda files: sum(map(Counter.total, files.values())))


def calls_of_check(mission: str) -> Calls:
    """Check a mission; return how often the core called each function, by source file."""
    calls: Calls = defaultdict(Counter)
    registry = Registry()
    with noted(calls, inside_plugins=False):
        check_file(Path(mission), registry)
    return calls


@contextmanager
def noted(calls: Calls, *, inside_plugins: bool = True) -> Iterator[None]:
    """Count the calls of functions; those that plugins make only if `inside_plugins`."""

    def note(frame: FrameType, event: str, _argument: Any) -> None:
        name = _source(frame)
        if event == "call" and name and (inside_plugins or not _called_by_plugin(frame)):
            calls[name][frame.f_code.co_name] += 1

    sys.setprofile(note)
    try:
        yield
    finally:
        sys.setprofile(None)


def _source(frame: FrameType) -> str:
    """Return the file of a frame, if it is one of STAR's."""
    path = Path(frame.f_code.co_filename)
    ours = path.is_relative_to(ROOT) and ".venv" not in path.parts and path != Path(__file__)
    return str(path.relative_to(ROOT)) if ours else ""


def _called_by_plugin(frame: FrameType) -> bool:
    """Whether a function is called by a plugin, or while a module is imported.

    The format of the mission counts as the core: it makes the check.
    """
    above = frame.f_back
    while above is not None:
        source = _source(above)
        plugin = source.startswith("plugins/") and not source.startswith("plugins/formats/")
        if plugin or "importlib" in above.f_code.co_filename:
            return True
        above = above.f_back
    return False


def main() -> None:
    """Print the files of one tick."""
    arguments = command_line(__doc__)
    arguments.add_argument("mission", nargs="?", default=str(ROOT / "missions/first_flight.yaml"))
    arguments.add_argument("--check", action="store_true")
    options = arguments.parse_args()
    calls = (calls_of_check if options.check else calls_of_one_tick)(options.mission)
    figures = {
        "files": len(calls),
        "core_files": sum(file.startswith("star_core/") for file in calls),
        "calls": sum(count.total() for count in calls.values()),
        "bookkeeping": sum(
            count.total() - sum(count[name] for name in OTHERS)
            for file, count in calls.items()
            if file in BOOKKEEPING
        ),
    }
    if options.json:
        print(json.dumps(figures))
        return
    for file, functions in sorted(calls.items()):
        print(f"{file}: {', '.join(functions)}")
    print(", ".join(f"{name} {value}" for name, value in figures.items()))


if __name__ == "__main__":
    main()
