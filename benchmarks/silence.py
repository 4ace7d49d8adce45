"""How long the commands of the README write nothing, in a pipe and on a terminal.

Each of its commands of `star` is run with an empty cache of kernels
and with that of the installation. Figures are the time to the first output, and the longest time
without any until the command ends, or until the limit, at which it is interrupted. A command that
serves is measured until it writes that it does.
"""

from __future__ import annotations

import json
import os
import pty
import re
import select
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from printed import command_line

ROOT = Path(__file__).parents[1]
GOALS = {"pipe": 5.0, "terminal": 2.0}  # s
SERVES = re.compile(r"star (view|fleet) ")
SERVING = re.compile(rb"127\.0\.0\.1")
LIMIT = 60.0  # s


@dataclass(frozen=True)
class Figures:
    """Figures of one run: times in s."""

    command: str
    output: str
    cache: str
    first: float
    longest: float
    total: float


def commands() -> Iterator[str]:
    """Yield the commands of `star` in the README, each once."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    lines = [line.partition("#")[0].strip() for block in blocks for line in block.splitlines()]
    ours = [line for line in lines if line.startswith(("star ", "star-run "))]
    yield from dict.fromkeys(ours)


def measured(command: str, output: str, cache: str, folder: Path, limit: float) -> Figures:
    """Run a command in `folder`, with its output into a pipe or onto a terminal."""
    program, *arguments = shlex.split(command)
    line = [str(Path(sys.executable).with_name(program)), *arguments]
    empty = {"NUMBA_CACHE_DIR": str(folder / "kernels")} if cache == "empty" else {}
    reader, writer = pty.openpty() if output == "terminal" else os.pipe()
    begun = last = time.monotonic()
    process = subprocess.Popen(
        line,
        stdout=writer,
        stderr=writer,
        stdin=subprocess.DEVNULL,
        cwd=folder,
        env=os.environ | empty,
    )
    os.close(writer)
    first, longest, end = None, 0.0, begun + limit
    while True:
        ready, _, _ = select.select([reader], [], [], max(0.0, end - time.monotonic()))
        now = time.monotonic()
        try:
            data = os.read(reader, 65536) if ready else b""
        except OSError:  # what a terminal reports when its last writer has exited
            data = b""
        longest = max(longest, now - last)
        if data and first is None:
            first = now - begun
        last = now
        if not data or (SERVES.search(command) and SERVING.search(data)):
            break
    os.close(reader)
    stop(process)
    return Figures(command, output, cache, first or last - begun, longest, last - begun)


def stop(process: subprocess.Popen[bytes]) -> None:
    """End a process that is still running."""
    for number in (signal.SIGINT, signal.SIGINT, signal.SIGKILL):
        try:
            process.wait(0.2)
        except subprocess.TimeoutExpired:
            process.send_signal(number)
    process.wait()


def main() -> None:
    """Print the figures."""
    parser = command_line(__doc__, limit=LIMIT)
    parser.add_argument("--only", default="", metavar="TEXT", help="commands that contain TEXT")
    options = parser.parse_args()
    if not options.json:
        print("| command | output, kernels | first output, s | longest silence, s | total, s |")
        print("|---|---|---:|---:|---:|")
    for command in (line for line in commands() if options.only in line):
        for output, goal in GOALS.items():
            with TemporaryDirectory() as name:
                folder = Path(name)
                (folder / "missions").symlink_to(ROOT / "missions")
                if "runs/latest" in command:
                    measured("star run missions/hello.yaml", "pipe", "full", folder, LIMIT)
                for cache, kernels in (("empty", "compiled"), ("full", "loaded")):
                    figures = measured(command, output, cache, folder, options.limit)
                    if options.json:
                        print(json.dumps(asdict(figures)), flush=True)
                        continue
                    late = " **over**" if figures.longest > goal else ""
                    row = f"| `{command}` | {output}, {kernels} | {figures.first:.1f} "
                    print(f"{row}| {figures.longest:.1f}{late} | {figures.total:.1f} |", flush=True)


if __name__ == "__main__":
    main()
