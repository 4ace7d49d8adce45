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
from tests.end_to_end.virtual_air import Air
from tests.plugins.transports.star_radio.conftest import options
from tests.plugins.transports.star_radio.virtual import virtual

DRONES = 5
ROUNDS = 20
CONDITIONS = {
    "10 % loss": LinkFaults(loss=0.1),
    "30 % duplicates": LinkFaults(duplicates=0.3),
    "150 ms each way": LinkFaults(delay=0.15),
    "mixture": LinkFaults(loss=0.1, duplicates=0.1, delay=0.05, jitter=0.1),
}


def refusals(faults: LinkFaults, cache: Path, *, n: int, seed: int) -> list[str]:
    """Connect to some drones; return why that failed, if it did."""
    room = scene(n)
    air = Air(room, seed=seed)
    air.links.faults[:] = [faults] * n
    agents = zip(room.agents, air.uris, strict=True)
    reached = dataclasses.replace(
        room, agents=tuple(dataclasses.replace(agent, uri=uri) for agent, uri in agents)
    )
    with (
        virtual(air),
        closing(air.fleet),
        closing(star_radio.make(reached, **options(cache=str(cache)))) as radio,
    ):
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
