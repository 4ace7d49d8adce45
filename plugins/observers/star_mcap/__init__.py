"""Observer ``mcap``: writes ``flight.mcap``, a recording for robotics tools; ``star recover``."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from importlib.util import find_spec
from typing import TYPE_CHECKING

from star_core import InputError, deferred, hookimpl
from star_core.commands import CommandSpec

if TYPE_CHECKING:
    import argparse

    from star_core import Flight, Operator
    from star_mcap.process import RecorderProcess

log = logging.getLogger(__name__)

PACKAGES = ("mcap", "rosbags")  # of the extra `record`


@hookimpl
def star_mission_started(flight: Flight, operator: Operator) -> RecorderProcess | None:
    if flight.folder is None:
        return None
    if missing := _missing():
        log.debug("no flight.mcap without %s: pip install 'star-swarm[record]'", missing)
        return None
    from star_mcap.process import RecorderProcess

    return RecorderProcess(flight, flight.folder, operator.lost)


def _missing() -> list[str]:
    return [name for name in PACKAGES if find_spec(name) is None]


def _recover(line: argparse.ArgumentParser) -> None:
    if _missing():
        text = "star recover needs mcap: pip install 'star-swarm[record]'"
        raise InputError(text, "missing-package")
    from star_mcap.recovery import configure

    configure(line)


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="recover",
        summary="Complete the recording of an interrupted run.",
        configure=_recover,
        run=deferred("star_mcap.recovery:run"),
        group="Review",
    )
