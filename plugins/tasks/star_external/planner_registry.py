"""Installed external planners, by name. Does not import numpy."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Final

from star_core import PluginError

GROUP: Final = "star.external_planners"
"""Entry points of planners: each names a function that is called with the scene and the rows of a
step's agents and returns a `star_external.planner.ExternalPlanner`."""


@cache
def _installed() -> tuple[EntryPoint, ...]:
    return tuple(sorted(entry_points(group=GROUP)))


def names() -> tuple[str, ...]:
    """Return the names of all planners."""
    return tuple(dict.fromkeys(point.name for point in _installed()))


def chosen(name: str) -> EntryPoint:
    """Return the entry point of a planner.

    Raises:
        PluginError: There is none of that name, or there are two.
    """
    found = [point for point in _installed() if point.name == name]
    if not found:
        there = ", ".join(names()) or f"none (planners are entry points of {GROUP!r})"
        message = f"no external planner named {name!r}; installed: {there}"
        raise PluginError(message, code="unknown-plugin")
    if len(found) > 1:
        values = " and ".join(point.value for point in found)
        message = f"two external planners are named {name!r}: {values}; uninstall one"
        raise PluginError(message, code="duplicate-plugin")
    return found[0]
