"""A program that is a fleet's client: started when the ports are open, ending the fleet."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Final

from star_core import InputError, Mission
from star_fleet.server import Fleet, address

FLEET: Final = "STAR_FLEET"  # environment variable that lists the drones
LAUNCHER: Final = ("-m", "star_radio.cflib_script")
PYTHON: Final = re.compile(r"python(\d+(\.\d+)?)?(\.exe)?")
PATIENCE: Final = 10.0  # s, that a script has to end after SIGTERM


def launched(command: Sequence[str], assignments: Iterable[str] = ()) -> list[str]:
    """Return the command line that runs a command with the drones of a fleet.

    That is ``python [options] SCRIPT.py [arguments]`` with cflib, or ``star COMMAND ...``, such as
    ``star script``, with assignments ``path=value`` to values of the
    mission that it flies.

    Raises:
        InputError: It is another command, or there is no such script.

    Example:
        >>> launched(["python", "-u", __file__, "--fast"])[1:4]
        ['-u', '-m', 'star_radio.cflib_script']
        >>> launched(["star", "script", "hover.py"], ["transport=radio"])[1:]
        ['script', '--set', 'transport=radio', 'hover.py']
    """
    at = next((i for i, word in enumerate(command) if i and not word.startswith("-")), 0)
    script, text = command[at] if at else "", f"-- {' '.join(command)}"
    if Path(command[0]).name == "star" and at:
        options = [word for value in assignments for word in ("--set", value)]
        return [*command[: at + 1], *options, *command[at + 1 :]]
    if not PYTHON.fullmatch(Path(command[0]).name) or not script.endswith(".py"):
        expected = "python [options] SCRIPT.py [arguments], or star COMMAND [arguments]"
        raise InputError(f"{text}: expected {expected}", "invalid-option")
    if not Path(script).is_file():
        raise InputError(f"{text}: {script}: no such file", "file-not-found")
    return [*command[:at], *LAUNCHER, *command[at:]]


@contextmanager
def client(command: Sequence[str], fleet: Fleet, mission: Mission) -> Iterator[Callable[[], int]]:
    """Run a script beside a fleet, which stops with it; yield a function for its exit status.

    SIGTERM is passed on to the script. SIGINT is not: by Ctrl-C a terminal sends it to both, and
    the fleet serves on until the script has ended. A script that still runs at the end is
    terminated.

    Raises:
        InputError: The script cannot be started.
    """
    drones = [
        [agent.name, agent.uri or "", f"{address(agent, row):010X}", link]
        for row, (agent, link) in enumerate(zip(mission.scene.agents, fleet.addresses, strict=True))
    ]
    uses_radio = mission.plugins["transport"].use == "radio"  # then its options hold
    assignments = [f"swarm.{name}.uri={link}" for name, _uri, _address, link in drones]
    words = launched(command, [*([] if uses_radio else ["transport=radio"]), *assignments])
    try:
        process = subprocess.Popen(words, env={**os.environ, FLEET: json.dumps(drones)})  # noqa: S603 -- the user's
    except OSError as error:
        raise InputError(f"-- {command[0]}: {error.strerror}", "file-not-found") from error

    def wait() -> None:
        process.wait()
        fleet.stop()

    Thread(target=wait, name="script", daemon=True).start()
    before = {
        signal.SIGINT: signal.signal(signal.SIGINT, lambda *_signal: None),
        signal.SIGTERM: signal.signal(signal.SIGTERM, lambda *_signal: process.terminate()),
    }
    try:
        yield lambda: status(process)
    finally:
        status(process)
        for number, handler in before.items():
            signal.signal(number, handler)


def status(process: subprocess.Popen[bytes]) -> int:
    """Terminate a process that still runs; return its exit status, 128 + n if signal n ended it."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    return process.returncode if process.returncode >= 0 else 128 - process.returncode
