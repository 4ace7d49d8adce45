"""Runs for other machines: the mission as text with every file that it names, and its seed."""

from __future__ import annotations

import base64
import json
import platform
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from star_ablate.basis import Basis, differences
from star_core import Mission, Registry, load

if TYPE_CHECKING:
    from star_ablate.flight import Job


class Order(NamedTuple):
    """A run as data.

    Attributes:
        name: Of the mission's file.
        prefix: Path of its folder as messages have it, up to the name of a file.
        files: Contents of the files in its folder by name, as base64.
        assignments: ``path=value`` each, to be set in the mission.
        seed: Root seed.
        basis: Of the result, as `Basis.of` returns it.
        python: Version of Python.
        time_limit: Wall time limit, s.
    """

    name: str
    prefix: str
    files: Mapping[str, str]
    assignments: Sequence[str]
    seed: int
    basis: Mapping[str, str]
    python: str
    time_limit: float | None

    def text(self) -> str:
        """Return the order as JSON."""
        return json.dumps(self._asdict())


def order_of(job: Job, files: Sequence[Path], time_limit: float | None) -> Order:
    """Return the order to fly a job elsewhere.

    Args:
        job: The run.
        files: That its mission names, as `Basis.files` returns them.
        time_limit: Wall time limit, s.
    """
    mission = job.mission
    folder, path = mission.scene.folder, mission.file.path
    named = {path, mission.world_file.path, *mission.files, *files}
    return Order(
        name=path.name,
        prefix=str(path).removesuffix(path.name),
        files={str(file.relative_to(folder)): _content(file) for file in sorted(named, key=str)},
        assignments=job.assignments,
        seed=mission.scene.seed,
        basis=dict(job.basis or {}),
        python=platform.python_version(),
        time_limit=time_limit,
    )


def mission_of(order: Order, folder: Path, registry: Registry) -> tuple[Mission, list[str]]:
    """Return the mission of an order, and what differs from the machine that it is from.

    Args:
        order: The run.
        folder: Empty, for its files.
        registry: Of the plugins.

    Raises:
        StarError: The mission cannot be flown on this machine.
    """
    for name, content in order.files.items():
        path = folder / name
        if not path.resolve().is_relative_to(folder.resolve()):
            raise ValueError(f"{name!r} leads out of the folder")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(base64.b64decode(content))
    mission = load(folder / order.name, registry, order.assignments)
    different = differences(order.basis, basis_of(mission, registry))
    if order.python != platform.python_version():
        different.append(f"Python {platform.python_version()}, not {order.python}")
    return mission.with_seed(order.seed), different


def basis_of(mission: Mission, registry: Registry) -> dict[str, str]:
    """Return what the result of a mission depends on in this process, as `Basis.of` does."""
    return _basis(registry).of(mission)


@lru_cache(maxsize=1)
def _basis(registry: Registry) -> Basis:
    """Return the basis of a registry, which reads code once."""
    return Basis(registry)


@lru_cache(maxsize=256)
def _content(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode()
