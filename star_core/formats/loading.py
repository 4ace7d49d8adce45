"""Finds the format of a file, and loads missions by it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from star_core.errors import InputError, PluginError
from star_core.plugin_support.registry import Registry, guarded

if TYPE_CHECKING:
    from star_core.errors import SourceFile
    from star_core.mission import Mission
    from star_core.plugin_support.registry import Found

STDIN: Final = Path("-")
"""Names standard input where a file is named."""


def load(path: Path | str, registry: Registry, assignments: Sequence[str] = ()) -> Mission:
    """Read a mission and check it.

    Args:
        path: The mission's file, or the name of a mission that comes with a format.
        registry: Registry of the plugins, the format among them.
        assignments: ``path=value`` each, to be set in the mission first.

    Raises:
        InputError: The mission or its world cannot be flown; every reason found is listed.
        PluginError: No installed format reads it.
    """
    path = Path(path)
    plugin = format_of(path, registry)
    mission: Mission = guarded("format", plugin, plugin.offer.load, path, registry, assignments)
    return mission


def check_file(
    path: Path, registry: Registry, assignments: Sequence[str] = ()
) -> tuple[str, Sequence[str]]:
    """Return, in one line, what a file of any kind is good for, and warnings, one line each.

    The arguments and the errors are those of `load`.
    """
    plugin = format_of(path, registry)
    text, warnings = guarded("format", plugin, plugin.offer.check, path, registry, assignments)
    return text, warnings


def read_as(path: Path, kind: str, registry: Registry) -> SourceFile:
    """Read a file that a command or a mission names.

    Args:
        path: The file.
        kind: Name of its `FileKindSpec`.
        registry: Registry of the formats and of the kinds of files.

    Raises:
        InputError: It cannot be read, is of another kind or does not fit the schema of its kind;
            lists every reason with its location.
    """
    plugin = format_of(path, registry)
    if plugin.offer.read is None:
        noun = registry.find("file_kind", kind).offer.noun
        text = f"{path}: format {plugin.offer.name!r} has no such file as {noun}"
        raise InputError(text, "wrong-file")
    file: SourceFile = guarded("format", plugin, plugin.offer.read, path, kind, registry)
    return file


def format_of(path: Path, registry: Registry) -> Found:
    """Return the format that recognizes a file or, if none does, the one that reads any file.

    Raises:
        PluginError: There is neither.
    """
    if plugin := _accepting("recognizes", registry, path):
        return plugin
    for plugin in _formats(registry):
        if plugin.offer.recognizes is None:
            return plugin
    raise PluginError(f"no installed format reads {str(path)!r}", "unknown-plugin")


def recognized_as(path: Path, registry: Registry) -> str | None:
    """Return the name of the format that recognizes a file or folder, valid or not, if any does."""
    plugin = _accepting("recognizes", registry, path)
    plugin = plugin or _accepting("resembles", registry, path, registry)
    return None if plugin is None else str(plugin.offer.name)


def _formats(registry: Registry) -> list[Found]:
    return [registry.find("format", name) for name in registry.names("format")]


def _accepting(function: str, registry: Registry, *arguments: Any) -> Found | None:
    """Return the first format whose function of a name accepts the arguments, if any does."""
    for plugin in _formats(registry):
        accepts = getattr(plugin.offer, function)
        if accepts is not None and guarded("format", plugin, accepts, *arguments):
            return plugin
    return None


def format_function(name: str, registry: Registry) -> Callable[..., Any]:
    """Return an optional function of the first format that has it.

    Args:
        name: Of the field of `FormatSpec`.
        registry: Registry of the formats.

    Raises:
        PluginError: No installed format has it.
    """
    for spec in registry.offers()["format"].values():
        if (function := getattr(spec, name)) is not None:
            typed: Callable[..., Any] = function
            return typed
    raise PluginError(f"no installed format has {name!r}", "unknown-plugin")
