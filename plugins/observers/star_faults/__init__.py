"""Option ``star run --faults``: injects the faults of a fault file into a flight."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import Mission, Registry, hookimpl
from star_core.commands import RunOptionSpec


@hookimpl
def star_run_options() -> Iterator[RunOptionSpec]:
    yield RunOptionSpec(
        name="faults",
        summary="inject the faults of FILE (YAML) into the flight",
        make=_make,
        metavar="FILE",
    )


def _make(mission: Mission, _registry: Registry, file: str) -> object:
    from pathlib import Path

    from star_core.commands import read_faults
    from star_faults.injector import FaultInjector

    path = Path(file)
    return FaultInjector(mission.scene, read_faults(path, mission.scene), path.read_bytes())
