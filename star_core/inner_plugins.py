"""For plugins that wrap another one, which an option names as a mission does."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from star_core.errors import Problem
from star_core.formats import format_function
from star_core.plugin_support.option_schema import fill_defaults
from star_core.plugin_support.registry import Registry
from star_core.world.scene import Scene


def make_inner(scene: Scene, kind: str, choice: str | Mapping[str, Any]) -> Any:
    """Return the plugin that an option names, made with its options and their defaults.

    Args:
        scene: That the wrapping plugin is made with.
        kind: ``transport``, ``localizer``, ``planner`` or ``avoider``.
        choice: Its name, or ``{"use": name, option: value}``.

    Raises:
        PluginError: No plugin of that name is installed.
    """
    name, options = _parted(choice)
    offer = Registry().find(kind, name).offer
    return offer.make(scene, **fill_defaults(options, offer.options))


def check_inner(scene: Scene, kind: str, choice: str | Mapping[str, Any]) -> Iterator[Problem]:
    """Yield the mistakes in the choice of an inner plugin, as ``star check`` reports those of one.

    Paths begin at the choice: put the name of the option that holds it before them.

    Args:
        scene: That the wrapping plugin is checked with.
        kind: As for `make_inner`.
        choice: As for `make_inner`.

    Example:
        >>> from star_core.testing import scene
        >>> (problem,) = check_inner(scene(1), "planner", {"use": "straight", "gain": -1})
        >>> problem.path, problem.message
        (('gain',), "planner 'straight': gain: -1 is not possible here, expected more than 0")
    """
    registry = Registry()
    problems = [*format_function("check_choice", registry)(kind, choice, registry)]
    yield from problems
    if not problems:
        name, options = _parted(choice)
        offer = registry.find(kind, name).offer
        if offer.check is not None:
            yield from offer.check(scene, **fill_defaults(options, offer.options))


def _parted(choice: str | Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    if isinstance(choice, str):
        return choice, {}
    options = dict(choice)
    return options.pop("use"), options
