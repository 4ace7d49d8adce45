"""Requests to land: the space bar of the flight's terminal, and `star stop` in another one."""

from __future__ import annotations

import os
import pty
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from star_core import Operator
from star_core.cli import land_requests
from star_core.cli.land_requests import listening
from star_core.cli.main import main

KEYS = """
import os, sys, time
os.dup2(os.open(sys.argv[1], os.O_RDWR), 0)  # the terminal of this session
from star_core import Operator
from star_core.cli.land_requests import listening
operator = Operator()
with listening(operator, "demo"):
    print("ready", flush=True)
    while not operator.stops:
        time.sleep(0.01)
print(operator.stops)
"""


@pytest.fixture(autouse=True)
def runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of the sockets, not made yet; a socket's path has about 100 characters at most."""
    with TemporaryDirectory() as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        yield Path(folder) / "star-swarm"


def test_star_stop_lands_every_running_flight(
    runtime: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    operator = Operator()
    with listening(operator, "demo"):
        assert runtime.stat().st_mode & 0o777 == 0o700
        assert main(["stop"]) == 0
    assert operator.stops == 1
    assert capsys.readouterr().out == "demo: all agents land\n"
    assert list(runtime.iterdir()) == []


def test_star_stop_again_does_not_stop_the_motors() -> None:
    operator = Operator()
    with listening(operator, "demo"):
        main(["stop"])
        main(["stop"])
    assert operator.stops == 1


def test_without_a_flight_star_stop_fails(
    runtime: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runtime.mkdir(mode=0o700)
    with socket.socket(socket.AF_UNIX) as killed:  # left behind by a flight that was killed
        killed.bind(str(runtime / "1234.sock"))
    assert main(["stop"]) == 1
    assert capsys.readouterr().err == "no flight is running\n"
    assert list(runtime.iterdir()) == []


def test_a_flight_that_hangs_is_named(runtime: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runtime.mkdir(mode=0o700)
    with socket.socket(socket.AF_UNIX) as hangs:
        hangs.bind(str(runtime / "1234.sock"))
        hangs.listen()
        assert main(["stop"]) == 1
    text = "process 1234 does not answer: only a guardian can land its agents\n"
    assert capsys.readouterr().err == text


def test_the_space_bar_lands_all_agents() -> None:
    keyboard, terminal = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", KEYS, os.ttyname(terminal)],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as flight:
        assert flight.stdout is not None
        assert flight.stdout.readline() == "ready\n"
        os.write(keyboard, b"x")
        os.write(keyboard, b" ")
        assert flight.stdout.readline() == "1\n"
    os.close(keyboard)
    os.close(terminal)


@pytest.mark.parametrize(
    ("value", "kind", "stops"),
    [
        pytest.param(1, 0x01, 1, id="pressed"),
        pytest.param(0, 0x01, 0, id="released"),
        pytest.param(1, 0x81, 0, id="down when the device is opened"),
        pytest.param(32767, 0x02, 0, id="axis"),
    ],
)
def test_a_button_of_a_gamepad_lands_all_agents(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: int, kind: int, stops: int
) -> None:
    os.mkfifo(tmp_path / "js0")
    monkeypatch.setattr(land_requests, "GAMEPADS", tmp_path)
    requests: list[str] = []
    monkeypatch.setattr(land_requests, "_land", lambda _operator, source: requests.append(source))
    with listening(Operator(), "demo"), (tmp_path / "js0").open("wb", buffering=0) as gamepad:
        gamepad.write(struct.pack("=IhBB", 1000, value, kind, 3))
        gamepad.close()  # unplugged
        main(["stop"])  # the event of the gamepad is read by then, or at once after it
    assert sorted(requests) == ["gamepad, button 3"] * stops + ["star stop"]
