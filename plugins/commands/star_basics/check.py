"""Command line of ``star check``."""

from __future__ import annotations

import io
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from star_basics.check_output import OUTPUTS, CheckedFile
from star_basics.check_problems import problem_of
from star_basics.files_to_check import files_to_check
from star_basics.mission_arguments import add_values, assignments
from star_core import InputError, Registry, StarError
from star_core.commands import completes, mission_names
from star_core.formats import STDIN, check_file
from star_core.toolkit import Progress

ERRORS: Final = 2  # exit status
WARNINGS: Final = 1  # exit status with --strict


def configure(line: ArgumentParser) -> None:
    """Add the options of the command."""
    files = line.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="file of any kind of `star schema`, a name of `star missions`, a folder with such"
        " files, or - for standard input",
    )
    completes(files, mission_names)
    line.add_argument(
        "--format",
        choices=[*OUTPUTS],
        default="text",
        help="of the problems: text, or json or annotations for github on stdout (%(default)s)",
    )
    line.add_argument(
        "--json", dest="format", action="store_const", const="json", help="as --format json"
    )
    line.add_argument(
        "--strict", action="store_true", help="exit with 1 if there are warnings, but no errors"
    )
    line.add_argument(
        "--skip-others",
        action="store_true",
        help="skip files that are not STAR's if they are named, too, as in folders",
    )
    add_values(line)


def run(options: Namespace, registry: Registry) -> int:
    """Check the files, print what they are good for and their problems.

    Returns:
        0; 2 if a file has an error; with ``--strict`` 1 if the only problems are warnings.

    Raises:
        InputError: A folder has no files to check.
    """
    files = files_to_check(options.files, registry, skip_others=options.skip_others)
    standard_input = sys.stdin.buffer.read() if STDIN in files else b""
    values = assignments(options)
    checked = []
    title = f"checking {files[0]}" if len(files) == 1 else "checking"
    with Progress(title, len(files), unit="files" if len(files) > 1 else "") as progress:
        for path in files:
            progress.detail = str(path) if len(files) > 1 else ""
            with _stdin_of(standard_input):
                checked.append(_checked(path, registry, values))
            progress.done += 1
    OUTPUTS[options.format](checked, standard_input)
    problems = [problem for file in checked for problem in file.problems]
    if not all(problem.warning for problem in problems):
        return ERRORS
    return WARNINGS if options.strict and problems else 0


def _checked(path: Path, registry: Registry, values: list[str]) -> CheckedFile:
    """Check a file."""
    try:
        text, warnings = check_file(path, registry, values)
    except InputError as error:
        return CheckedFile(path, None, [problem_of(text, path) for text in error.problems])
    except StarError as error:
        return CheckedFile(path, None, [problem_of(str(error), path)])
    return CheckedFile(path, text, [problem_of(text, path, warning=True) for text in warnings])


@contextmanager
def _stdin_of(content: bytes) -> Iterator[None]:
    """Let standard input be read again from its beginning."""
    before, sys.stdin = sys.stdin, io.TextIOWrapper(io.BytesIO(content))
    try:
        yield
    finally:
        sys.stdin = before
