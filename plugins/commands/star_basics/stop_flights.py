"""``star stop``: lands the agents of running flights, by the sockets that these listen on."""

from __future__ import annotations

import os
import re
import socket
import stat
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from star_basics.land_requests import (
    ANSWER_TIMEOUT,
    FOLDER,
    LAND,
    MAX_MESSAGE,
    NAME,
    check_private,
    shared_folder,
)
from star_core import InputError, Registry

SOCKETS: Final = Path("/proc/net/unix")  # of the whole machine, on Linux; the last column is a path
SESSIONS: Final = Path("/run/user")  # holds a runtime folder for each user
PARALLEL: Final = 32  # flights that are asked at once: one that hangs must not delay the others


class Answer(NamedTuple):
    """What a flight, or what is at the position of its socket, answers.

    Attributes:
        process: Number of the flight's process.
        mission: Its name; empty without an answer.
        fault: Why there is no answer.
    """

    process: str
    mission: str
    fault: str = ""


def configure(line: ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Land all agents of every running flight of this user on this computer, simulated flights "
        "too. The motors are not stopped."
    )
    line.add_argument(
        "name", nargs="?", help="mission, or number of a process: land only its agents"
    )
    line.add_argument("--list", action="store_true", help="list the flights; none lands")


def run(options: Namespace, _registry: Registry) -> int:
    """Land the agents, print what lands and return the exit status.

    Raises:
        InputError: Others can open a folder of sockets; other folders were searched before.
    """
    name, list_only = options.name, options.list
    folders, refused = _folders()
    sockets = [path for folder in folders for path in _entries(folder)]
    with ThreadPoolExecutor(PARALLEL) as pool:
        answers = list(pool.map(lambda path: _ask(path, name, list_only=list_only), sockets))
    replies = [answer for answer in answers if answer is not None]
    status, lines = 0, []
    for reply in replies:
        if reply.fault:
            status = 1
            lines.append(f"process {reply.process} {reply.fault}")
        elif list_only:
            lines.append(f"{reply.mission} (process {reply.process})")
        elif name in {None, reply.mission, reply.process}:
            lines.append(f"{reply.mission}: all agents land")
    if refused:
        raise InputError("\n".join([*lines, *map(str, refused)]), "unwritable-file")
    if not lines:
        what = "no flight is running" if name is None else f"no flight of {name!r} is running"
        others = ", ".join(f"{reply.mission} (process {reply.process})" for reply in replies)
        searched = ", ".join(f"'{folder}'" for folder in folders) or "no folder"
        status = 1
        lines = [f"{what}; running: {others}" if others else f"{what}; searched: {searched}"]
    print(*lines, sep="\n", file=sys.stderr if status else sys.stdout)
    return status


def _folders() -> tuple[list[Path], list[InputError]]:
    """Return the folders of this user that may hold sockets, and why others were refused.

    A flight may have another runtime folder: that of a service, of another session, or of the user
    that calls sudo. On Linux all are found by the paths of the sockets themselves.
    """
    users = {os.getuid()}
    if os.getuid() == 0:
        with suppress(KeyError, ValueError):
            users.add(int(os.environ["SUDO_UID"]))
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    candidates = [Path(runtime) / FOLDER] if runtime else []
    for user in users:
        candidates += [SESSIONS / str(user) / FOLDER, shared_folder(user)]
    folders: list[Path] = []
    refused: list[InputError] = []
    for folder in dict.fromkeys([*candidates, *_bound()]):
        with suppress(OSError):  # it does not exist, or belongs to another user
            owner = folder.lstat().st_uid
            if owner not in users and folder not in candidates:
                continue
            try:
                check_private(folder, owner if owner in users else os.getuid())
                folders.append(folder)
            except InputError as error:
                refused.append(error)
    return folders, refused


def _bound() -> Iterator[Path]:
    """Yield the folders of sockets on this machine that are named like those of flights."""
    with suppress(OSError):
        for line in SOCKETS.read_bytes().splitlines():
            path = re.search(rb"(/.*/" + FOLDER.encode() + rb"(?:-\d+)?)/\d+\.sock$", line)
            if path is not None:
                yield Path(os.fsdecode(path[1]))


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.glob("*.sock"))
    except OSError:
        return []


def _ask(path: Path, name: str | None, *, list_only: bool) -> Answer | None:
    """Ask a flight for its name, and to land if it is meant; None if it has ended."""
    process = path.stem
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            return Answer(process, "", f"has no socket: '{path}' is another file")
        if name is None and not list_only:
            return Answer(process, _request(path, LAND))
        mission = _request(path, NAME)
        if not list_only and name in {mission, process}:
            mission = _request(path, LAND)
        return Answer(process, mission)
    except FileNotFoundError:
        return None
    except OSError as error:
        if isinstance(error, ConnectionRefusedError) and not _alive(path.stem):
            with suppress(OSError):  # its process was killed
                path.unlink()
            return None
        return Answer(process, "", "does not answer: only a guardian can land its agents")


def _request(path: Path, request: bytes) -> str:
    """Return the name of the mission that a flight answers.

    Raises:
        OSError: There is no answer.
    """
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(ANSWER_TIMEOUT)
        client.connect(str(path))
        client.sendall(request)
        answer = client.recv(MAX_MESSAGE)
    if not answer:
        raise ConnectionAbortedError
    return answer.decode(errors="replace")


def _alive(process: str) -> bool:
    try:
        os.kill(int(process), 0)
    except PermissionError:
        return True
    except (ValueError, OverflowError, OSError):
        return False
    return int(process) > 0
