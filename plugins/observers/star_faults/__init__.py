"""Fault files, and ``star run --faults``, which injects the faults of one into a flight."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import Mission, Registry, deferred, hookimpl
from star_core.commands import RunOptionSpec
from star_core.formats import FileKindSpec


@hookimpl
def star_file_kinds() -> Iterator[FileKindSpec]:
    yield FileKindSpec(
        name="faults",
        summary="Faults of a flight: what fails, when and for which agents.",
        noun="a file of faults",
        keys=("faults", "mission"),
        schema=deferred("star_faults.fault_file:schema"),
        check=deferred("star_faults.fault_file:check"),
        hints={"mission": "`star run MISSION --faults FILE` injects them"},
    )


@hookimpl
def star_run_options() -> Iterator[RunOptionSpec]:
    yield RunOptionSpec(
        name="faults",
        summary="inject the faults of FILE (YAML) into the flight",
        make=_make,
        metavar="FILE",
    )


def _make(mission: Mission, registry: Registry, file: str) -> object:
    from pathlib import Path

    from star_faults.fault_file import read_faults
    from star_faults.injector import FaultInjector

    path = Path(file)
    return FaultInjector(
        mission.scene, read_faults(path, mission.scene, registry), path.read_bytes()
    )
