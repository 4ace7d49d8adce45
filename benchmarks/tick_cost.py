"""Processor time of a tick by the number of drones, and over that of a fixed loop in the same run.

``python benchmarks/tick_cost.py`` prints a table, with ``--json`` one JSON object. The same flight
is flown several times; it is the same to the last bit each time, so of every tick the least time
counts, and the figure is the mean of these. Other processes hardly change it. All safeguards are
at their defaults. Three drones fly ``missions/first_flight.yaml`` in the simulator's default
world, more fly the mission of ``benchmarks/tick.py``. Ticks are not recorded.

With ``--step`` it prints instead what `step` of a flight costs that a program steps, over the tick
in it: both are measured in the same flights of the demo.

The loop is a hundred times the same small work of numpy and Python; between two computers, or two
loads of one, the ratio of a tick to it changes less than the time.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import thread_time_ns
from typing import Final

import numpy as np
from printed import command_line, show
from tick import write

from star_core import Registry, fly, load, open_flight
from star_core.tick import ControlLoop, MissionStatus

FLIGHTS: Final = {3: 10, 120: 4, 1000: 2}
"""Number of flights by the number of drones."""

DEMO: Final = Path(__file__).parents[1] / "missions" / "first_flight.yaml"
ROUNDS = 200  # of the fixed loop, between two flights


class TickTimes:
    """Measures every tick while it is used as a context."""

    def __init__(self) -> None:
        self.times: list[int] = []  # ns
        self._tick = ControlLoop.tick

    def __enter__(self) -> list[int]:
        original, times = self._tick, self.times

        def tick(self: ControlLoop) -> MissionStatus:
            begun = thread_time_ns()
            status = original(self)
            times.append(thread_time_ns() - begun)
            return status

        ControlLoop.tick = tick  # type: ignore[method-assign]
        return times

    def __exit__(self, *_error: object) -> None:
        ControlLoop.tick = self._tick  # type: ignore[method-assign]


def fixed_loop() -> float:
    """Return the least processor time of the fixed loop, us."""
    ramp, identity = np.linspace(-1.0, 1.0, 9).reshape(3, 3), np.eye(3)
    best = sys.maxsize
    for _ in range(ROUNDS):
        begun = thread_time_ns()
        total = 0.0
        for number in range(100):
            total += float(np.sqrt(np.where(ramp > 0.0, ramp, identity)).sum()) * number
        best = min(best, thread_time_ns() - begun)
    return best / 1000


def measure(agents: int, flights: int) -> dict[str, float]:
    """Return the figures of a number of drones, by name.

    Raises:
        SystemExit: A flight did not complete, or differs from the first in its number of ticks.
    """
    registry, times, loop = Registry(), [], sys.float_info.max
    with TemporaryDirectory() as folder:
        path = DEMO if agents == 3 else write(Path(folder), agents)  # noqa: PLR2004 -- the demo's
        mission = load(path, registry)
        for _ in range(flights):
            loop = min(loop, fixed_loop())
            with TickTimes() as ticks:
                summary = fly(mission, registry)
            if summary["outcome"] != "completed":
                sys.exit(f"{summary['outcome']}: {summary['reason']}")
            times.append(ticks)
    if len({len(ticks) for ticks in times}) > 1:
        sys.exit("the flights differ in their numbers of ticks")
    mean = float(np.array(times).min(axis=0).mean()) / 1000
    return {
        "tick (us)": mean,
        "over the fixed loop": mean / loop,
        "times real time": 1e6 * mission.scene.period / mean,
        "fixed loop (us)": loop,
        "ticks": float(len(times[0])),
    }


def step_over_tick(flights: int) -> dict[str, float]:
    """Return the processor times of `step` and of the tick in it, us, and their ratio."""
    registry, steps, ticks = Registry(), [], []
    mission = load(DEMO, registry)
    for _ in range(flights):
        times: list[int] = []
        with open_flight(mission, registry, steps=True) as flight, TickTimes() as inner:
            while not flight.over:
                begun = thread_time_ns()
                flight.step()
                times.append(thread_time_ns() - begun)
        steps.append(times)
        ticks.append(inner)
    step, tick = (float(np.array(times).min(axis=0).mean()) / 1000 for times in (steps, ticks))
    return {"step (us)": step, "tick (us)": tick, "step over tick": step / tick}


def main() -> None:
    """Print the figures."""
    parser = command_line(__doc__)
    parser.add_argument("--agents", type=int, nargs="+", default=[*FLIGHTS], help="%(default)s")
    parser.add_argument("--flights", type=int, help="of each number of drones")
    parser.add_argument("--step", action="store_true", help="a step over the tick in it")
    options = parser.parse_args()
    if options.step:
        show(step_over_tick(options.flights or FLIGHTS[3]), as_json=options.json)
        return
    figures = {}
    for agents in options.agents:
        figures[agents] = measure(agents, options.flights or FLIGHTS.get(agents, 4))
        if not options.json:
            print(f"{agents} drones")
            show(figures[agents], as_json=False)
    if options.json:
        print(json.dumps(figures))


if __name__ == "__main__":
    main()
