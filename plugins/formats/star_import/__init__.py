"""Format of the original STAR's and Crazyswarm2's files, and the command ``star import``."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec
from star_core.formats import FileKindSpec, FormatSpec

_HINTS = dict.fromkeys(
    ("mission", "world", "study", "faults"),
    "`star import` turns it into a mission and a world",
)


@hookimpl
def star_formats() -> Iterator[FormatSpec]:
    yield FormatSpec(
        name="original-star",
        summary="Files and folders of the original STAR, Crazyswarm2, Crazyswarm; base stations.",
        recognizes=deferred("star_import.sources:recognizes"),
        load=deferred("star_import.folder:load"),
        check=deferred("star_import.folder:check"),
    )


@hookimpl
def star_file_kinds() -> Iterator[FileKindSpec]:
    yield FileKindSpec(
        name="crazyswarm2",
        summary="Crazyswarm2's robots.",
        noun="a file of Crazyswarm2",
        keys=("robots", "robot_types", "fileversion", "crazyflies", "crazyflieTypes"),
        hints=_HINTS,
    )
    yield FileKindSpec(
        name="original-star",
        summary="Commands or environment of the original STAR.",
        noun="a file of the original STAR",
        keys=("command_sequence", "environment", "april_tags"),
        hints=_HINTS,
    )


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="import",
        summary="Convert files of the original STAR or of Crazyswarm2 to missions and worlds.",
        configure=deferred("star_import.command:configure"),
        run=deferred("star_import.command:run"),
        group="Author",
    )
