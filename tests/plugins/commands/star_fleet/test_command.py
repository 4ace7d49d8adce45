"""``star fleet`` as its user sees it."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from star_core import InputError, Supervisor
from star_fleet.aideck import PORT
from star_fleet.command import CAMERAS
from star_fleet.packet import Port, join
from tests.commands import command
from tests.waiting import free_port

run = command("fleet")

MISSIONS = Path(__file__).parents[4] / "missions"
FIRST = str(MISSIONS / "first_flight.yaml")
EYES = str(MISSIONS / "three_eyes.yaml")


def free(count: int) -> int:
    """The first of so many free ports in a row."""
    while True:
        with ExitStack() as taken, suppress(OSError, OverflowError):
            first = taken.enter_context(socket.create_server(("127.0.0.1", 0)))
            port: int = first.getsockname()[1]
            for more in range(1, count):
                taken.enter_context(socket.create_server(("127.0.0.1", port + more)))
            return port


def called(port: int) -> socket.socket:
    """Connect to a port until there is an answer."""
    for _ in range(600):
        with suppress(OSError):
            return socket.create_connection(("127.0.0.1", port))
        time.sleep(0.1)
    raise TimeoutError


def test_it_prints_where_each_drone_is(capsys: pytest.CaptureFixture[str]) -> None:
    flags = ["--port", "0", "--duration", "0.2", "--speed", "10"]
    assert run([FIRST, *flags, "--set", "swarm.cf4.start=[0, 1.5, 0]"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["cf1", "cf2", "cf3", "cf4"]
    assert all(line.split()[1].startswith("udp://127.0.0.1:") for line in lines)


def test_an_interrupt_ends_it_well() -> None:
    command = [
        sys.executable,
        "-c",
        "from star_core.commands.main import main; raise SystemExit(main())",
    ]
    command += ["fleet", FIRST, "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as served:
        assert served.stdout is not None
        assert served.stdout.readline().startswith(b"cf1  udp://127.0.0.1:")
        served.send_signal(signal.SIGINT)
        _out, told = served.communicate(timeout=60)
    assert served.returncode == 0, told


def test_as_many_ports_are_needed_as_there_are_cameras(hop: Path) -> None:
    seeing = (hop / "hop.yaml").read_text().replace("0, 0]}", "0, 0], camera: aideck}", 1)
    (hop / "seeing.yaml").write_text(seeing)
    flags = ["--port", "0", "--cameras", "65535"]
    assert run([str(hop / "seeing.yaml"), *flags, "--duration", "0.01"]) == 0
    with pytest.raises(InputError) as raised:
        run([EYES, *flags])
    assert raised.value.code == "out-of-range"


@pytest.mark.parametrize(
    ("flag", "kind"),
    [
        ("--port", socket.SOCK_DGRAM),
        ("--mocap", socket.SOCK_DGRAM),
        ("--tcp", socket.SOCK_STREAM),
        ("--cameras", socket.SOCK_STREAM),
    ],
)
def test_a_port_that_is_taken_is_named_with_its_flag(flag: str, kind: socket.SocketKind) -> None:
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("127.0.0.1", 0))
        if kind is socket.SOCK_STREAM:
            taken.listen()
        port = str(taken.getsockname()[1])
        with pytest.raises(InputError) as raised:
            run([EYES, "--port", "0", "--cameras", "0", flag, port, "--duration", "0.1"])
    assert raised.value.code == "address-in-use"
    assert raised.value.message.startswith(f"{flag} {port}: ")
    assert f"name another port by {flag} N" in raised.value.message


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        ([FIRST, "--port", "65534"], "out-of-range", "--port 65534: no 3 ports from there"),
        ([FIRST, "--cameras", "0"], "missing-camera", f"no agent of {FIRST} carries a 'camera'"),
        ([FIRST, "--jpeg"], "option-conflict", f"no agent of {FIRST} carries a 'camera'"),
        ([EYES, "--jpeg", "--no-cameras"], "option-conflict", "no images to compress: --no-cam"),
        (
            [EYES, "--tcp", "4998"],
            "option-conflict",
            "would take ports of the cameras",
        ),
        ([FIRST, "--host", "192.0.2.1"], "invalid-address", "; --host must be "),
        ([FIRST, "--host", "nobody.invalid"], "invalid-address", "; --host must be "),
        (["no.yaml"], "file-not-found", "no.yaml"),
        ([FIRST, "--condition", "cf9=locked"], "unknown-agent", "did you mean"),
        ([FIRST, "--condition", "cf1=lockd"], "invalid-option", "did you mean 'locked'?"),
        ([FIRST, "--condition", "cf1"], "invalid-option", "there are"),
        ([FIRST, "--condition", "cf1=lighthouse"], "no-positioning", "{system: lighthouse}"),
        ([FIRST, "--condition", "cf1=loco"], "no-positioning", "onboard: {system: loco}"),
    ],
)
def test_what_cannot_be_served_is_refused(arguments: list[str], code: str, text: str) -> None:
    with pytest.raises(InputError) as raised:
        run(["--port", "0", *arguments])
    assert raised.value.code == code
    assert text in raised.value.message


def test_cameras_are_streamed_from_ai_deck_ports_by_default(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert CAMERAS == PORT == 5000
    first = free(3)
    monkeypatch.setattr("star_fleet.command.CAMERAS", first)
    assert run([EYES, "--port", "0", "--duration", "0.01"]) == 0
    told = [line.split(":")[-1] for line in capsys.readouterr().out.splitlines()]
    assert told == [str(first + row) for row in range(3)]


@pytest.mark.parametrize("arguments", [[FIRST], [EYES, "--no-cameras"]])
def test_absent_or_disabled_cameras_are_not_streamed(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*arguments, "--port", "0", "--duration", "0.01"]) == 0
    assert "camera" not in capsys.readouterr().out


def test_cameras_are_not_both_wanted_and_not(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        run([EYES, "--cameras", "0", "--no-cameras"])
    assert "not allowed with argument --cameras" in capsys.readouterr().err


def test_links_and_cameras_are_served_over_tcp_if_wanted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    flags = ["--port", "0", "--tcp", "0", "--cameras", "0", "--duration", "0.1", "--speed", "10"]
    assert run([EYES, *flags]) == 0
    for line in capsys.readouterr().out.splitlines():
        _name, udp, tcp, camera, where = line.split()
        assert udp.startswith("udp://")
        assert tcp.startswith("tcp://127.0.0.1:")
        assert (camera, where.split(":")[0]) == ("camera", "127.0.0.1")


@pytest.mark.parametrize(("flags", "form"), [([], 0), (["--jpeg"], 1)])
def test_images_are_compressed_if_wanted(flags: list[str], form: int) -> None:
    heads: list[bytes] = []

    def watch(port: int) -> None:
        with called(port) as deck:
            deck.settimeout(60)
            heads.append(deck.recv(15, socket.MSG_WAITALL))

    port = free_port()
    reader = threading.Thread(target=watch, args=(port,))
    reader.start()
    assert run([EYES, "--port", "0", "--cameras", str(port), *flags, "--duration", "1.5"]) == 0
    reader.join()
    assert heads[0][4] == 0xBC
    assert heads[0][10] == form


@pytest.mark.parametrize(
    ("flags", "state"),
    [
        ([], Supervisor.ARMED | Supervisor.AUTO_ARM | Supervisor.CAN_FLY),
        (["--brushless"], Supervisor.CAN_ARM),
    ],
)
def test_drones_with_brushless_motors_wait_to_be_armed(flags: list[str], state: Supervisor) -> None:
    answers: list[bytes] = []

    def ask(port: int) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.settimeout(0.1)
            for _ in range(300):
                client.sendto(join(Port.SUPERVISOR, 0, b"\x0c"), ("127.0.0.1", port))
                with suppress(OSError):
                    answers.append(client.recv(64))
                    return

    port = free_port()
    client = threading.Thread(target=ask, args=(port,))
    client.start()
    assert run([FIRST, "--port", str(port), *flags, "--duration", "0.5"]) == 0
    client.join()
    assert answers == [join(Port.SUPERVISOR, 0, b"\x8c" + int(state).to_bytes(2, "little"))]


@pytest.mark.parametrize(
    "flags", [["--port", "70000"], ["--speed", "0"], ["--duration", "inf"], ["--port", "x"]]
)
def test_a_flag_that_makes_no_sense_is_refused(
    flags: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        run([FIRST, *flags])
    assert f"argument {flags[0]}: invalid" in capsys.readouterr().err


def test_positions_are_served_as_motion_capture(capsys: pytest.CaptureFixture[str]) -> None:
    flags = ["--port", "0", "--mocap", "0", "--duration", "0.2", "--speed", "10"]
    assert run([FIRST, *flags]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("motion capture: natnet at 127.0.0.1, command_port ")
