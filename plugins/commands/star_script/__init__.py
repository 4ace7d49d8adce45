"""Command ``star script``: runs scripts of Crazyswarm2 and Crazyswarm, unchanged."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from star_core import Registry, deferred, hookimpl
from star_core.commands import CommandSpec


@hookimpl
def star_commands(registry: Registry) -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="script",
        summary="Run a script written for crazyflie_py or pycrazyswarm, unchanged.",
        configure=partial(deferred("star_script.command:configure"), registry),
        run=deferred("star_script.command:run"),
        group="Fly",
    )
