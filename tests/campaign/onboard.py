"""Flights by Lighthouse, Loco and received poses: errors of positions, and what a loss causes.

``make onboard`` prints the table of docs/lighthouse.md. Flights begin with seed 1000.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import numpy as np

from star_core import Registry, Tick, hookimpl, load
from star_core.toolkit import fill_defaults
from star_fleet.conditions import Condition, with_receivers
from star_sim import OPTIONS, simulator_arguments
from tests.campaign.mocap import Accuracy, _silent, accuracy, flown
from tests.campaign.mocap_fleet import ON_FLOOR, Flown, watched
from tests.end_to_end.virtual_air import Air
from tests.plugins.transports.star_radio.virtual import virtual

Holds: TypeAlias = Callable[[int], bool]
SEED = 1000
MISSIONS = Path(__file__).parents[2] / "missions"
LIGHTHOUSE = MISSIONS / "lighthouse.yaml"
LOCO = MISSIONS / "loco.yaml"
POSES = ("transport.onboard.system=poses", "localizer.system=poses")
NO_FLOW_DECK = ("transport.onboard.flow_deck=false",)
SYSTEMS: Mapping[str, tuple[Path, tuple[str, ...]]] = {
    "lighthouse": (LIGHTHOUSE, ()),
    "loco": (LOCO, ()),
    "poses": (LIGHTHOUSE, POSES),
    "lighthouse, no Flow deck": (LIGHTHOUSE, NO_FLOW_DECK),
    "loco, no Flow deck": (LOCO, NO_FLOW_DECK),
    "poses, no Flow deck": (LIGHTHOUSE, (*POSES, *NO_FLOW_DECK)),
}
BEGINS = 3.5  # s, of a loss: in flight
ACCURATE = 0.08  # m
NEAR = 0.4  # m


def of_system(seed: int, name: str) -> Accuracy:
    """Fly a mission by a system, and return its figures."""
    path, assignments = SYSTEMS[name]
    return accuracy(seed, assignments, path)


def never_received(seed: int, mission: Path = LIGHTHOUSE, assignments: Sequence[str] = ()) -> bool:
    """Whether no agent takes off while one of them receives no system."""
    fault = {"component": "positioning", "mode": "off", "agents": "cf2"}
    flight = flown(mission, seed, assignments, [fault])
    return not flight.completed and flight.highest < 0.05


def lost(seed: int, mission: Path = LIGHTHOUSE, assignments: Sequence[str] = ()) -> bool:
    """Whether an agent that receives nothing from 3.5 s on begins to land before it is 0.5 m off.

    Without a Flow deck it drifts from then on: nothing measures its velocity.
    """
    fault = {"component": "positioning", "mode": "off", "at": BEGINS, "agents": "cf1"}
    flight = flown(mission, seed, assignments, [fault])
    reacted = flight.when("cf1", "position_lost")
    return reacted < np.inf and flight.worst < 0.5


class Descent:
    """Notes time, s, and true position, m, and speed of the first agent, m/s, tick by tick."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        assert tick.truth is not None
        speed = float(np.linalg.norm(tick.truth.velocity[0]))
        self.rows.append((tick.time, *tick.truth.position[0].tolist(), speed))


def landed_blindly(seed: int) -> tuple[float, float, float]:
    """Land without a Flow deck after a loss of Loco.

    Returns:
        Time from the loss until the agent lands, s; how far it drifts meanwhile, m; and its
        greatest speed from then on, m/s.
    """
    fault = {"component": "positioning", "mode": "off", "at": BEGINS, "agents": "cf1"}
    descent = Descent()
    flight = flown(LOCO, seed, NO_FLOW_DECK, [fault], [descent])
    begins = flight.when("cf1 lands")
    rows = np.array(descent.rows)
    rows = rows[rows[:, 0] >= begins]
    return begins - BEGINS, float(np.linalg.norm(rows[-1, 1:3] - rows[0, 1:3])), rows[:, 4].max()


