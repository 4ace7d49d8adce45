"""How quick the ORCA kernel is beside RVO2 as `pyrvo` binds it, and whether both answer alike.

Random crowds and discs of agents that all change sides are rolled out by pyrvo. At five moments of
each, both sides answer the same ten ticks that follow, in turns, in this process. What is compared
is one answer for the whole swarm: neighbours, half-planes and linear programme. Ratios are medians,
below 1 where ours is quicker; times per tick stand beside them for orientation only. Small swarms
are drawn anew for each round: asked the same again, a processor has learnt all branches of a
hundred agents by heart and is several times as quick as it is in any flight.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from time import perf_counter_ns
from typing import Any, NamedTuple

import numpy as np
from printed import command_line

from star_core import Array
from star_orca.kernel import orca

try:
    import pyrvo
except ImportError:
    print("the peer is missing: pip install --no-deps pyrvo", file=sys.stderr)
    sys.exit(2)

RADIUS, SPEED, HORIZON, NEIGHBOUR_DISTANCE, MOST, PERIOD = 0.15, 1.0, 2.0, 2.0, 10, 0.1
DENSITY = 1.0  # agents per m²
MOMENTS = (0.1, 0.275, 0.45, 0.625, 0.8)  # as a share of the time that the longest way takes
TICKS = 10  # one after the other, with the wishes held
DRAWN = 4_000  # agents, in as many swarms as that makes, but one at least
ROUNDS = 3  # of one that is as large
ALIKE = 1e-3  # m/s; pyrvo computes in float32


class State(NamedTuple):
    """A swarm at one moment: (N, 3) positions, velocities and wishes, z = 0."""

    position: Array
    velocity: Array
    wish: Array


class Figures(NamedTuple):
    """What was measured in one scenario at one size."""

    ratio: float
    ratio_with_set_get: float
    us: float
    us_an_agent: float
    pyrvo_us: float
    pyrvo_with_set_get_us: float
    share_within_1e3: float
    max_difference: float


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    parser = command_line(__doc__)
    parser.add_argument(
        "--agents", type=int, nargs="+", default=[10, 100, 1000], help="10000 take minutes"
    )
    arguments = parser.parse_args()
    named = {}
    if not arguments.json:
        print(f"{'':12}" + "".join(f"{name:>24}" for name in Figures._fields))
    for n in arguments.agents:
        for scenario in ("crowd", "disc"):
            figures = measure(scenario, n)
            for name, value in figures._asdict().items():
                named[f"{scenario}_{n}_{name}"] = value
            if not arguments.json:
                cells = "".join(f"{value:24.3g}" for value in figures)
                print(f"{scenario} {n}".ljust(12) + cells, flush=True)
    if arguments.json:
        print(json.dumps(named))


def moments(scenario: str, n: int, seed: int) -> Iterator[State]:
    """Yield the states at `MOMENTS` of a rollout by pyrvo."""
    random = np.random.default_rng(seed)
    position, goal = crowd(n, random) if scenario == "crowd" else disc(n, random)
    velocity = np.zeros((n, 3))
    longest = np.linalg.norm(goal - position, axis=1).max() / (SPEED * PERIOD)
    moments = {int(longest * moment) for moment in MOMENTS}
    simulator = pyrvo_with(State(position, velocity, velocity))
    for step in range(max(moments) + 1):
        way = goal - position
        length = np.linalg.norm(way, axis=1, keepdims=True)
        wish = way * SPEED / np.maximum(length, SPEED)
        if step in moments:
            yield State(position, velocity, wish)
        give(simulator, State(position, velocity, wish))
        simulator.do_step()
        position, velocity = flat(simulator.get_agent_position, n), answers(simulator, n)


def crowd(n: int, random: np.random.Generator) -> tuple[Array, Array]:
    """Starts and goals of agents that cross a square at random, (N, 3) m each."""
    half = math.sqrt(n / DENSITY) / 2
    start, goal = random.uniform(-half, half, (2, n, 3)) * [1, 1, 0]
    return start, goal


def disc(n: int, random: np.random.Generator) -> tuple[Array, Array]:
    """Starts and goals of agents that fill a disc and change sides, (N, 3) m each.

    They stand on a sunflower spiral, off by 2 cm at random so that nothing is symmetric.
    """
    k = np.arange(n) + 0.5
    angle, distance = k * math.pi * (3 - math.sqrt(5)), np.sqrt(k / (math.pi * DENSITY))
    start = np.stack([distance * np.cos(angle), distance * np.sin(angle), np.zeros(n)], axis=1)
    start[:, :2] += random.normal(0, 0.02, (n, 2))
    return start, -start


def measure(scenario: str, n: int) -> Figures:
    """Time both sides and compare what they answer."""
    ours, peer, around, differences = [], [], [], []
    seeds = range(max(1, DRAWN // n))
    rounds = 1 if len(seeds) > 1 else ROUNDS
    for state in (state for seed in seeds for state in moments(scenario, n, seed)):
        simulator = pyrvo_with(state)
        ticks = [state, *following(simulator, state)]
        questions = [for_ours(tick) for tick in ticks[:-1]]
        for arguments, after in zip(questions, ticks[1:], strict=True):
            differences.append(np.linalg.norm(orca(*arguments) - after.velocity, axis=1))
        for _ in range(rounds):
            orca(*questions[0])  # each side answers once unasked, so that neither comes in cold
            start = perf_counter_ns()
            for arguments in questions:
                orca(*arguments)
            ours.append(since(start))

            simulator.do_step()
            give(simulator, state)
            start = perf_counter_ns()
            for _ in questions:
                simulator.do_step()
            peer.append(since(start))

            start = perf_counter_ns()
            for tick in ticks[:-1]:
                give(simulator, tick)
                simulator.do_step()
                answers(simulator, n)
            around.append(since(start))
    difference = np.sort(np.concatenate(differences))
    best = difference[: math.ceil(0.999 * len(difference))]
    return Figures(
        ratio=float(np.median(np.divide(ours, peer))),
        ratio_with_set_get=float(np.median(np.divide(ours, around))),
        us=float(np.median(ours)),
        us_an_agent=float(np.median(ours)) / n,
        pyrvo_us=float(np.median(peer)),
        pyrvo_with_set_get_us=float(np.median(around)),
        share_within_1e3=float((difference <= ALIKE).mean()),
        max_difference=float(best[-1]),
    )


def following(simulator: Any, state: State) -> Iterator[State]:
    """Yield the states of the ticks that follow `state`, its wishes held."""
    n = len(state.position)
    for _ in range(TICKS):
        simulator.do_step()
        position = flat(simulator.get_agent_position, n)
        yield State(position, answers(simulator, n), state.wish)


def since(start: int) -> float:
    """Time per tick since `start`, us."""
    return (perf_counter_ns() - start) / TICKS / 1e3


def for_ours(state: State) -> tuple[Any, ...]:
    """The kernel's arguments: ORCA as published, all agents avoiding."""
    n = len(state.position)
    radius, speed, avoids = np.full(n, RADIUS), np.full(n, SPEED), np.ones(n, np.bool_)
    fence, rows, heights = np.array([-math.inf] * 2 + [math.inf] * 2), np.zeros(2, int), np.zeros(0)
    nothing_else = (
        np.full((n, 2), math.nan),
        np.zeros(n),
        fence,
        None,
        rows,
        heights,
        HORIZON,
        RADIUS,
        False,
    )
    limits = (HORIZON, NEIGHBOUR_DISTANCE, MOST, math.inf, PERIOD, 0.0)
    return (*state, radius, np.zeros(n), speed, avoids, *nothing_else, *limits)


def pyrvo_with(state: State) -> Any:
    """A pyrvo simulator with the agents of `state`."""
    simulator = pyrvo.RVOSimulator(
        PERIOD, NEIGHBOUR_DISTANCE, MOST, HORIZON, HORIZON, RADIUS, SPEED
    )
    for x, y, _ in state.position.tolist():
        simulator.add_agent((x, y))
    give(simulator, state)
    return simulator


def give(simulator: Any, state: State) -> None:
    """Set position, velocity and wish of every agent, as the bindings allow: one by one."""
    for i, (position, velocity, wish) in enumerate(zip(*(t.tolist() for t in state), strict=True)):
        simulator.set_agent_position(i, tuple(position[:2]))
        simulator.set_agent_velocity(i, tuple(velocity[:2]))
        simulator.set_agent_pref_velocity(i, tuple(wish[:2]))


def answers(simulator: Any, n: int) -> Array:
    """The velocity of every agent, (N, 3) m/s."""
    return flat(simulator.get_agent_velocity, n)


def flat(get: Any, n: int) -> Array:
    """What `get` says of every agent, (N, 3), with z = 0."""
    return np.array([(vector.x, vector.y, 0.0) for vector in map(get, range(n))])


if __name__ == "__main__":
    main()
