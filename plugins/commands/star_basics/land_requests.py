"""Requests to land all agents, beside signals: space bar, gamepad, `star stop` in another terminal.

Each flight listens on a socket, named by its process, in a folder that only its user can open.
"""

from __future__ import annotations

import logging
import os
import select
import signal
import socket
import stat
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import gettempdir
from typing import Final, TypeAlias

from star_core import InputError, Operator
from star_core.toolkit import log

log_messages = logging.getLogger(__name__)

LAND: Final = b"land"
NAME: Final = b"name"
FOLDER: Final = "star-swarm"  # in the runtime folder of a user
ANSWER_TIMEOUT: Final = 1.0  # s
BACKGROUND_PERIOD: Final = 0.2  # s, between checks whether the flight is in the foreground again
MAX_MESSAGE: Final = 1000  # bytes
GAMEPADS: Final = Path("/dev/input")  # folder of the devices js0, js1, ...
GAMEPAD_EVENT: Final = struct.Struct("IhBB")  # ``js_event`` of linux/joystick.h
BUTTON: Final = 1  # kind of event; those of buttons that were down at the start have other kinds

Handler: TypeAlias = Callable[[int], bool]
"""Reads from a file descriptor that is ready; returns whether to go on with it."""


@contextmanager
def listening(operator: Operator, mission: str) -> Iterator[None]:
    """Land all agents when the space bar is pressed, and at `star stop`."""
    with ExitStack() as stack:
        waker, woken = (stack.enter_context(end) for end in socket.socketpair())
        handlers: dict[int, Handler] = {}
        try:
            server = stack.enter_context(_server())
            handlers[server.fileno()] = lambda _: _answer(operator, mission, server)
        except (OSError, InputError) as error:
            log_messages.warning("`star stop` cannot land this flight: %s", error)
        if sys.stdin is not None and sys.stdin.isatty() and _in_foreground():
            stack.enter_context(_keys_at_once())
            handlers[sys.stdin.fileno()] = lambda source: _press(operator, source, woken.fileno())
            log("space or Ctrl-C lands all agents; a second Ctrl-C stops the motors")
        for device in sorted(GAMEPADS.glob("js*")):
            with suppress(OSError):  # it may belong to another user
                source = os.open(device, os.O_RDONLY | os.O_NONBLOCK)
                stack.callback(os.close, source)
                handlers[source] = lambda source: _push(operator, source)
                log(f"any button of the gamepad {device} lands all agents")
        thread = threading.Thread(target=_listen, args=(handlers, woken.fileno()), daemon=True)
        thread.start()
        try:
            yield
        finally:
            waker.close()
            thread.join()


def _folder() -> Path:
    """Return the folder of this process's socket, which is made if necessary.

    Raises:
        InputError: Others can open it.
        OSError: It cannot be made.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    folder = (
        Path(runtime) / FOLDER if Path(runtime).is_dir() and runtime else shared_folder(os.getuid())
    )
    folder.mkdir(mode=0o700, exist_ok=True)
    check_private(folder, os.getuid())
    return folder


def shared_folder(user: int) -> Path:
    """Return the folder of a user's sockets without a runtime folder."""
    return Path(gettempdir()) / f"{FOLDER}-{user}"


def check_private(folder: Path, user: int) -> None:
    """Check that only a user can open a folder.

    Raises:
        InputError: Others can, or it is not a folder.
    """
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != user or status.st_mode & 0o077:
        text = f"'{folder}' is not a folder that only you can open; remove it"
        raise InputError(text, "unwritable-file")


@contextmanager
def _server() -> Iterator[socket.socket]:
    """Listen to `star stop`."""
    path = _folder() / f"{os.getpid()}.sock"
    path.unlink(missing_ok=True)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
        try:
            server.listen()
            yield server
        finally:
            path.unlink(missing_ok=True)


@contextmanager
def _keys_at_once() -> Iterator[None]:
    """Let the terminal deliver each key when it is pressed, and not show it."""
    import termios

    before = termios.tcgetattr(sys.stdin)
    changed = [*before]
    changed[3] &= ~(termios.ICANON | termios.ECHO)
    termios.tcsetattr(sys.stdin, termios.TCSADRAIN, changed)
    try:
        yield
    finally:
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})  # of the background
        with suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _in_foreground() -> bool:
    """Whether keys are for this process: reading them in the background would stop it."""
    try:
        return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except OSError:
        return False


def _listen(handlers: dict[int, Handler], woken: int) -> None:
    """Wait for requests until `woken` is readable; runs in a thread."""
    while True:
        ready, _, _ = select.select([woken, *handlers], [], [])
        if woken in ready:
            return
        for source in ready:
            if not handlers[source](source):
                del handlers[source]


def _press(operator: Operator, terminal: int, woken: int) -> bool:
    """Obey the space bar."""
    if not _in_foreground():
        select.select([woken], [], [], BACKGROUND_PERIOD)
        return True
    keys = _read(terminal)
    if b" " in keys:
        _land(operator, "space")
    return bool(keys)  # otherwise the terminal is gone


def _push(operator: Operator, gamepad: int) -> bool:
    """Obey a button of a gamepad."""
    events = _read(gamepad)
    whole = len(events) - len(events) % GAMEPAD_EVENT.size
    for _time, value, kind, button in GAMEPAD_EVENT.iter_unpack(events[:whole]):
        if kind == BUTTON and value:
            _land(operator, f"gamepad, button {button}")
    return bool(events)  # otherwise it was unplugged


def _read(source: int) -> bytes:
    try:
        return os.read(source, MAX_MESSAGE - MAX_MESSAGE % GAMEPAD_EVENT.size)
    except OSError:
        return b""


def _answer(operator: Operator, mission: str, server: socket.socket) -> bool:
    """Answer `star stop` with the name of the mission, and land if it asks for that."""
    with suppress(OSError):
        client, _address = server.accept()
        with client:
            client.settimeout(ANSWER_TIMEOUT)
            request = client.recv(MAX_MESSAGE)
            if request == LAND:
                _land(operator, "star stop")
            if request in {LAND, NAME}:
                client.sendall(mission.encode()[:MAX_MESSAGE])
    return True


def _land(operator: Operator, source: str) -> None:
    operator.land_all()
    log(f"star: {source}: landing")
