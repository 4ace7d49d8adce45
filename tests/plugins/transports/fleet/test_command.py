"""``star fleet`` as its user sees it."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from star_core import InputError
from star_sim.fleet.command import run

MISSIONS = Path(__file__).parents[4] / "missions"
FIRST = str(MISSIONS / "first_flight.yaml")


def test_it_says_where_each_drone_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([FIRST, "--port", "0", "--duration", "0.2", "--speed", "10"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["cf1", "cf2", "cf3"]
    assert all(line.split()[1].startswith("udp://127.0.0.1:") for line in lines)


def test_an_interrupt_ends_it_well() -> None:
    command = [sys.executable, "-c", "from star_core.cli import main; raise SystemExit(main())"]
    command += ["fleet", FIRST, "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as served:
        assert served.stdout is not None
        assert served.stdout.readline().startswith(b"cf1  udp://127.0.0.1:")
        served.send_signal(signal.SIGINT)
        _out, told = served.communicate(timeout=60)
    assert served.returncode == 0, told


def test_a_port_that_is_taken_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(
            InputError, match=rf"agent 'cf1': port {port} of '127.0.0.1' cannot be had"
        ):
            run([FIRST, "--port", str(port), "--duration", "0.1"])


def test_ports_end() -> None:
    with pytest.raises(InputError, match="--port 65534: no 3 ports from there, 65535 is the last"):
        run([FIRST, "--port", "65534"])


def test_links_and_cameras_are_served_over_tcp_if_wanted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    eyes = str(MISSIONS / "three_eyes.yaml")
    flags = ["--port", "0", "--tcp", "0", "--cameras", "0", "--duration", "0.1", "--speed", "10"]
    assert run([eyes, *flags]) == 0
    for line in capsys.readouterr().out.splitlines():
        _name, udp, tcp, camera, where = line.split()
        assert udp.startswith("udp://")
        assert tcp.startswith("tcp://127.0.0.1:")
        assert (camera, where.split(":")[0]) == ("camera", "127.0.0.1")


@pytest.mark.parametrize(
    "flags", [["--port", "70000"], ["--speed", "0"], ["--duration", "inf"], ["--port", "x"]]
)
def test_a_flag_that_makes_no_sense_is_refused(
    flags: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        run([FIRST, *flags])
    assert f"argument {flags[0]}: invalid" in capsys.readouterr().err


def test_a_mission_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no\.yaml"):
        run([str(tmp_path / "no.yaml")])
