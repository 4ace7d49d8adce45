"""The dispatcher of the command ``star``: all its subcommands are plugins."""
# PYTHON_ARGCOMPLETE_OK

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Final, TextIO

from star_core.errors import StarError, printable, suggestion

if TYPE_CHECKING:
    from star_core.plugin_support.registry import Registry

FAILED: Final = 1
BAD_INPUT: Final = 2
GARBAGE: Final = 50_000  # objects more than at the last search for garbage: many at a start stay
IDLE: Final = "4"
"""Logarithm of the processor cycles for which an idle thread of OpenBLAS, numpy's library, spins
before it sleeps. By default it is 26: each thread spins for some 30 ms as numpy is imported."""
MAX_WIDTH: Final = 100  # characters; also the width where there is no terminal
GROUPS: Final = ("Fly", "Review", "Author", "Study", "Hardware", "Plugins")
USAGE = "usage: star [-h] [-V] COMMAND ..."


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``star`` and return its exit status: 0 done, 1 failed in flight, 2 bad input.

    Without arguments it is the process's program, and no thread delays the end of that. A program
    ``star-NAME``, such as ``star-run``, runs the command NAME.
    """
    if arguments is None:
        if "_ARGCOMPLETE" in os.environ:  # set by the shell's completion
            from star_core.commands.completion import complete

            complete()
        _open_streams()
        os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", IDLE)
        _, dash, command = PurePath(sys.argv[0]).name.partition("star-")
        gc.disable()  # until plugins are loaded, which stay
        try:
            return _without_threads(main([command] * bool(dash) + sys.argv[1:]))
        finally:
            gc.freeze()  # Python would search all of it for garbage as it exits
    try:
        try:
            return _main(list(arguments))
        finally:
            _flush()  # raises BrokenPipeError here if the reader has exited
    except StarError as error:
        _report(str(error))
        return BAD_INPUT
    except BrokenPipeError:
        _discard(sys.stdout)
        return FAILED
    except KeyboardInterrupt:
        _report("interrupted")
        return FAILED


def _main(arguments: list[str]) -> int:
    match arguments:
        case ["help", name, *_] if not name.startswith("-"):
            return _command(name, ["--help"])
        case ["-h" | "--help" | "help", *_]:
            _print(f"{USAGE}\n\n{overview(_loaded())}")
        case ["-V" | "--version", *_]:
            from star_core import __version__

            _print(f"star {__version__}")
        case [name, *rest] if not name.startswith("-"):
            return _command(name, rest)
        case []:
            raise StarError(f"{USAGE}\nname a COMMAND; `star --help` lists them")
        case [option, *_]:
            hint = suggestion(option, ("--help", "--version"), "there are")
            raise StarError(f"{USAGE}\nunknown option {option!r}{hint}", "unknown-option")
    return 0


def overview(registry: Registry) -> str:
    """Return all commands by group; commands of one name are all listed."""
    from shutil import get_terminal_size
    from textwrap import wrap

    width, rest = get_terminal_size((MAX_WIDTH, 24)).columns, " " * 14
    groups: dict[str, list[str]] = {group: [] for group in GROUPS}
    for kind, plugin in registry:
        if kind == "command":
            line = f"  {plugin.offer.name:<12}{plugin.offer.summary}"
            lines = wrap(line, min(width, MAX_WIDTH), subsequent_indent=rest)
            groups.setdefault(plugin.offer.group, []).extend(lines)
    lists = ["\n".join([group, *lines]) for group, lines in groups.items() if lines]
    head = "Missions for drone swarms, from one YAML file."
    return "\n\n".join([head, *lists, "`star help COMMAND` describes a command."])


def _command(name: str, arguments: list[str]) -> int:
    """Run a command.

    Raises:
        StarError: There is none of that name.
    """
    registry = _loaded()
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
        gc.set_threshold(GARBAGE)
    names = registry.names("command")
    if name not in names:
        from star_core.discovery import blocked_hint

        hint = blocked_hint(name) or suggestion(name, names, "there are")
        raise StarError(f"star has no command {name!r}{hint}")
    from contextlib import nullcontext

    from star_core.commands.command_line import run_command
    from star_core.toolkit.printable_output import printable_output

    shipped = registry.find("command", name).source.own
    with printable_output() if shipped else nullcontext():
        return run_command(name, arguments, registry)


def _loaded() -> Registry:
    """Return the installed plugins after reporting those that were left out."""
    from contextlib import redirect_stdout

    from star_core.toolkit.progress import Progress

    # What plugins print must not be in the output.
    with Progress("loading plugins"), redirect_stdout(sys.stderr):
        from star_core.plugin_support.registry import Registry

        registry = Registry()
    for source, why in registry.broken.items():
        _report(f"star: plugin {source} is left out: {why}")
    return registry


def _print(text: str) -> None:
    """Print the output; raise `StarError` if it cannot be written, even if it is not buffered."""
    from star_core.toolkit.printable_output import written

    with written():
        print(text)


def _report(text: str) -> None:
    """Print on stderr, unless its reader has exited."""
    try:
        print(printable(text), file=sys.stderr)
    except OSError:
        _discard(sys.stderr)


def _flush() -> None:
    """Write the rest of the output, or discard it if it cannot be written.

    Raises:
        StarError: It cannot be written.
    """
    from star_core.toolkit.printable_output import written

    try:
        with written():
            sys.stdout.flush()
    except StarError:
        _discard(sys.stdout)
        raise


def _open_streams() -> None:
    """Open the standard streams that the shell has closed (``>&-``) on the null device.

    Otherwise Python has None in their place, and the next file that is opened takes their number.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(opened, True)  # noqa: FBT003 -- it takes no keyword
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), "w" if number else "r"))


def _without_threads(status: int) -> int:
    """Return an exit status, or exit at once if Python would wait for a plugin's threads."""
    import threading

    try:
        sys.stderr.flush()
    except OSError:  # otherwise Python would exit with a status of its own
        _discard(sys.stderr)
    if not all(
        thread.daemon for thread in threading.enumerate() if thread is not threading.main_thread()
    ):
        os._exit(status)
    return status


def _discard(stream: TextIO) -> None:
    """Discard the rest of the output: its reader has exited."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
