"""Labelled bodies of the systems of the package ``motioncapture``, which sends no times."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from star_mocap.source import Frame


def frames(*, type: str, host: str) -> Iterator[Frame]:  # noqa: A002 -- the option's name
    """Yield the frames of a system, as ``motioncapture.connect`` names it."""
    system: Any = import_module("motioncapture").connect(type, {"hostname": host})
    while True:
        system.waitForNextFrame()
        yield Frame(
            {
                name: (*body.position, turn.x, turn.y, turn.z, turn.w)
                for name, body in system.rigidBodies.items()
                for turn in (body.rotation,)
            }
        )
