"""Arguments that name a mission, and set values in it."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from star_core.commands import add_set_option, completes, mission_names


def add_mission(line: ArgumentParser) -> None:
    """Add the mission's file, ``--set``, ``--seed`` and ``--speed``."""
    mission = line.add_argument("mission", help="mission file (YAML), or a name of `star missions`")
    completes(mission, mission_names)
    add_values(line)


def add_values(line: ArgumentParser) -> None:
    """Add ``--set``, ``--seed`` and ``--speed``."""
    add_set_option(line)
    line.add_argument("--seed", help="seed of every random number")
    line.add_argument(
        "--speed", help="times real time, in simulation: 1; as fast as it can if not given"
    )


def assignments(options: Namespace) -> list[str]:
    """Return what is set in the mission, ``path=value`` each."""
    values = list(options.set)
    if options.seed is not None:
        values.append(f"seed={options.seed}")
    if options.speed is not None:
        values.append(f"transport.speed={options.speed}")
    return values
