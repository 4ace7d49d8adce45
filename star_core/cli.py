"""The command line: ``star run``, ``check``, ``plugins``, ``schema``, and what plugins add.

Every command imports what it needs when it runs: ``star --help`` needs argparse only.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import nullcontext, redirect_stdout

from star_core.errors import StarError, instead

TYPE_CHECKING = False  # what type checkers take for true; `typing` itself is slow to import
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import TextIO

    from star_core.registry import Registry

FAILED = 1
BAD_INPUT = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``star`` and return its exit status: 0 done, 1 failed in flight, 2 bad input."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        try:
            return _main(arguments)
        finally:
            sys.stdout.flush()  # while it can still be met that the reader has gone
    except StarError as error:
        for line in str(error).splitlines():
            print(line, file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        _leave_quietly()
        return FAILED
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return FAILED


def _main(arguments: list[str]) -> int:
    if arguments and not arguments[0].startswith("-") and arguments[0] not in COMMANDS:
        return _of_plugin(arguments[0], arguments[1:])
    options, unknown = parser().parse_known_args(arguments)
    if unknown:
        raise StarError(_too_much(unknown[0], options.usage()))
    answer = sys.stdout
    alone = getattr(options, "json", False)  # what plugins print must not be in the answer
    with redirect_stdout(sys.stderr) if alone else nullcontext():
        return COMMANDS[options.command](options, answer)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run ``star-run``, which is ``star run``."""
    return main(["run", *(sys.argv[1:] if arguments is None else arguments)])


class Version(argparse.Action):
    """Prints the installed version, which nothing else of the command line has to look up."""

    def __init__(self, option_strings: Sequence[str], dest: str, **more: object) -> None:
        super().__init__(option_strings, dest, nargs=0, help="print the version of STAR")

    def __call__(self, parser: argparse.ArgumentParser, *_given: object) -> None:
        """Print it, and end."""
        from star_core import __version__

        print(f"star {__version__}")
        parser.exit()


def parser() -> argparse.ArgumentParser:
    """The command line, apart so that the docs and the tests can read it."""
    star = argparse.ArgumentParser(
        prog="star",
        description="Missions for drone swarms, from one YAML file.",
        epilog="Plugins may add commands: `star plugins` lists them.",
        allow_abbrev=False,
    )
    star.add_argument("--version", action=Version)
    commands = star.add_subparsers(dest="command", required=True, metavar="COMMAND")
    fly = commands.add_parser("run", help="fly a mission (= star-run)", allow_abbrev=False)
    check = commands.add_parser("check", help="check a mission, and stop", allow_abbrev=False)
    fly.add_argument("mission", help="mission file (YAML)")
    check.add_argument("mission", help="mission file (YAML); or steps, a world, a camera")
    for command in (fly, check):
        command.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="PATH=VALUE",
            help="set a value of the mission: avoider.radius=0.3, transport=radio",
        )
        command.add_argument("--seed", help="seed of every random number")
        command.add_argument(
            "--speed", help="times real time, in simulation: 1; as fast as it can if not given"
        )
    fly.add_argument("--out", metavar="DIR", help="record into DIR (runs/TIME-MISSION)")
    fly.add_argument("--no-record", action="store_true", help="leave nothing behind")
    fly.add_argument("--save-frames", action="store_true", help="keep the cameras' images too")
    fly.add_argument("--json", action="store_true", help="print the summary as JSON, only")
    fly.add_argument("--verbose", action="store_true", help="show the tracebacks of plugins")
    plugins = commands.add_parser("plugins", help="list what is installed", allow_abbrev=False)
    plugins.add_argument("--json", action="store_true", help="as JSON, with option schemas")
    schema = commands.add_parser("schema", help="write a schema for an editor", allow_abbrev=False)
    schema.add_argument(
        "of",
        nargs="?",
        default="mission",
        choices=["mission", "steps", "world", "camera", "study"],
        help="kind of file: %(default)s",
    )
    schema.add_argument("--out", metavar="FILE", help="write to FILE instead of printing")
    for command in (fly, check, plugins, schema):
        command.set_defaults(usage=command.format_usage)
    return star


def _run(options: argparse.Namespace, answer: TextIO) -> int:
    from star_core.running import run_mission

    status, text = run_mission(
        options.mission,
        _assignments(options),
        _registry(),
        out=options.out,
        keep=not options.no_record,
        save_frames=options.save_frames,
        as_json=options.json,
        verbose=options.verbose,
    )
    print(text, file=answer)
    return status


def _check(options: argparse.Namespace, answer: TextIO) -> int:
    from pathlib import Path

    from star_core.check_file import check_file

    print(check_file(Path(options.mission), _assignments(options), _registry()), file=answer)
    return 0


def _plugins(options: argparse.Namespace, answer: TextIO) -> int:
    from star_core.listing import as_json, as_text

    registry = _registry()
    print(as_json(registry) if options.json else as_text(registry), file=answer)
    return 0


def _schema(options: argparse.Namespace, answer: TextIO) -> int:
    import json
    from pathlib import Path

    from star_core import schema

    if options.of == "mission":
        content = schema.compose(_registry().offers())
    elif options.of == "steps":
        content = schema.compose_steps(_registry().offers(), admit=True)
    else:
        content = schema.load(options.of)
    text = json.dumps(content, indent=2)
    if options.out:
        try:
            Path(options.out).write_text(text + "\n", encoding="utf-8")
        except OSError as error:
            raise StarError(f"{options.out}: cannot be written: {error.strerror}") from error
    else:
        print(text, file=answer)
    return 0


def _of_plugin(name: str, arguments: list[str]) -> int:
    """Run a command that a plugin adds.

    Raises:
        StarError: There is none of that name.
        PluginError: It raised what is neither an `InputError` nor meant to exit.
    """
    from star_core.blame import Blame
    from star_core.errors import InputError, PluginError

    registry = _registry()
    if name not in registry.names("command"):
        known = [*COMMANDS, *registry.names("command")]
        raise StarError(f"star has no command {name!r}{instead(name, known, 'there are')}")
    found = registry.find("command", name)
    try:
        with Blame(f"command {name!r} ({found.source})"):
            status: int = found.offer.make(arguments)
    except PluginError as error:
        if isinstance(error.__cause__, SystemExit | InputError | BrokenPipeError):
            raise error.__cause__ from None
        raise
    return status


def _too_much(word: str, usage: str) -> str:
    """Say what is wrong with a word of the command line that nothing asks for."""
    import re

    if not word.startswith("-"):
        return f"{word!r} is one argument too many"
    return f"unknown option {word!r}{instead(word, re.findall('--[a-z-]+', usage), 'there are')}"


def _leave_quietly() -> None:
    """Whoever read us has gone: let Python write the rest to nowhere."""
    import os

    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())


def _assignments(options: argparse.Namespace) -> list[str]:
    assignments = list(options.set)
    if options.seed is not None:
        assignments.append(f"seed={options.seed}")
    if options.speed is not None:
        assignments.append(f"transport.speed={options.speed}")
    return assignments


def _registry() -> Registry:
    """The installed plugins; those that were left out are named."""
    from star_core.registry import Registry

    registry = Registry()
    for source, why in registry.broken.items():
        print(f"star: plugin {source} is left out: {why}", file=sys.stderr)
    return registry


COMMANDS = {"run": _run, "check": _check, "plugins": _plugins, "schema": _schema}
