"""Command ``star ablate``: flies a study, which is missions times levels times seeds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec
from star_core.formats import FileKindSpec

if TYPE_CHECKING:
    from star_core import Registry
    from star_core.toolkit import StudyResults


@hookimpl
def star_file_kinds() -> Iterator[FileKindSpec]:
    yield FileKindSpec(
        name="study",
        summary="A study: missions, levels of factors, seeds and measures.",
        noun="a study",
        keys=("missions", "factors", "measures"),
        schema=deferred("star_ablate.reading:schema"),
        check=deferred("star_ablate.reading:check"),
        hints={"mission": "`star ablate` checks and flies it"},
    )


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="ablate",
        summary="Fly a study (missions x levels x seeds) and tabulate its measures.",
        configure=deferred("star_ablate.command:configure"),
        run=deferred("star_ablate.command:run"),
        group="Study",
    )


@hookimpl
def star_fly_study(
    study: Path, folder: Path, workers: int | None, registry: Registry
) -> StudyResults:
    from star_ablate.command import fly_study

    return fly_study(study, folder, workers, registry)
