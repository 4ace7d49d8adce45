"""How quick the planner `visibility` is beside the naive way, and whether its paths are as short.

The world is 50 polygons of 10 corners each, standing apart, seldom convex. The naive way joins all
corners of the same offset outlines that see each other, asks shapely (vectorised, prepared) about
every pair, and searches with scipy's Dijkstra. Both sides offset the outlines with a clearance and
a margin, and both answer the same queries, in turns, in this process. A build is all that is slow
when the planner is made: the outlines with and without margin, and the graph. Ratios are medians,
below 1 where ours is quicker; times stand beside them for orientation only. In the `mixed` figures
the same polygons stand and hang at heights of their own, which the naive way
knows nothing of. A portion is what the planner does in one tick at most.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from time import perf_counter
from typing import Any

import numpy as np
import shapely
from printed import command_line, show
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from star_core import Agent, Array, Fence, Obstacle, Scene, World
from star_core.toolkit import footprint
from star_visibility.network import Work
from star_visibility.planner import WORK
from star_visibility.routes import Routes

POLYGONS, CORNERS = 50, 10
SPACING = 2.2  # m from one polygon to the next, so that none touch when they are offset
CLEARANCE, MARGIN = 0.2, 0.05
HEIGHT = 1.0  # m, at which all agents fly; the polygons are as high as the room
HALF = 9.0  # m, half the room
ENTERS = 1e-8  # m, deeper than this a stretch enters an obstacle
ROUNDS, BUILDS, QUERIES = 3, 5, 300  # in a round one naive build, then so many of ours
GOALS = {"build_ms": 100.0, "query_ms": 2.0, "max_length_difference_m": 1e-6}


class Naive:
    """Every corner and every stretch between two that see each other."""

    def __init__(self, world: World) -> None:
        ground = footprint(world.obstacles, HEIGHT, HEIGHT, CLEARANCE + MARGIN)
        self.corner = np.unique(shapely.get_coordinates(ground), axis=0)
        self._inside = ground.buffer(-ENTERS, join_style="mitre")
        shapely.prepare(self._inside)
        first, second = np.triu_indices(len(self.corner), 1)
        self._first, self._second, self._length = self._stretches(first, second, self.corner)

    def length(self, start: Array, goal: Array) -> float:
        """Length of the shortest path, m; infinity if there is none."""
        n = len(self.corner)
        point = np.vstack([self.corner, start, goal])
        first = np.repeat([n, n + 1, n], [n, n, 1])
        second = np.concatenate([np.arange(n), np.arange(n), [n + 1]])
        more = self._stretches(first, second, point)
        rows, columns, length = (
            np.concatenate(pair)
            for pair in zip((self._first, self._second, self._length), more, strict=True)
        )
        net: Any = csr_array((length, (rows, columns)), shape=(n + 2, n + 2))
        return float(dijkstra(net, directed=False, indices=[n])[0, n + 1])

    def _stretches(self, first: Any, second: Any, point: Array) -> tuple[Any, Any, Array]:
        line = np.array(shapely.linestrings(np.stack([point[first], point[second]], axis=1)))
        free = ~shapely.intersects(self._inside, line)
        return first[free], second[free], shapely.length(line[free])


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    options = command_line(__doc__).parse_args()
    show(figures(), as_json=options.json, goals=GOALS)


def figures() -> dict[str, float]:
    """Build and ask both sides; return the figures by name."""
    scene = room(np.random.default_rng(0))
    routes(scene)  # compiled
    builds, naive_builds = [], []
    for _ in range(ROUNDS):
        naive, took = timed(lambda: Naive(scene.world))
        naive_builds.append(took)
        for _ in range(BUILDS):
            ours, took = timed(lambda: routes(scene))
            builds.append(took)
    build, naive_build = float(np.median(builds)), float(np.median(naive_builds))
    times, naive_times, differences = [], [], []
    for start, goal in queries(scene.world):
        way, took = timed(lambda: ours.route(start, goal))  # noqa: B023 -- called at once
        length, naive_took = timed(lambda: naive.length(start[:2], goal[:2]))  # noqa: B023
        times.append(took)
        naive_times.append(naive_took)
        line = np.vstack([start, way])
        differences.append(abs(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) - length))
    return {
        "build_ratio": build / naive_build,
        "query_ratio": float(np.median(np.divide(times, naive_times))),
        "build_ms": build * 1e3,
        "naive_build_ms": naive_build * 1e3,
        "query_ms": float(np.median(times)) * 1e3,
        "query_p99_ms": float(np.quantile(times, 0.99)) * 1e3,
        "naive_query_ms": float(np.median(naive_times)) * 1e3,
        "max_length_difference_m": max(differences),
        "corners": len(naive.corner),
        **mixed(),
    }


def mixed() -> dict[str, Any]:
    """Build and ask where obstacles are of all heights."""
    scene = room(np.random.default_rng(0), mixed=True)
    builds, times, portions, without = list[float](), list[float](), list[float](), 0
    for _ in range(BUILDS):
        finder, seconds = timed(lambda: routes(scene))
        builds.append(seconds)
    random = np.random.default_rng(1)
    while len(times) < QUERIES:
        ends = random.uniform([-HALF, -HALF, 0.3], [HALF, HALF, 1.7], (2, 3))
        way, took = in_portions(finder, *ends)
        if isinstance(way, str) and not way.startswith("no path leads from"):
            continue  # an end is where no agent can be
        without += isinstance(way, str)
        times.append(sum(took))
        portions += took
    return {
        "mixed_heights": len({obstacle.height for obstacle in scene.world.obstacles}),
        "mixed_build_ms": float(np.median(builds)) * 1e3,
        "mixed_query_ms": float(np.median(times)) * 1e3,
        "mixed_query_p99_ms": float(np.quantile(times, 0.99)) * 1e3,
        "mixed_portion_max_ms": max(portions) * 1e3,
        "mixed_without_way": without,
    }


def routes(scene: Scene) -> Routes:
    """All that is slow when the planner is made."""
    return Routes(scene, clearance=CLEARANCE, vertical_clearance=CLEARANCE, margin=MARGIN)


def in_portions(finder: Routes, start: Array, goal: Array) -> tuple[Array | str, list[float]]:
    """A path, or why there is none, and how long each portion of the search took, s."""
    work, took = Work(WORK), list[float]()
    search = finder.search(start, goal, work)
    while True:
        begun = perf_counter()
        try:
            next(search)
        except StopIteration as end:
            return end.value, [*took, perf_counter() - begun]
        took.append(perf_counter() - begun)
        work.left = WORK


def room(random: np.random.Generator, *, mixed: bool = False) -> Scene:
    """A room with polygons on a grid, each a little off its place."""
    columns = math.ceil(math.sqrt(POLYGONS))
    things = []
    for i in range(POLYGONS):
        place = (np.array(divmod(i, columns)) - (columns - 1) / 2) * SPACING
        x, y = place + random.uniform(-0.05, 0.05, 2)
        angle = (np.arange(CORNERS) + random.uniform(0, 0.8, CORNERS)) * math.tau / CORNERS
        reach = random.uniform(0.3, 0.8, CORNERS)
        ring = zip(x + reach * np.cos(angle), y + reach * np.sin(angle), strict=True)
        foot = random.choice([0.0, random.uniform(0.0, 1.5)]) if mixed else 0.0
        top = foot + random.uniform(0.3, 1.5) if mixed else 3.0
        things.append(Obstacle(f"polygon {i}", (tuple(ring),), (foot, top)))
    fence = Fence((-HALF, -HALF, 0.0), (HALF, HALF, 3.0))
    return Scene((Agent("cf1", (0, 0, 0)),), 0.05, World("room", fence, tuple(things)))


def queries(world: World) -> Iterator[tuple[Array, Array]]:
    """Free starts and goals."""
    random = np.random.default_rng(1)
    ground = footprint(world.obstacles, HEIGHT, HEIGHT, CLEARANCE + MARGIN)
    count = 0
    while count < QUERIES:
        ends = np.column_stack([random.uniform(-HALF, HALF, (2, 2)), [HEIGHT, HEIGHT]])
        if not np.any(ground.intersects(shapely.points(ends[:, :2]))):
            count += 1
            yield ends[0], ends[1]


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call returns, and how long it took, s."""
    begun = perf_counter()
    answer = call()
    return answer, perf_counter() - begun


if __name__ == "__main__":
    main()
