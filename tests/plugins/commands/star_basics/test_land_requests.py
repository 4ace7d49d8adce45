"""Requests to land: the space bar of the flight's terminal, and `star stop` in another one."""

from __future__ import annotations

import os
import pty
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from star_basics import land_requests, stop_flights
from star_basics.land_requests import listening
from star_core import Operator
from star_core.commands.main import main
from tests.commands import Printed

KEYS = """
import os, sys, time
os.dup2(os.open(sys.argv[1], os.O_RDWR), 0)  # the terminal of this session
from star_core import Operator
from star_basics.land_requests import listening
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
        monkeypatch.setattr(stop_flights, "SOCKETS", Path(folder) / "sockets")  # of other tests
        monkeypatch.setattr(land_requests, "gettempdir", lambda: folder)
        yield Path(folder) / "star-swarm"


PROCESS = 2**31 - 1  # of no process


def test_star_stop_lands_every_running_flight(runtime: Path, capsys: Printed) -> None:
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


def test_without_a_flight_star_stop_fails(runtime: Path, capsys: Printed) -> None:
    runtime.mkdir(mode=0o700)
    with socket.socket(socket.AF_UNIX) as killed:  # left behind by a flight that was killed
        killed.bind(str(runtime / f"{PROCESS}.sock"))
    assert main(["stop"]) == 1
    assert capsys.readouterr().err == f"no flight is running; searched: '{runtime}'\n"
    assert list(runtime.iterdir()) == []


def test_a_flight_that_hangs_is_named(runtime: Path, capsys: Printed) -> None:
    runtime.mkdir(mode=0o700)
    with socket.socket(socket.AF_UNIX) as hangs:
        hangs.bind(str(runtime / "1234.sock"))
        hangs.listen()
        assert main(["stop"]) == 1
    text = "process 1234 does not answer: only a guardian can land its agents\n"
    assert capsys.readouterr().err == text


def test_star_stop_lands_the_rest_beside_odd_sockets(runtime: Path, capsys: Printed) -> None:
    runtime.mkdir(mode=0o700)
    (runtime / "1.sock").write_text("a file")
    (runtime / "2.sock").mkdir()
    (runtime / "3.sock").symlink_to("nothing")
    os.mkfifo(runtime / "4.sock")
    operator = Operator()
    with ExitStack() as stack:
        for name, answer in ("5", b"\xff\x1b[2J"), ("6", b""), ("x\x1b", b"odd name"):
            stack.enter_context(_answering(runtime / f"{name}.sock", answer))
        stack.enter_context(listening(operator, "demo"))
        assert main(["stop"]) == 1
    assert operator.stops == 1
    text = capsys.readouterr().err
    assert "demo: all agents land\n" in text
    assert "process 1 has no socket" in text
    assert "process 6 does not answer" in text
    assert "\x1b" not in text
    assert (runtime / "1.sock").read_text() == "a file"


@contextmanager
def _answering(path: Path, answer: bytes) -> Iterator[None]:
    """Answer one client at a path."""
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
        server.listen()

        def serve() -> None:
            client, _ = server.accept()
            with client:
                client.recv(100)
                client.sendall(answer)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield
        thread.join(5)


def test_star_stop_finds_flights_in_other_runtime_folders(
    runtime: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    operator = Operator()
    with TemporaryDirectory() as other, listening(operator, "demo"):
        sockets = runtime.parent / "sockets"
        path = runtime / f"{os.getpid()}.sock"
        sockets.write_text(f"Num Path\n0: 2 0 10000 1 1 23 {path}\n0: 2 0 0 1 1 24 @abstract\n")
        monkeypatch.setattr(land_requests, "gettempdir", lambda: other)
        for elsewhere in other, f"{other}/missing", "":
            monkeypatch.setenv("XDG_RUNTIME_DIR", elsewhere)
            assert main(["stop"]) == 0
            assert capsys.readouterr().out == "demo: all agents land\n"
    assert operator.stops == 1


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_flights_are_found_by_their_sockets(runtime: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_flights, "SOCKETS", Path("/proc/net/unix"))
    with listening(Operator(), "demo"):
        assert runtime in stop_flights._bound()


def test_a_missing_runtime_folder_is_replaced(
    monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/no/such/folder")
    assert main(["stop"]) == 1
    assert capsys.readouterr().err == "no flight is running; searched: no folder\n"
    operator = Operator()
    with listening(operator, "demo"):
        assert main(["stop"]) == 0
    assert operator.stops == 1


def test_star_stop_lists_and_lands_by_name(capsys: Printed) -> None:
    operator = Operator()
    with listening(operator, "demo"):
        assert main(["stop", "--list"]) == 0
        assert capsys.readouterr().out == f"demo (process {os.getpid()})\n"
        assert main(["stop", "other"]) == 1
        text = f"no flight of 'other' is running; running: demo (process {os.getpid()})\n"
        assert capsys.readouterr().err == text
        assert operator.stops == 0
        assert main(["stop", "demo"]) == 0
        assert main(["stop", str(os.getpid())]) == 0
    assert operator.stops == 1


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
