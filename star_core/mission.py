"""A mission: what to fly, with which plugins; `mission_file.mission_loader` reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from star_core.mission_file.located import Document
from star_core.mission_file.step_tree import Node
from star_core.plugin_support.discovery import Source
from star_core.scene import Scene


@dataclass(frozen=True, slots=True)
class PluginChoice:
    """A plugin that a mission uses.

    Attributes:
        kind: Of the plugin.
        use: Its name.
        options: Its options, with the defaults of its schema.
        source: Its origin.
        written: Its options as the mission has them.
    """

    kind: str
    use: str
    options: Mapping[str, Any]
    source: Source
    written: Mapping[str, Any]

    def __str__(self) -> str:
        return f"{self.kind} {self.use!r} ({self.source})"


@dataclass(frozen=True, slots=True)
class Mission:
    """What to fly.

    Attributes:
        name: For records.
        scene: What every plugin is made with.
        parts: The transport, localizer, planner and avoider, by kind.
        steps: What to do, one after the other.
        safety: What becomes of agents in trouble, by the trouble.
        reserve: Agents that replace others, and when; empty if there are none.
        plugin_strikes: Number of failures of a plugin in flight at which all agents land.
        collisions: ``fail`` if a collision fails the mission, ``record`` if it is only recorded.
        document: The mission as read, with what was set on the command line.
        world: The world as read.
        warnings: What is probably a mistake, one line each, with its location.
    """

    name: str
    scene: Scene
    parts: Mapping[str, PluginChoice]
    steps: tuple[Node, ...]
    safety: Mapping[str, Mapping[str, Any]]
    reserve: Mapping[str, Any]
    plugin_strikes: int
    collisions: str
    document: Document
    world: Document
    warnings: tuple[str, ...] = ()

    def with_seed(self, seed: int) -> Mission:
        """Return the same mission with another seed."""
        root = self.document.root
        number = replace(root, data=seed)
        document = replace(self.document, root=replace(root, data={**root.map(), "seed": number}))
        return replace(self, scene=replace(self.scene, seed=seed), document=document)

    @property
    def reserve_rows(self) -> tuple[int, ...]:
        """Rows of the agents that are in reserve at the start."""
        return tuple(self.scene.names.index(name) for name in self.reserve.get("agents", ()))
