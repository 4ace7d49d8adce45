"""Arguments that name a mission, and set values in it."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from star_core.commands import add_set_option


def add_mission(line: ArgumentParser, others: str = "") -> None:
    """Add the mission's file, ``--set``, ``--seed`` and ``--speed``.

    Args:
        line: Parser of the command.
        others: Further kinds of files that the command accepts, for the help.
    """
    what = f"mission file (YAML), or a name of `star missions`{others}"
    line.add_argument("mission", help=what)
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
