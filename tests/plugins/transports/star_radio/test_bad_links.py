"""Connecting to simulated Crazyflies over links that lose, repeat and delay packets."""

from __future__ import annotations

import dataclasses
from contextlib import closing
from pathlib import Path

import pytest

import star_radio
from star_core import PluginError
from star_core.testing import scene
from star_fleet.link_faults import LinkFaults
from star_fleet.server import Fleet

DRONES = 5
ROUNDS = 20
CONDITIONS = {
    "10 % loss": LinkFaults(loss=0.1),
    "30 % duplicates": LinkFaults(duplicates=0.3),
    "150 ms each way": LinkFaults(delay=0.15),
    "mixture": LinkFaults(loss=0.1, duplicates=0.1, delay=0.05, jitter=0.1),
}


def refusals(faults: LinkFaults, cache: Path, *, n: int, seed: int) -> list[str]:
    """Connect to some drones at once; return why that failed, if it did."""
    room = scene(n)
    with Fleet(room, port=0, faults=faults, seed=seed) as fleet:
        agents = zip(room.agents, fleet.addresses, strict=True)
        reached = dataclasses.replace(
            room, agents=tuple(dataclasses.replace(agent, uri=uri) for agent, uri in agents)
        )
        radio = star_radio.make(reached, cache=str(cache))
        with closing(radio):
            try:
                radio.connect()
            except PluginError as error:
                return [part for part in str(error).split("; ") if part.count("(")]
    return []


@pytest.mark.campaign
@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_connection_succeeds(condition: str, tmp_path: Path) -> None:
    failures = [
        failure
        for seed in range(ROUNDS)
        for failure in refusals(CONDITIONS[condition], tmp_path / str(seed), n=DRONES, seed=seed)
    ]
    total = DRONES * ROUNDS
    print(f"{condition}: {total - len(failures)} of {total} connect")  # noqa: T201
    assert not failures
