"""Simulators and fleets in the ideal world, for tests that are not about errors of sensors."""

from __future__ import annotations

from typing import Any

from star_core import Scene
from star_fleet.server import Fleet
from star_sim import ideal_world
from star_sim.transport import Simulator


def ideal_simulator(scene: Scene, **options: Any) -> Simulator:
    """Return a simulator; `options` are arguments of `Simulator` that differ."""
    return Simulator(scene, **ideal_world(**options))


def ideal_fleet(scene: Scene, **options: Any) -> Fleet:
    """Return a fleet, at free ports if no other is given; `options` are arguments of `Fleet`."""
    return Fleet(scene, **ideal_world(**{"port": 0, "speed": 1.0, **options}))
