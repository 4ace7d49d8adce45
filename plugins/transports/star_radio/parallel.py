"""Runs a function for many drones in parallel and collects the failures."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

from star_core import PluginError
from star_radio.vehicle import Vehicle


def faults(
    vehicles: Mapping[int, Vehicle], act: Callable[[int, Vehicle], object]
) -> dict[int, str]:
    """Return the failures by row, each as ``name (reason)``.

    Args:
        vehicles: By their rows; at least one.
        act: Function to run; may raise `PluginError`, or parsing errors for short answers.
    """

    def fault(row: int) -> str | None:
        vehicle = vehicles[row]
        try:
            act(row, vehicle)
        except PluginError as error:
            return f"{vehicle.name} ({error})"
        except (IndexError, struct.error) as error:
            return f"{vehicle.name} ({vehicle.link.uri} sent an invalid answer: {error})"
        return None

    with ThreadPoolExecutor(len(vehicles)) as pool:
        results = pool.map(fault, vehicles)
        return {row: why for row, why in zip(vehicles, results, strict=True) if why is not None}
