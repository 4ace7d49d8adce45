"""Installed plugins: entry points, where they are from, and which of them are loaded."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import Distribution, EntryPoint, entry_points
from typing import Final

ENTRY_POINT_GROUP: Final = "star.plugins"
OWN: Final = "star-swarm:"
"""Prefix of the names of STAR's own plugins; their records are checked by a test, not when they
are loaded."""

BLOCK_PLUGINS: Final = "STAR_BLOCK_PLUGINS"
"""Environment variable: names of entry points that are not loaded, separated by commas."""

ALLOW_PLUGINS: Final = "STAR_ALLOW_PLUGINS"
"""Environment variable: likewise, of those beside STAR's own that are loaded; by default all."""


@dataclass(frozen=True, slots=True)
class Source:
    """Origin of a plugin.

    Attributes:
        plugin: ``distribution:entry point``.
        version: The distribution's version.
    """

    plugin: str
    version: str = ""

    @property
    def own(self) -> bool:
        """Whether it is one of STAR's own plugins."""
        return self.plugin.startswith(OWN)

    def __str__(self) -> str:
        distribution, _, entry = self.plugin.partition(":")
        return f"{distribution} {self.version}:{entry}" if self.version else self.plugin


def blocked_plugins() -> str:
    """Return the names of entry points that the environment blocks, separated by commas."""
    return os.environ.get(BLOCK_PLUGINS, "")


def installed_plugins() -> Iterator[tuple[EntryPoint, Source]]:
    """Yield the entry points of installed plugins that the environment permits, in order."""
    for entry in sorted(entry_points(group=ENTRY_POINT_GROUP)):
        source = _source(entry)
        if not _why_blocked(entry, source):
            yield entry, source


def blocked_hint(name: str) -> str:
    """Return why the environment keeps an installed plugin of a name out; empty if it does not."""
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        if entry.name == name and (why := _why_blocked(entry, source := _source(entry))):
            return f"; plugin {source} is installed, but {why}"
    return ""


def _why_blocked(entry: EntryPoint, source: Source) -> str:
    if entry.name in blocked_plugins().split(","):
        return f"blocked by {BLOCK_PLUGINS}"
    allowed = os.environ.get(ALLOW_PLUGINS)
    if allowed is None or entry.name in allowed.split(",") or source.own:
        return ""
    return f"not in {ALLOW_PLUGINS}"


def _source(entry: EntryPoint) -> Source:
    if entry.dist is None:
        return Source(entry.name)
    name, version = _distribution(entry.dist)
    return Source(f"{name}:{entry.name}", version)


@cache
def _distribution(distribution: Distribution) -> tuple[str, str]:
    """Return name and version; each access to `metadata` reads the file again."""
    metadata = distribution.metadata
    return metadata["Name"], metadata["Version"]
