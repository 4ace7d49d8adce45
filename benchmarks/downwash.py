"""What downwash does to drones that pass below others, and what the ellipsoid of separations costs.

Half of the agents fly 0.4 m above the others: in ``crossing`` pairs meet head on, in ``overtaking``
the lower agent passes slowly below the upper one. Paths are up to 5 cm apart sideways, as the seed
has it. Separations are a sphere (0.2 m in every direction) or the default ellipsoid (0.2 m, and
0.6 m in height). The firmware's controller flies, by exact estimates: with a Flow deck's drift,
most pairs would miss each other's jets. Without downwash there is no ground effect either. Dips
are of the height of the lower agents, below its mean in the second before they set out.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from printed import command_line

from star_core import Array, Registry, Tick, fly, hookimpl, load
from star_core.discovery import Source

PAIRS = 3  # in a flight
UPPER, LOWER = 1.0, 0.6  # m
WORLD = "star: 1\nname: hall\nfence: {low: [-3, -3, 0], high: [3, 3, 2.5]}\n"
# Along x, m: start and goal of the upper agent and its speed, m/s; then of the lower one.
SCENARIOS = {
    "crossing": ((-1.0, 1.0, 0.4), (1.0, -1.0, 0.4)),
    "overtaking": ((-0.6, 0.6, 0.2), (-1.2, 1.2, 0.35)),
}
REST = 12.0  # s, from the take-off until they set out
AVOIDERS = ("orca", "none")
SEPARATIONS = {"sphere": 0.2, "ellipsoid": 0.6}  # m in height


class Heights:
    """Follows the true heights of the lower agents.

    Attributes:
        before: (N,) rows of each tick before they set out, m.
        after: Of each later tick.
    """

    def __init__(self) -> None:
        self.before: list[Array] = []
        self.after: list[Array] = []

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        if tick.truth is None:
            return
        heights = tick.truth.position[PAIRS:, 2].copy()
        if "goto" in tick.doing:
            self.after.append(heights)
        elif not self.after:
            self.before.append(heights)


def mission(scenario: str, seed: int) -> dict[str, Any]:
    """Return a mission; its file may be JSON."""
    random = np.random.default_rng(seed)
    uppers, lowers = ([f"{kind}{i}" for i in range(PAIRS)] for kind in ("upper", "lower"))
    swarm, moves = {}, []
    legs = zip((uppers, lowers), (UPPER, LOWER), SCENARIOS[scenario], strict=True)
    for names, height, (start, goal, speed) in legs:
        for i, name in enumerate(names):
            y = 1.5 * (i - (PAIRS - 1) / 2) + random.uniform(-0.025, 0.025)
            swarm[name] = {"start": [start, y, 0.0]}
            moves.append({"goto": {"agents": name, "to": [goal, y, height], "speed": speed}})
    climbs = [
        {"takeoff": {"agents": names, "height": height}}
        for names, height in ((uppers, UPPER), (lowers, LOWER))
    ]
    return {
        "star": 1, "name": scenario, "world": "hall.yaml", "swarm": swarm,
        "transport": {"use": "sim", "noise": False, "controller": "pid"},
        "localizer": "flow", "planner": "straight", "avoider": "orca", "collisions": "record",
        "mission": [
            {"parallel": climbs}, {"hold": {"for": REST}}, {"parallel": moves}, {"land": {}},
        ],
    }  # fmt: skip


def flown(path: Path, changes: list[str]) -> dict[str, float]:
    """Fly a mission and return its figures."""
    registry, heights = Registry(), Heights()
    registry.add(heights, Source("benchmark:heights", "0"))
    summary = fly(load(path, registry, changes), registry)
    level = np.mean(heights.before[-20:], axis=0)
    dips = level - np.min(heights.after, axis=0)
    return {
        "completed": float(summary["outcome"] == "completed"),
        "dip_m": float(dips.mean()),
        "worst_dip_m": float(dips.max()),
        "collisions": float(sum(summary["collisions"].values())),
        "closest_m": summary["min_separation_m"],
        "corrected": float(summary["corrected"]["separation"]),
        "flight_time_s": summary["flight_time_s"],
    }


def figures(flights: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the means over flights; of worst dips the greatest, of distances the least."""
    means = {name: float(np.mean([flight[name] for flight in flights])) for name in flights[0]}
    worst_dip = max(flight["worst_dip_m"] for flight in flights)
    closest = min(flight["closest_m"] for flight in flights)
    return means | {"worst_dip_m": worst_dip, "closest_m": closest}


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    arguments = command_line(__doc__, seeds=10, first=0).parse_args()
    table = {}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "hall.yaml").write_text(WORLD)
        seeds = range(arguments.first, arguments.first + arguments.seeds)
        for scenario, avoider, shape, air in product(
            SCENARIOS, AVOIDERS, SEPARATIONS, (False, True)
        ):
            changes = [
                f"avoider={avoider}",
                "limits.uncertainty_margin=0",
                f"limits.vertical_separation={SEPARATIONS[shape]}",
                f"transport.aerodynamics={str(air).lower()}",
            ]
            flights = []
            for seed in seeds:
                path = Path(folder) / f"{scenario}.yaml"
                path.write_text(json.dumps(mission(scenario, seed)))
                flights.append(flown(path, changes))
            name = f"{scenario}, {avoider}, {shape}, {'' if air else 'no '}downwash"
            table[name] = figures(flights)
            if not arguments.json:
                print(f"{name:40}", *(f"{k}={v:.3g}" for k, v in table[name].items()), flush=True)
    if arguments.json:
        print(json.dumps(table))


if __name__ == "__main__":
    main()
