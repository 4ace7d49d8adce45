"""Closest approaches in flights with every option at its default, located without landmarks.

Five and ten drones fly formations, crossings and searches of about two minutes, located by `flow`,
in the default world of `sim`; then formations six times as wide, crossings there and back of half a
minute, and single ones. Only agents, steps and the world are given. A flight is safe if no two
drones came closer than 0.2 m (ground truth, between centres). ``star check`` is run on every
mission: one with a warning of drift is not expected to be safe. The flights are those of a study of
`star ablate`; an output folder that has some of them is continued.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import statistics
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias

from star_core import Registry
from star_core.commands import run_command
from star_core.formats import check_file
from tests.campaign.faults import upper_bound

SAFE: Final = 0.2  # m
AGENTS: Final = (5, 10)
FIRST_SEED: Final = 1000
HEIGHT: Final = 0.8  # m
COLUMNS: Final = 5
WIDE: Final = 6.0  # m
CODE: Final = "drift-exceeds-separation"
MEASURES: Final = (
    "min_separation_m",
    "collisions.agent_agent",
    "position_nees",
    "position_mse_m2.mean",
    "flight_time_s",
    "corrected",
    "deadlocks",
)


def main() -> int:
    """Fly the missions and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/safe-defaults"))
    parser.add_argument("--seeds", type=int, default=100, help="of each mission: %(default)s")
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="seed: %(default)s")
    parser.add_argument("--workers", default="2", help="parallel flights: %(default)s")
    parser.add_argument("--missions", nargs="+", choices=[*missions()], default=[*missions()])
    parser.add_argument("--exact", action="store_true", help="fly without margins, too")
    arguments = parser.parse_args()
    files = arguments.out / "missions"
    files.mkdir(parents=True, exist_ok=True)
    selection = {
        name: mission for name, mission in missions().items() if name in arguments.missions
    }
    for name, (mission, half) in selection.items():
        (files / f"{name}.yaml").write_text(json.dumps(mission))
        (files / f"room-{half:g}.yaml").write_text(json.dumps(room(half)))
    options: dict[str, Any] = {"default": {}}
    if arguments.exact:
        options["uncertainty_margin 0"] = {"limits.uncertainty_margin": 0}
    study = {
        "star": 1,
        "name": "safe-defaults",
        "missions": [f"missions/{name}.yaml" for name in selection],
        "seeds": {"first": arguments.first, "count": arguments.seeds},
        "factors": {"options": options},
        "measures": [*MEASURES],
    }
    (arguments.out / "study.yaml").write_text(json.dumps(study))
    flown = arguments.out / "flown"
    study_file = str(arguments.out / "study.yaml")
    flags = ["--out", str(flown), "--quiet", "--workers", arguments.workers]
    run_command("ablate", [study_file, *flags], Registry())
    with (flown / "results.csv").open(encoding="utf-8", newline="") as file:
        print("\n".join(table([*csv.DictReader(file)], files)))
    return 0


def missions() -> Mapping[str, tuple[dict[str, Any], float]]:
    """Return each mission, and half the width of its room, m, by name."""
    by_name: dict[str, tuple[dict[str, Any], float]] = {}
    for n in AGENTS:
        for name, (starts, steps), half in (
            ("formation", formation(n), 3.0),
            ("crossing", crossing(n, 5), 3.0),
            ("search", search(n), 4.0),
            ("wide-formation", wide_formation(n), 14.0),
            ("short-crossing", crossing(n, 1), 3.0),
            ("single-crossing", crossing(n, 0), 3.0),
        ):
            sees = {"camera": "aideck"} if name == "search" else {}  # for the width of the lanes
            by_name[f"{name}-{n}"] = (
                {
                    "star": 1,
                    "name": f"{name}-{n}",
                    "world": f"room-{half:g}.yaml",
                    "swarm": {
                        f"cf{i + 1}": {"start": [*start, 0.0], **sees}
                        for i, start in enumerate(starts)
                    },
                    "transport": {"use": "sim", "camera": {"mode": "off"}} if sees else "sim",
                    "localizer": "flow",
                    "planner": "straight",
                    "avoider": "orca",
                    "mission": [{"takeoff": {"height": HEIGHT}}, *steps, {"land": {}}],
                },
                half,
            )
    return by_name


Steps: TypeAlias = tuple[list[tuple[float, float]], list[dict[str, Any]]]
"""Starts of the agents, x and y in m, and the steps after the take-off."""


