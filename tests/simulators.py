"""Simulators and fleets in the ideal world, for tests that are not about errors of sensors."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import replace
from typing import Any

from star_core import Scene, hookimpl
from star_fleet.server import Fleet
from star_sim import ideal_world
from star_sim.transport import Simulator


def ideal_simulator(scene: Scene, **options: Any) -> Simulator:
    """Return a simulator; `options` are arguments of `Simulator` that differ."""
    return Simulator(scene, **ideal_world(**options))


class SimulatorWitness:
    """An observer that keeps the simulator of a flight, to see its drones after the last tick."""

    simulator: Any = None

    @hookimpl(wrapper=True)
    def star_transports(self) -> Generator[None, Any, list[list[Any]]]:
        offers = yield

        def kept(make: Callable[..., Any]) -> Callable[..., Any]:
            def made(*arguments: Any, **options: Any) -> Any:
                self.simulator = make(*arguments, **options)
                return self.simulator

            return made

        return [[replace(spec, make=kept(spec.make)) for spec in own] for own in offers]


def ideal_fleet(scene: Scene, **options: Any) -> Fleet:
    """Return a fleet, at free ports if no other is given; `options` are arguments of `Fleet`."""
    return Fleet(scene, **ideal_world(**{"port": 0, "speed": 1.0, **options}))
