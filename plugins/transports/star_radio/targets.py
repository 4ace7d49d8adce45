"""The drones that a command is for: links, or those of a mission."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from star_core import InputError, Registry, load
from star_radio.address import drone, fault


def links(targets: Sequence[str], assignments: Sequence[str], registry: Registry) -> dict[str, str]:
    """Return the links of the drones by their names, which for a link is the link itself.

    Raises:
        InputError: An address is invalid, or the mission is.
    """
    uris: dict[str, str] = {}
    for target in targets:
        if "://" in target:
            uris[target] = target
            continue
        for agent in load(Path(target), registry, assignments).scene.agents:
            if agent.uri is None:
                text = f"{target}: agent {agent.name!r} has no 'uri': the address of its link"
                raise InputError(text, "missing-option")
            uris[agent.name] = agent.uri
    for uri in uris.values():
        if problem := fault(uri):
            raise InputError(problem, "invalid-address")
    unique = {drone(uri): name for name, uri in reversed(uris.items())}
    return {name: uri for name, uri in uris.items() if unique[drone(uri)] == name}
