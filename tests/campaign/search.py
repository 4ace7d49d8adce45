"""Whether three scouts find every target of worlds they have not seen, and how long that takes.

Each world is a hall of 6 m by 6 m with five polygons, five targets on the floor and nine landmarks
of two tags, drawn from its seed. Three simulated drones that drift, with cameras that find tags
geometrically, search it with `search` until the area is covered, whatever is found, within the
time-out that the verb derives. The peer is the lower bound of any search: the area, over the swath,
the speed and the number of scouts. Times are of the mission: no machine makes them shorter.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from itertools import count, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from shapely import Point, Polygon, union_all

from star_core import Registry, fly, load
from star_search.area import swaths
from star_search.search_space import SWATH_FACTOR

PATTERNS = ("sweep", "frontier")
WORLDS = 40
HALF = 3.0  # m, half the hall
POLYGONS, CORNERS, TARGETS = 5, 6, 5
REACH = (0.25, 0.55)  # m, from a polygon's middle to its corners
LANDMARKS = (-2.1, 0.0, 2.1)  # m, about which they lie, in x and in y
APART = 0.7  # m between polygons, so that drones pass between them
CLEAR = 0.2  # m from a tag's middle to polygons and the fence
CLEARANCE = 0.3  # m that scouts keep to polygons: between landmarks they are up to 0.3 m off
UNCERTAINTY_MARGIN = 2.0  # standard deviations of their positions by which agents are larger
HEIGHT, SPEED = 0.8, 0.3
STARTS = ((-0.8, -2.6), (0.0, -2.6), (0.8, -2.6))
SHARE_GOAL = 0.95


class Flight(NamedTuple):
    """One search.

    Attributes:
        seed: Of its world.
        found: Targets found.
        last_s: When the last of those was found, from the beginning of the search, s.
        search_s: How long the search took, s.
        outcome: Of the mission.
        hits: Collisions.
        bound_s: The least time in which the area can be seen, s.
    """

    seed: int
    found: int
    last_s: float
    search_s: float
    outcome: str
    hits: int
    bound_s: float


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    parser.add_argument("--worlds", type=int, default=WORLDS, help="how many; default %(default)s")
    parser.add_argument("--pattern", choices=PATTERNS, action="append", help="default: each")
    parser.add_argument("--clearance", type=float, default=CLEARANCE, help="m; %(default)s")
    parser.add_argument(
        "--uncertainty-margin", type=float, default=UNCERTAINTY_MARGIN, help="%(default)s"
    )
    arguments = parser.parse_args()
    registry, room = Registry(), (arguments.clearance, arguments.uncertainty_margin)
    table: dict[str, float] = {}
    for pattern in arguments.pattern or PATTERNS:
        flights = []
        for seed in range(arguments.worlds):
            flights.append(searched(seed, pattern, room, registry))
            if not arguments.json:
                print(pattern, *flights[-1]._asdict().items(), flush=True)
        table |= {f"{pattern}_{name}": value for name, value in figures(flights).items()}
    if arguments.json:
        print(json.dumps(table))
        return
    for name, value in table.items():
        goal = f"   (goal: at least {SHARE_GOAL:g})" if name.endswith("all_found") else ""
        print(f"{name:32} {value:10.4g}{goal}")


def figures(flights: list[Flight]) -> dict[str, float]:
    """Sum up the flights with one pattern."""
    whole = [f for f in flights if f.found == TARGETS and f.outcome == "completed"]
    return {
        "all_found": len(whole) / len(flights),
        "completed": sum(f.outcome == "completed" for f in flights) / len(flights),
        "found_share": sum(f.found for f in flights) / (TARGETS * len(flights)),
        "collisions": sum(f.hits for f in flights),
        "search_s": float(np.median([f.search_s for f in flights])),
        "search_most_s": max(f.search_s for f in flights),
        "last_found_s": float(np.median([f.last_s for f in flights])),
        "lower_bound_s": float(np.median([f.bound_s for f in flights])),
        "search_over_bound": float(np.median([f.search_s / f.bound_s for f in flights])),
    }


def searched(seed: int, pattern: str, room: tuple[float, float], registry: Registry) -> Flight:
    """Search one world; `room` is the clearance, m, and the uncertainty margin."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        drawn = world(seed)
        (place / "world.yaml").write_text(json.dumps(drawn))
        (place / "mission.yaml").write_text(json.dumps(mission(seed, pattern, *room)))
        loaded = load(place / "mission.yaml", registry)
        summary = fly(loaded, registry)
    step = next(step for step in summary["steps"] if step["verb"] == "search")
    times = [event["time"] for event in summary["events"] if event["kind"] == "found"]
    width = SWATH_FACTOR * min(wide for _, wide in swaths(loaded.scene, (0, 1, 2), HEIGHT, SPEED))
    free = (2 * HALF) ** 2 - sum(Polygon(o["polygon"]).area for o in drawn["obstacles"].values())
    return Flight(
        seed,
        int(summary["targets"]["found"]),
        max(times, default=math.nan) - step["begun_s"],
        (step["ended_s"] or math.nan) - step["begun_s"],
        summary["outcome"],
        sum(summary["collisions"].values()),
        free / width / SPEED / len(STARTS),
    )


