"""Has the stock desktop client connect to a simulated drone, and takes a picture of its window.

Not in the suite: it needs a screen, a minute, and a person at it. On Debian, once::

    apt-get install xvfb xdotool imagemagick libegl1 libgl1 libxkbcommon-x11-0 libxcb-cursor0
    python3 -m venv ~/cfclient && ~/cfclient/bin/pip install cfclient

Then ``python tests/outside/stock_client.py ~/cfclient/bin/cfclient picture.png`` serves
``missions/first_flight.yaml`` with ``star fleet``, starts the client, unmodified, on a screen of
its own, and presses what a user presses: Connect, and with ``--fly`` the flight tab's Take off. It
says what the client complained of, exits with 1 if it did not connect, and leaves the picture to be
looked at: attitude, battery and the supervisor's button, and in flight height, thrust and motors.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, TypeVar

MISSION: Final = Path(__file__).parents[2] / "missions" / "first_flight.yaml"
URI: Final = "udp://127.0.0.1:19850"  # where the client scans first
SCREEN: Final = ":97"
WIDTH, HEIGHT = 1600, 1100  # px
CONNECT: Final = (304, 47)  # px, where that button is
TAKE_OFF: Final = (1342, 884)  # px, where that one is on a screen of this size
SCANNING: Final = 10.0  # s, in which the client finds the drone
PATIENCE: Final = 60.0  # s
SETTLING: Final = 12.0  # s, in which the client reads all parameters, and values come in
FLYING: Final = 6.0  # s, after Take off
COMPLAINT: Final = re.compile(r"Traceback|^\w*Error|^(WARNING|ERROR|CRITICAL)", re.MULTILINE)


Found = TypeVar("Found")


def main() -> int:
    """Run it; return the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("client", type=Path, help="the program cfclient")
    parser.add_argument("picture", type=Path, help="PNG to write")
    parser.add_argument("--fly", action="store_true", help="take off before the picture")
    parser.add_argument("--log", type=Path, help="where to keep what the client says")
    arguments = parser.parse_args()
    for tool in ("Xvfb", "xdotool", "import"):
        if shutil.which(tool) is None:
            parser.error(f"it needs the program {tool!r}")
    with ExitStack() as stack:
        home = Path(stack.enter_context(TemporaryDirectory()))
        said = arguments.log or home / "said.txt"
        settings = home / "cfclient"
        settings.mkdir()
        (settings / "config.json").write_text(json.dumps({"link_uri": URI}))
        screen = os.environ | {"DISPLAY": SCREEN, "XDG_CONFIG_HOME": str(home)}
        size = f"{WIDTH}x{HEIGHT}x24"
        start(stack, ["Xvfb", SCREEN, "-screen", "0", size, "-nolisten", "tcp"], screen, home / "x")
        star = [str(Path(sys.executable).with_name("star")), "fleet", str(MISSION)]
        start(stack, star, screen, home / "fleet")
        time.sleep(3.0)
        client = start(stack, [str(arguments.client)], screen, said)
        window = wait_for(lambda: window_named(screen, "Not connected"))
        point(screen, "windowmove", window, 0, 0, "windowsize", window, WIDTH, HEIGHT)
        time.sleep(SCANNING)
        point(screen, "mousemove", *CONNECT, "click", 1)
        connected = wait_for(lambda: "Connected to" in said.read_text(errors="replace"))
        time.sleep(SETTLING)
        if arguments.fly:
            point(screen, "mousemove", *TAKE_OFF, "click", 1)
            time.sleep(FLYING)
        subprocess.run(["import", "-window", "root", arguments.picture], env=screen, check=True)
        alive = client.poll() is None
        complaints = [
            line for line in said.read_text(errors="replace").splitlines() if COMPLAINT.search(line)
        ]
    for line in complaints:
        print(line)  # noqa: T201 -- a program
    print(f"connected: {bool(connected)}, still there: {alive}; look at {arguments.picture}")  # noqa: T201
    return 0 if connected and alive else 1


def start(
    stack: ExitStack, command: list[str], env: dict[str, str], said: Path
) -> subprocess.Popen[bytes]:
    """Start a program that ends with the stack; its output goes to a file."""
    log = stack.enter_context(said.open("wb"))
    process = subprocess.Popen(command, env=env, stdout=log, stderr=subprocess.STDOUT)
    stack.callback(process.wait)
    stack.callback(process.terminate)
    return process


def wait_for(look: Callable[[], Found]) -> Found:
    """Wait until there is something, but no longer than `PATIENCE`; return it."""
    end = time.monotonic() + PATIENCE
    while not (answer := look()) and time.monotonic() < end:
        time.sleep(0.5)
    return answer


def window_named(screen: dict[str, str], name: str) -> str:
    """Return the number of the visible window with a name; empty if there is none."""
    done = subprocess.run(
        ["xdotool", "search", "--onlyvisible", "--name", name],
        env=screen, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stdout.split("\n")[0]


def point(screen: dict[str, str], *words: object) -> None:
    """Do something with the mouse or a window, in words of xdotool."""
    subprocess.run(["xdotool", *map(str, words)], env=screen, check=True)


if __name__ == "__main__":
    sys.exit(main())