def formation(n: int) -> Steps:
    """Return a grid that moves to and fro, with a circle in between."""
    starts = rows(n, 1.0)
    circle = {"shape": "circle", "radius": 1.8, "centre": [0.0, 0.0, HEIGHT], "for": 5.0}
    steps = [{"formation": grid(1.0, -1.5, 1.5)}, {"formation": circle}]
    return starts, [{"repeat": {"times": 4, "steps": steps}}]


def wide_formation(n: int) -> Steps:
    """Return a wide grid that moves to and fro."""
    steps = [{"formation": grid(WIDE, *ends)} for ends in ((-2.0, 2.0), (2.0, -2.0))]
    return rows(n, WIDE), [{"repeat": {"times": 3, "steps": steps}}]


def rows(n: int, spacing: float) -> list[tuple[float, float]]:
    """Return the positions of a grid of five columns, m."""
    return [(spacing * (i % COLUMNS - 2), spacing * (i // COLUMNS - 0.5)) for i in range(n)]


def grid(spacing: float, begin: float, end: float) -> dict[str, Any]:
    """Return a formation that moves from one y to another, m."""
    return {
        "shape": "grid",
        "columns": COLUMNS,
        "spacing": spacing,
        "centre": [0.0, begin, HEIGHT],
        "move": {"to": [0.0, end, HEIGHT], "speed": 0.25},
    }


def crossing(n: int, times: int) -> Steps:
    """Return agents on a circle that change sides, and back some times."""
    angle = [math.tau * i / n for i in range(n)]
    starts = [(round(2.2 * math.cos(a), 3), round(2.2 * math.sin(a), 3)) for a in angle]
    legs = [
        {
            "parallel": [
                {"goto": {"agents": f"cf{i + 1}", "to": [sign * x, sign * y, HEIGHT]}}
                for i, (x, y) in enumerate(starts)
            ]
        }
        for sign in (-1, 1)
    ]
    return starts, [{"repeat": {"times": times, "steps": legs}}] if times else legs[:1]


def search(n: int) -> Steps:
    """Return a search of the room, repeated for two minutes."""
    starts = [(round(-3.0 + 6.0 * i / (n - 1), 3), -3.5) for i in range(n)]
    area = {"low": [-3.5, -2.8], "high": [3.5, 3.5]}
    find = {"search": {"height": HEIGHT, "speed": 0.3, "targets": 0, "area": area}}
    return starts, [{"repeat": {"times": 2 * n // min(AGENTS), "steps": [find]}}]


def room(half: float) -> dict[str, Any]:
    """Return a world without obstacles and landmarks."""
    fence = {"low": [-half, -half, 0.0], "high": [half, half, 2.2]}
    return {"star": 1, "name": f"room-{half:g}", "fence": fence}


def table(rows: list[dict[str, str]], files: Path) -> Iterator[str]:
    """Yield the lines of the table."""
    heads = (
        *("mission", "options", "drift warning", "n", "below 0.2 m", "≤ (95 %)", "collisions"),
        *("closest", "median", "NEES", "error RMS", "flight time", "not completed"),
    )
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    registry = Registry()
    for key in dict.fromkeys((row["mission"], row["options"]) for row in rows):
        of = [row for row in rows if (row["mission"], row["options"]) == key]
        apart = [float(row["min_separation_m"] or "nan") for row in of]
        n, bad = len(of), sum(not distance >= SAFE for distance in apart)
        _, warnings = check_file(files / f"{key[0]}.yaml", registry)
        warned = "yes" if any(CODE in line for line in warnings) else "no"
        mean = {
            name: statistics.fmean(float(row[name] or "nan") for row in of)
            for name in ("position_nees", "position_mse_m2.mean", "flight_time_s")
        }
        hit = sum(float(row["collisions.agent_agent"] or 0) > 0 for row in of)
        failed = sum(row["outcome"] != "completed" for row in of)
        yield (
            f"| {key[0]} | {key[1]} | {warned} | {n} | {bad} "
            f"| {100 * upper_bound(bad, n):.1f} % | {hit} "
            f"| {min(apart):.2f} m | {statistics.median(apart):.2f} m "
            f"| {mean['position_nees']:.2f} | {math.sqrt(mean['position_mse_m2.mean']):.2f} m "
            f"| {mean['flight_time_s']:.0f} s | {failed} |"
        )


if __name__ == "__main__":
    raise SystemExit(main())
