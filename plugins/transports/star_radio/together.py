"""Does something with many drones at the same time, and says with which it could not be done."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

from star_core import PluginError
from star_radio.vehicle import Vehicle


def faults(
    vehicles: Mapping[int, Vehicle], act: Callable[[int, Vehicle], object]
) -> dict[int, str]:
    """Return why something could not be done with a drone, ``name (why)``, by its row.

    Args:
        vehicles: By their rows; there is one at least.
        act: What to do with each; it raises `PluginError`, or what comes of short answers.
    """

    def fault(row: int) -> str | None:
        vehicle = vehicles[row]
        try:
            act(row, vehicle)
        except PluginError as error:
            return f"{vehicle.name} ({error})"
        except (IndexError, struct.error) as error:
            return f"{vehicle.name} ({vehicle.link.uri} answers what is no answer: {error})"
        return None

    with ThreadPoolExecutor(len(vehicles)) as pool:
        said = pool.map(fault, vehicles)
        return {row: why for row, why in zip(vehicles, said, strict=True) if why is not None}