def mission(seed: int, pattern: str, clearance: float, uncertainty_margin: float) -> dict[str, Any]:
    """Return a search as a mission has it."""
    return {
        "star": 1,
        "name": f"search-{pattern}-{seed}",
        "world": "world.yaml",
        "seed": seed,
        "swarm": {
            f"cf{i + 1}": {"start": [x, y, 0.0], "yaw_deg": 90, "camera": "aideck"}
            for i, (x, y) in enumerate(STARTS)
        },
        "transport": {
            "use": "sim",
            "profile": "ideal",
            "controller": "ideal",
            "camera": {"mode": "geometric"},
        },
        "localizer": {"use": "apriltag", "processes": 0},
        "planner": {"use": "visibility", "clearance": clearance},
        "avoider": {
            "use": "orca",
            "radius": 0.2,
            "uncertainty_margin": uncertainty_margin,
            "clearance": clearance,
        },
        "mission": [
            {"takeoff": {"height": HEIGHT}},
            {"search": {"pattern": pattern, "height": HEIGHT, "speed": SPEED, "targets": 0}},
            {"land": {}},
        ],
    }


def world(seed: int) -> dict[str, Any]:
    """Draw a hall, as a world file has it."""
    random = np.random.default_rng([seed, 20])
    things: list[Polygon] = []
    taken = union_all([Point(start).buffer(APART) for start in STARTS])
    while len(things) < POLYGONS:
        angle = (np.arange(CORNERS) + random.uniform(0, 0.8, CORNERS)) * math.tau / CORNERS
        reach = random.uniform(*REACH, CORNERS)
        middle = random.uniform(-HALF + 0.6, HALF - 0.6, 2)
        ring = middle + reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        thing = Polygon(ring)
        if thing.is_valid and thing.distance(taken) > 0 and _apart(thing, things):
            things.append(thing)
    tags = count()
    sheets: list[Point] = []
    for x, y in product(LANDMARKS, LANDMARKS):
        sheets.append(_spot(random, things, sheets, 0.4, np.array([x, y])))
    landmarks = {
        f"landmark {i}": {"tags": [next(tags), next(tags)], "at": [spot.x, spot.y, 0.0]}
        for i, spot in enumerate(sheets)
    }
    for _ in range(TARGETS):
        sheets.append(_spot(random, things, sheets, 0.4))
    targets = {
        f"target {i}": {
            "tags": [next(tags)],
            "at": [spot.x, spot.y, 0.0],
            "yaw_deg": float(random.uniform(0, 360)),
        }
        for i, spot in enumerate(sheets[-TARGETS:])
    }
    return {
        "star": 1,
        "name": f"hall-{seed}",
        "fence": {"low": [-HALF, -HALF, 0.0], "high": [HALF, HALF, 2.2]},
        "obstacles": {
            f"polygon {i}": {
                "polygon": [list(corner) for corner in thing.exterior.coords[:-1]],
                "height": [0.0, 2.2],
            }
            for i, thing in enumerate(things)
        },
        "landmarks": landmarks,
        "targets": targets,
    }


def _apart(thing: Polygon, things: list[Polygon]) -> bool:
    return all(thing.distance(other) >= APART for other in things)


def _spot(
    random: np.random.Generator,
    things: list[Polygon],
    sheets: list[Point],
    apart: float,
    about: np.ndarray | None = None,
) -> Point:
    """A place on the floor for a sheet: about a place within 0.5 m, or anywhere."""
    while True:
        reach = HALF - CLEAR if about is None else 0.5
        x, y = random.uniform(-reach, reach, 2) + (0.0 if about is None else about)
        spot = Point(x, y)
        if all(spot.distance(thing) >= CLEAR for thing in things) and all(
            spot.distance(other) >= apart for other in sheets
        ):
            return spot


if __name__ == "__main__":
    main()