def over_fleet(
    seed: int, *, silent: int | None = None, loss: bool = False, flow_deck: bool = True
) -> Flown:
    """Fly by Lighthouse over the radio's protocol, on a virtual clock.

    Args:
        seed: Of the flight.
        silent: Row of a drone whose receiver receives nothing.
        loss: Whether that of the first drone receives nothing from 1 s in the air on.
        flow_deck: Whether the drones carry Flow decks.
    """
    receivers = {"system": "lighthouse", "flow_deck": flow_deck}
    options = fill_defaults({"onboard": receivers, "speed": 1.0}, OPTIONS)
    with TemporaryDirectory() as folder:
        changes = [
            f"transport={{use: radio, guardian: false, cache: {folder}, "
            f"flow_deck: {str(flow_deck).lower()}}}",
            *(f"swarm.cf{row}.uri=udp://air:{row}" for row in (1, 2)),
            f"seed={seed}",
        ]
        scene = replace(load(LIGHTHOUSE, Registry(), changes).scene, onboard_system="lighthouse")
        silenced = {} if silent is None else {silent: frozenset({Condition.NO_STATIONS})}
        conditions = with_receivers(silenced, scene)
        air = Air(scene, seed=seed, conditions=conditions, **simulator_arguments(**options))
        onboard = air.fleet.simulator.onboard
        assert onboard is not None

        def lose() -> None:
            onboard.receives[0] = not loss

        with closing(air.fleet):
            return watched(air, LIGHTHOUSE, changes, virtual(air), lose)


def flies_over_fleet(seed: int, *, flow_deck: bool = True) -> bool:
    """Whether a flight over the radio's protocol completes, and is as accurate as simulated."""
    flight = over_fleet(seed, flow_deck=flow_deck)
    return flight.summary["outcome"] == "completed" and flight.worst < ACCURATE


def never_received_over_fleet(seed: int) -> bool:
    """Whether no agent takes off while one of them receives nothing, over the protocol."""
    flight = over_fleet(seed, silent=1)
    return flight.summary["outcome"] != "completed" and flight.highest < ON_FLOOR


def lost_over_fleet(seed: int) -> bool:
    """Whether an agent that receives nothing any more is landed before it is 0.4 m off."""
    flight = over_fleet(seed, loss=True)
    return flight.after("position_lost") < np.inf and flight.worst < NEAR


HOLDS: Mapping[str, Holds] = {
    "never received": never_received,
    "lost": lost,
    "never received, loco, no Flow deck": partial(
        never_received, mission=LOCO, assignments=NO_FLOW_DECK
    ),
    "lost, loco, no Flow deck": partial(lost, mission=LOCO, assignments=NO_FLOW_DECK),
    "flies over the protocol": flies_over_fleet,
    "flies over the protocol, no Flow deck": partial(flies_over_fleet, flow_deck=False),
    "never received, over the protocol": never_received_over_fleet,
    "lost, over the protocol": lost_over_fleet,
}


def main() -> None:
    """Print the table of docs/lighthouse.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=30, help="of each system; %(default)s")
    parser.add_argument("--first", type=int, default=SEED, help="seed; %(default)s")
    parser.add_argument("--processes", type=int, default=1, help="%(default)s")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.flights)
    with ProcessPoolExecutor(options.processes, initializer=_silent) as pool:
        print("| system | RMS (worst flight), cm | RMS along z, cm | worst, cm | NEES (flights) |")
        print("|---|---|---|---|---|")
        for name in SYSTEMS:
            flights = np.array(list(pool.map(partial(of_system, name=name), seeds)))
            rms, along_z = 100 * np.sqrt(np.mean(flights[:, [0, 4]] ** 2, axis=0))
            print(
                f"| {name} | {rms:.1f} ({100 * flights[:, 0].max():.1f}) | {along_z:.1f} "
                f"| {100 * flights[:, 1].max():.1f} | {flights[:, 2].mean():.2f} "
                f"({flights[:, 2].min():.2f}-{flights[:, 2].max():.2f}) |",
                flush=True,
            )
        after, drift, speed = np.array(list(pool.map(landed_blindly, seeds))).T
        print(
            f"landed after {after.mean():.1f} s, no Flow deck: drift median {np.median(drift):.1f} "
            f"m, worst {drift.max():.1f} m; speed median {np.median(speed):.1f} m/s, worst "
            f"{speed.max():.1f} m/s",
            flush=True,
        )
        for name, holds in HOLDS.items():
            print(f"{name}: {sum(pool.map(holds, seeds))} of {len(seeds)}", flush=True)


if __name__ == "__main__":
    main()
